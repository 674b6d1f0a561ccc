"""The contents of the report; what `jaxcontact calibrate` prints and writes of the shipped ball."""

import contextlib
import dataclasses
import io
import json
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact.lab.calibration.report import report, side_by_side
from jaxcontact.lab.choice.kind import Estimate
from jaxcontact.lab.cli import main
from jaxcontact.lab.cli.commands.calibrate import FIGURE, NUMBERS

DRAG = jc.Drag(mass=0.0027, radius=0.02, coefficient=0.5)


class Shipped(NamedTuple):
    folder: Path
    printed: str
    progress: str


@pytest.fixture(scope="module")
def shipped(tmp_path_factory):
    folder = tmp_path_factory.mktemp("shipped") / "new" / "folder"
    words = ["calibrate", "--law", "all", "--out", str(folder), "--at", "2", "--at=6"]
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        assert main([*words, "--report", str(folder / "a.txt")]) == 0
    return Shipped(folder, out.getvalue(), err.getvalue())


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
        blue.choice.verdict,
    ):
        assert words in text
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


def test_there_is_one_scatter_and_its_parts_are_named(blue):
    """0.4 % of e beside 2.2 % was read as a contradiction."""
    text = " ".join(blue.report().split())
    assert "A single reading of e scatters by 2.2 %." in text
    assert (
        "Scatter 2.2 % of e in a typical pair: 0.4 % from bounce to bounce, and 2.6 ms in" in text
    )
    assert text.count("2.2 %") == 2 and text.count("0.4 %") == 1


def test_drag_that_was_taken_out_or_left_in_and_numbers_that_were_given_are_said():
    caution = "air drag is not corrected and may cause"
    ping = jc.read_recording(ball="pingpong")
    raw = jc.calibrate(ping, laws="constant_damping")
    assert caution in " ".join(raw.report().split())
    given = {"mass": 0.0027, "stiffness": 1e6}
    result = jc.calibrate(ping, laws="constant_damping", drag=DRAG, **given)
    text = " ".join(result.report().split())
    assert "not given" not in text and "--stiffness determines" not in text and caution not in text
    assert "corrected in the flights: quadratic, terminal speed 8.37 m/s" in text
    assert result.drag.coefficient == 0.5


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
