"""The contents of reports, printed, saved and as one page; what `jaxcontact calibrate` prints."""

import contextlib
import dataclasses
import functools
import io
import json
import operator
import re
import types
from xml.etree import ElementTree

import jax
import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact.lab import report_page
from jaxcontact.lab.calibration.report import report, side_by_side
from jaxcontact.lab.calibration.report_parts import Html, Rows, element
from jaxcontact.lab.calibration.summary_data import AtSpeed
from jaxcontact.lab.choice.kind import Estimate
from jaxcontact.lab.cli import main
from jaxcontact.lab.cli.commands.calibrate import FIGURE, NUMBERS
from tests.lab.sources import lines, recording, trials


@pytest.fixture(scope="module")
def shipped(tmp_path_factory):
    folder = tmp_path_factory.mktemp("shipped") / "new" / "folder"
    words = ["calibrate", "--law", "all", "--out", str(folder), "--at", "2", "--at=6"]
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        assert main([*words, "--report", str(folder / "a.txt")]) == 0
    return types.SimpleNamespace(folder=folder, printed=out.getvalue(), progress=err.getvalue())


@pytest.fixture(scope="module")
def blue(shipped):
    with jax.enable_x64(False):
        return jc.load_calibration(shipped.folder / NUMBERS)


def test_the_command_prints_and_writes_the_shipped_ball(shipped, blue):
    lines = shipped.printed.splitlines()
    assert "ball blue" in lines[0] and len(lines) <= 25
    assert lines[2].startswith("e = 0.8799 ± 0.0017 (95 %) at 0.675 to 3.2 m/s")
    assert lines[3].startswith("e = 0.8799 ± 0.0017 (95 %) at 2 m/s")
    assert lines[4].startswith("e = 0.8799 ") and "no pair is so fast" in lines[4]
    assert str(shipped.folder / NUMBERS) in shipped.printed
    # The first line of progress comes before any compilation.
    assert shipped.progress.startswith("[  0.0 s] reading the recording")
    assert "fitting Kuwabara-Kono" in shipped.progress
    assert sorted(p.name for p in shipped.folder.iterdir()) == ["a.txt", NUMBERS, FIGURE]
    data = json.loads((shipped.folder / NUMBERS).read_text())
    assert data["recording"]["ball"] == "blue"
    assert isinstance(blue.law, jc.ExactRestitution)
    assert (shipped.folder / FIGURE).read_bytes().startswith(b"\x89PNG")
    # What was saved has the same report.
    assert shipped.printed.startswith(repr(blue))
    assert blue.report() == (shipped.folder / "a.txt").read_text()


def test_every_marked_pair_is_listed_with_its_rows(blue):
    text, marked = blue.report(), [pair for pair in blue.pairs if pair.marked]
    assert len(marked) == 23
    for pair in marked:
        assert f"  {pair.rows[0]}, {pair.rows[1]} " in text
    assert "23 of 294 pairs" in text and "without (271)" in text
    assert "with (294)" in text


def test_what_a_reader_needs_is_said(blue):
    text = " ".join(blue.report().split())
    for words in (
        "not corrected",
        "--mass --radius --drag-coefficient",
        "e(v) determines only A (K/m)^(2/5)",
        "e(v) determines only c/K",
        "standard errors by trial",
        "converged yes",
        "straight line (no law): d ln e/dv",
        "In Python ExactRestitution(e=",
        "mass and stiffness not given",
        "--stiffness determines c, and with --mass",
        "A single reading of e scatters by 2.2 %.",
        "Scatter 2.2 % of e in a typical pair: 0.4 % from bounce to bounce, and 2.6 ms in",
        blue.choice.verdict,
    ):
        assert words in text
    # There is one scatter: 0.4 % of e beside 2.2 % was read as a contradiction.
    assert text.count("2.2 %") == 2 and text.count("0.4 %") == 1
    assert max(len(line) for line in blue.report().splitlines()) <= 110


def test_it_prints_itself_with_the_verdict_first(blue):
    lines = repr(blue).splitlines()
    assert lines[0] == "Calibration of bounce_intervals.csv (shipped with the package), ball blue"
    assert max(map(len, lines)) <= 100
    assert f"{blue.law!r}, {blue.contact!r}" in " ".join(repr(blue).split())
    assert "Not ruled out: c as a power of v and 1 - b v^p." in " ".join(repr(blue).split())
    assert repr(blue).splitlines()[:-1] == blue.report().splitlines()[: len(lines) - 1]
    assert blue.table() == blue.choice.table()
    for line in blue.table().splitlines():
        assert line in blue.report()


def heights(count):
    h = np.arange(1.0, count + 1)
    return {"drop_height_m": h, "rebound_height_m": 0.7 * h + 0.01 * (-1) ** h}


SPEEDS = np.arange(1.0, 13)
TABLE = {"velocity": SPEEDS, "restitution": 0.9 + 0.002 * (-1) ** SPEEDS}


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        (TABLE, ("by row (sandwich)", "no correction needed", "0 of 12 pairs")),
        (heights(10), ("by drop height (cluster-robust sandwich)",)),
        (heights(6), ("fewer than 8 drop heights",)),
    ],
)
def test_how_the_standard_errors_were_found_is_said(columns, words):
    result = jc.calibrate(jc.read_recording(columns), laws="constant_damping")
    text = " ".join(result.report().split())
    assert all(word in text for word in words) and "without and with" not in text


@pytest.mark.parametrize(
    ("value", "error", "unit", "text"),
    [
        (0.87991, 0.00084, "", "0.87991 ± 0.00084"), (89683.4, 1940.2, "N", "8.97e+04 ± 1.9e+03 N"),
        (9.589e-6, 6.7e-8, "s", "9.589e-06 ± 6.7e-08 s"),
        (0.5, None, "s/m", "0.5 s/m (not identifiable)"), (0.5, 0.0, "", "0.5 ± 0"),
        (0.021, 0.5, "", "0.02 ± 0.50"),
    ],
)  # fmt: skip
def test_digits_follow_the_error(value, error, unit, text):
    assert str(Estimate("x", value, error, unit)) == text


def test_how_the_file_was_read_is_told(blue):
    assert "Read as" not in blue.report()
    notes = ('interval_s = "t / ms" / 1000', "with decimal commas")
    read = dataclasses.replace(blue.recording, notes=notes)
    told = report(dataclasses.replace(blue, recording=read))
    assert 'Read as    interval_s = "t / ms" / 1000; with decimal commas' in told


def test_laws_are_compared_that_were_fitted_with_and_without_marked_pairs(blue):
    """A pair more may allow a law with a parameter more."""
    rows = side_by_side(blue)[1].rows
    few = dataclasses.replace(blue.choice, laws=blue.choice.laws[1:])
    assert len(rows) == 2 * len(blue.choice.laws)
    assert side_by_side(dataclasses.replace(blue, choice=few))[1].rows == rows[2:]


# Saved calibrations are restored to the last bit, and every fault of a file is named.

V = np.geomspace(0.5, 4.0, 14)
E = 0.9 - 0.03 * np.log(V) + 0.004 * np.random.default_rng(3).standard_normal(14)


@pytest.fixture(scope="module")
def calibration():
    table = jc.read_recording(velocity=V, restitution=E)
    return jc.calibrate(table, laws="kuwabara_kono", mass=1 / 3, stiffness=1e7 / 3)


@pytest.fixture
def saved(calibration, tmp_path):
    path = tmp_path / "ball.json"
    calibration.save(path)
    return path


def assert_equal(loaded, made):
    """A choice comes back without its fits."""
    if dataclasses.is_dataclass(loaded):
        for field in dataclasses.fields(loaded):
            assert getattr(loaded, field.name) == getattr(made, field.name)
    else:
        assert loaded == made


def test_every_number_comes_back_to_the_last_bit(calibration, saved):
    loaded = jc.load_calibration(saved)
    assert isinstance(loaded.law, jc.KuwabaraKono) and loaded.law.tension
    assert loaded.law.A == calibration.law.A
    assert loaded.contact.mass == 1 / 3 and loaded.contact.stiffness == 1e7 / 3
    for field in dataclasses.fields(loaded):
        if field.name not in ("law", "contact"):
            assert_equal(getattr(loaded, field.name), getattr(calibration, field.name))
    before = jc.impact(calibration.law, calibration.contact, V).restitution
    assert np.array_equal(jc.impact(loaded.law, loaded.contact, V).restitution, before)
    again = saved.with_name("again.json")
    calibration.save(again)
    assert again.read_bytes() == saved.read_bytes()


def test_a_file_of_the_version_before_has_no_check(saved):
    data = json.loads(saved.read_text())
    del data["check"], data["stiffness_error"]
    saved.write_text(json.dumps(data | {"format_version": 6}))
    loaded = jc.load_calibration(saved)
    assert loaded.check is None and loaded.pairs


def test_a_recording_with_trials_and_outliers_comes_back(tmp_path):
    text = recording(lambda v: 0.88, 5).replace(",3,5,", ",3,50,", 1)
    result = jc.calibrate(jc.read_recording(io.StringIO(text)), laws="constant_damping")
    result.save(tmp_path / "a.json")
    loaded = jc.load_calibration(tmp_path / "a.json")
    assert loaded.pairs == result.pairs and loaded.by_speed == result.by_speed
    assert_equal(loaded.with_marked, result.with_marked)


DELETE = object()

FAULTS = [
    (["format_version"], 1, "format_version must be 6 or 7"),
    (["format_version"], DELETE, "format_version is missing"),
    (["colour"], "red", "colour is unknown; known are law, contact"),
    (["noise", "pink"], 1.0, "noise.pink is unknown; known are relative, reading"),
    (["noise", "relative"], DELETE, "noise.relative is missing"),
    (["noise", "relative"], "small", "noise.relative must be a number, but is 'small'"),
    (["noise", "relative"], True, "noise.relative must be a number, but is True"),
    (["pairs", 3, "velocity"], float("nan"), "holds NaN"),
    (["pairs", 3, "velocity"], 10**400, r"pairs\[3\].velocity must be finite"),
    (["pairs", 3, "rows"], 7, r"pairs\[3\].rows must be a list, but is 7"),
    (["pairs", 3, "marked"], 0, r"pairs\[3\].marked must be of type bool, but is 0"),
    (["law", "name"], "magic", "law.name must be one of .*, but is 'magic'"),
    (["law", "parameters", "A"], DELETE, "law.parameters.A is missing"),
    (["law", "parameters", "A"], -1.0, "law is out of range: .*`A` must be in"),
    (["law", "parameters", "e"], 0.5, "law.parameters.e is unknown; known are A"),
    (["law", "tension"], "yes", "law.tension must be true or false, but is 'yes'"),
    (["contact", "mass"], 0.0, "contact is out of range: .*`mass` must be in"),
    (["standard_errors", "A"], "x", "standard_errors.A must be a number"),
    (["choice"], [], r"choice must be an object, but is \[\]"),
]


@pytest.mark.parametrize(("path", "value", "message"), FAULTS)
def test_a_fault_is_named(saved, path, value, message):
    data = json.loads(saved.read_text())
    *way, last = path
    place = functools.reduce(operator.getitem, way, data)
    if value is DELETE:
        del place[last]
    else:
        place[last] = value
    saved.write_text(json.dumps(data))
    with pytest.raises(ValueError, match=f"ball.json: .*{message}"):
        jc.load_calibration(saved)


@pytest.mark.parametrize(
    ("text", "message"), [("{", "is not JSON"), ("[1, 2]", "format_version is missing")]
)
def test_what_is_no_json_is_refused(text, message, tmp_path):
    (tmp_path / "ball.json").write_text(text)
    with pytest.raises(ValueError, match=f"ball.json: {message}"):
        jc.load_calibration(tmp_path / "ball.json")
    with pytest.raises(FileNotFoundError):
        jc.load_calibration(tmp_path / "none.json")


# A calibration as one page: its contents, no code from the data, and other file types.

EVIL = "ball<script>alert(1)</script>"


def parsed(page):
    """The elements of a page, without its style; an error where they are not closed."""
    closed = re.sub(r"<(meta|img)([^>]*)>", r"<\1\2/>", page.removeprefix("<!doctype html>"))
    root = ElementTree.fromstring(f"<div>{closed}</div>")
    for style in root.iter("style"):
        style.text = ""
    return root


def text_of(page):
    return "".join(parsed(page).itertext())


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory):
    """The calibration of a file with evil names, in units that are converted."""
    rows = [
        [EVIL, 1, number, k, 1e3 * seconds, "<i>"]
        for number, intervals in enumerate(trials(lambda v: 0.88, 1), 1)
        for k, seconds in enumerate(intervals, 1)
    ]
    rows[39][4] *= 2  # a missed trigger, which is marked
    head = "ball,drop_height_m,trial,bounce,interval [ms],<b>note</b>"
    file = tmp_path_factory.mktemp("evil") / "<script>.csv"
    file.write_text(lines(head, rows, number=str))
    return jc.calibrate(jc.read_recording(file), laws="constant_damping")


@pytest.fixture(scope="module")
def page(calibrated, tmp_path_factory):
    file = tmp_path_factory.mktemp("page") / "ball.html"
    jc.report(calibrated, file)
    return file.read_text(encoding="utf-8")


def test_nothing_of_the_file_is_code_and_nothing_is_loaded(page):
    elements = [*parsed(page).iter()]
    attributes = [pair for one in elements for pair in one.items()]
    assert not {one.tag for one in elements} & {"script", "b", "i", "iframe", "object", "link"}
    assert not any(name.startswith("on") for name, _ in attributes)
    assert EVIL in text_of(page) and "<script>.csv" in text_of(page)
    loaded = [value for name, value in attributes if name in ("src", "href", "data")]
    assert len(loaded) == 3
    assert all(one.startswith("data:image/svg+xml;base64,") for one in loaded)
    # It prints on paper; seen with Chromium on A4: nothing cut, no scroll bars.
    style = page.partition("<style>")[2].partition("</style>")[0]
    paper = style.partition("@media print")[2]
    assert "@page { size: A4;" in style and "pre { white-space: pre-wrap;" in paper
    assert ".wide, pre { overflow: visible; }" in paper
    assert "http:" not in re.sub(r"base64,[^\"]*", "", page) and len(page) < 1_000_000


def test_the_verdict_comes_first_and_everything_is_said(page, calibrated):
    text = " ".join(text_of(page).split())
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

    known = types.SimpleNamespace(
        law=law, contact=contact, given=("mass", "stiffness"), stiffness_error=1500.0,
        at=[AtSpeed(v, 0.88, 0.88 - v / 100, 0.88 + v / 100, v < 2, 0.8, 0.9) for v in (1, 2)],
        __export__=lambda other: (law, contact, np.array([0.5, 1.0, 2.0])),
    )  # fmt: skip
    told = []
    text = text_of(report_page.simulators(known, None, told.append))
    assert told == [f"inverting the law of {name}" for name in ("exudyn", "simbody", "yade")]
    own = jc.export(law, contact, [0.5, 1.0, 2.0], engine="exudyn")
    assert own.snippet in text and "largest error of e, 0.5 to 2 m/sbelow 0.0001" in text
    # What lies beyond the measured speeds does not count.
    assert text.count("error of the law's e, from the data (95 %)± 0.01") == 1
    assert "K = (1.000e+05 ± 2.9e+03) N/m^1.5 (95 %)" in text
    assert text.count("needs the radius of the ball") == 2
    text = text_of(report_page.simulators(known, 0.02, told.append))
    own = jc.export(law, contact, [0.5, 1.0, 2.0], engine="simbody", radius=0.02)
    assert own.snippet in text and f"{np.max(np.abs(own.error)):.4f}" in text
    assert "Not possible" not in text
    known.law = None
    assert "No fit converged" in report_page.simulators(known, None, told.append)


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


def test_text_is_escaped_once():
    assert element("p", "a < b & c", class_='"') == '<p class="&quot;">a &lt; b &amp; c</p>'
    assert element("p", Html("<b>x</b>")) == "<p><b>x</b></p>"
    table = Rows(("", "n"), [("<i>", "1")], "<>").html()
    assert '<td>&lt;i&gt;</td><td class="number">1</td>' in table
    assert Rows(("a",), []).html() == "" and Rows(("a",), []).text() == []
