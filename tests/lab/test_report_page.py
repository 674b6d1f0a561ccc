"""A calibration as one page: its contents, no code from the data, and other file types."""

import html.parser
import json
import re

import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact.lab import report_page
from jaxcontact.lab.calibration.report_parts import Html, Rows, element
from jaxcontact.lab.calibration.summary_data import AtSpeed
from tests.lab.simulate import recording

EVIL = "ball<script>alert(1)</script>"


class Page(html.parser.HTMLParser):
    """The elements of a page, what they load, and its text; an error where they are not closed."""

    def __init__(self, page):
        super().__init__()
        self.open, self.names, self.loaded, self.text = [], set(), [], ""
        self.feed(page)
        self.close()
        assert not self.open, self.open

    def handle_starttag(self, tag, attrs):
        self.names.add(tag)
        self.loaded += [value for name, value in attrs if name in ("src", "href", "data")]
        assert not any(name.startswith("on") for name, _ in attrs)
        if tag not in ("meta", "img"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if "style" not in self.open:
            self.text += data


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory):
    """The calibration of a file with evil names, in units that are converted."""
    header, *rows = recording(lambda v: 0.88, 1).splitlines()
    assert header == "ball,drop_height_m,trial,bounce,interval_s"
    lines = ["ball,drop_height_m,trial,bounce,interval [ms],<b>note</b>"]
    for row in rows:
        _, *middle, seconds = row.split(",")
        lines.append(",".join([EVIL, *middle, repr(1e3 * float(seconds)), "<i>"]))
    # A missed trigger, which is marked.
    *middle, last, note = lines[40].split(",")
    lines[40] = ",".join([*middle, repr(2 * float(last)), note])
    file = tmp_path_factory.mktemp("evil") / "<script>.csv"
    file.write_text("\n".join(lines) + "\n")
    return jc.calibrate(jc.read_recording(file), laws="constant_damping")


@pytest.fixture(scope="module")
def page(calibrated, tmp_path_factory):
    file = tmp_path_factory.mktemp("page") / "ball.html"
    jc.report(calibrated, file)
    return file.read_text(encoding="utf-8")


def test_nothing_of_the_file_is_code_and_nothing_is_loaded(page):
    found = Page(page)
    assert not found.names & {"script", "b", "i", "iframe", "object", "link"}
    assert EVIL in found.text and "<script>.csv" in found.text
    assert len(found.loaded) == 3
    assert all(one.startswith("data:image/svg+xml;base64,") for one in found.loaded)
    assert "http:" not in re.sub(r"base64,[^\"]*", "", page) and len(page) < 1_000_000


def test_the_verdict_comes_first_and_everything_is_said(page, calibrated):
    text = " ".join(Page(page).text.split())
    summary = calibrated
    order = [
        "Calibration of",
        "e = 0.",
        summary.chosen.said,
        "Pictures",
        "Parameters",
        "For your simulator",
        "The laws compared",
        summary.choice.verdict,
        "Data processing",
        "Gravity",
        "jaxcontact",
    ]
    places = [text.index(words) for words in order]
    assert places == sorted(places)
    for law in summary.choice.laws:
        assert law.grounds[1:] in text  # it begins with a capital
        for estimate in law.estimates:
            assert str(estimate) in text
    # The reading of the file, and the excluded rows.
    assert "ms" in summary.recording.notes[0] and summary.recording.notes[0] in text
    assert "Without 5 of 20 trials the law predicts" in text and "by `jaxcontact" not in text
    last, title = summary.pairs[-1], f"{len(summary.pairs)} pairsrows"
    assert f"{last.velocity:.4g}{last.restitution:.4f}" in text.partition(title)[2]
    marked = [pair for pair in summary.pairs if pair.marked]
    assert marked and all(", ".join(map(str, pair.rows)) in text for pair in marked)
    # Without mass and stiffness there are no settings for a simulator, and the page states why.
    assert "give --mass and --stiffness" in text


def test_parameters_for_simulators(calibrated, monkeypatch):
    monkeypatch.setattr(report_page, "engines", lambda: ["exudyn", "simbody", "yade"])
    law, contact = jc.ExactRestitution(e=0.88), jc.Contact(mass=0.03, stiffness=1e5)

    class Known:
        given = "mass", "stiffness"
        at = tuple(
            AtSpeed(v, 0.88, 0.88 - v / 100, 0.88 + v / 100, v < 2, 0.8, 0.9) for v in (1, 2)
        )
        stiffness_error = 1500.0

        def __export__(self, other):
            return law, contact, np.array([0.5, 1.0, 2.0])

    Known.law, Known.contact = law, contact
    told = []
    text = Page(report_page.simulators(Known(), None, told.append)).text
    assert told == [f"inverting the law of {name}" for name in ("exudyn", "simbody", "yade")]
    own = jc.export(law, contact, [0.5, 1.0, 2.0], engine="exudyn")
    assert own.snippet in text and "largest error of e, 0.5 to 2 m/sbelow 0.0001" in text
    # What lies beyond the measured speeds does not count.
    assert text.count("error of the law's e, from the data (95 %)± 0.01") == 1
    assert "K = (1.000e+05 ± 2.9e+03) N/m^1.5 (95 %)" in text
    assert text.count("needs the radius of the ball") == 2
    text = Page(report_page.simulators(Known(), 0.02, told.append)).text
    own = jc.export(law, contact, [0.5, 1.0, 2.0], engine="simbody", radius=0.02)
    assert own.snippet in text and f"{np.max(np.abs(own.error)):.4f}" in text
    assert "Not possible" not in text
    Known.law = None
    assert "No fit converged" in report_page.simulators(Known(), None, told.append)


def test_other_endings_and_bad_arguments(calibrated, tmp_path):
    jc.report(calibrated, tmp_path / "a.txt")
    assert (tmp_path / "a.txt").read_text(encoding="utf-8") == calibrated.report()
    jc.report(calibrated, tmp_path / "a.JSON")
    assert json.loads((tmp_path / "a.JSON").read_text()) == json.loads(calibrated.to_json())
    jc.report(calibrated, tmp_path / "a.md")
    text = (tmp_path / "a.md").read_text(encoding="utf-8")
    assert text.startswith("# Calibration of ")
    assert calibrated.report().partition("\n\n")[2].rstrip() in text
    with pytest.raises(ValueError, match=r"`file` must end in .html, .md, .txt or .json"):
        jc.report(calibrated, "a.doc")
    with pytest.raises(ValueError, match=r"not end in .pdf: write it as .html, .* print to PDF"):
        jc.report(calibrated, "a.pdf")


def test_it_prints_on_paper(page):
    """Seen with Chromium on A4: nothing cut, no scroll bars."""
    style = page.partition("<style>")[2].partition("</style>")[0]
    assert "@page { size: A4;" in style
    paper = style.partition("@media print")[2]
    assert ".wide, pre { overflow: visible; }" in paper and "pre { white-space: pre-wrap;" in paper


def test_text_is_escaped_once():
    assert element("p", "a < b & c", class_='"') == '<p class="&quot;">a &lt; b &amp; c</p>'
    assert element("p", Html("<b>x</b>")) == "<p><b>x</b></p>"
    table = Rows(("", "n"), [("<i>", "1")], "<>").html()
    assert '<td>&lt;i&gt;</td><td class="number">1</td>' in table
    assert Rows(("a",), []).html() == "" and Rows(("a",), []).text() == []
