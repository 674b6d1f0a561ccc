"""`jaxcontact calibrate`: its output, its files, and the input it refuses."""

import csv
import functools
import json
import os
import re
import stat
from pathlib import Path

import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact.lab.cli import main
from jaxcontact.lab.cli.commands.calibrate import FIGURE, NUMBERS, REPORT
from tests.lab.sources import recording
from tests.lab.test_cli.test_scene import asked

GOOD = recording(lambda v: 0.88, 1)


@pytest.fixture
def good(tmp_path):
    path = tmp_path / "good.csv"
    path.write_text(GOOD)
    return path


def test_reports_of_a_file_of_ones_own(good, tmp_path, capsys):
    """By their endings; a mass or a radius alone leaves the drag in, which is said."""
    text, page = tmp_path / "a.txt", tmp_path / "a.html"
    out = tmp_path / "o"
    options = ["calibrate", str(good), "--law", "constant_damping", "--out", str(out), "--quiet"]
    assert main([*options, "--report", "--details"]) == 0
    printed = capsys.readouterr()
    assert printed.err == "" and "0 of 220 pairs" in printed.out
    shown = (out / REPORT).read_text()
    assert f"({FIGURE})" in shown
    # The printed text, except for the line that names the files.
    title, _, rest = printed.out.rpartition("Written")[0].strip().partition("\n\n")
    assert shown.startswith(f"# {' '.join(title.split())}\n") and rest in shown
    data = json.loads((out / NUMBERS).read_text())
    found = data["choice"]["laws"][0]["estimates"][0]
    assert abs(found["value"] - 0.88) < 4 * found["standard_error"]
    (out / REPORT).unlink()
    for more, missing in (
        (["--details", "--report", str(text)], "--radius and --drag-coefficient"),
        ([f"--report={page}", "--radius", ".012"], "--drag"),
    ):
        assert main([*options, "--mass", "0.05", *more]) == 0
        printed = capsys.readouterr().out
        said = " ".join(printed.split())
        assert f"air drag is left out: its correction also needs {missing}" in said
        assert json.loads((out / NUMBERS).read_text())["drag"] is None
        if "--details" in more:
            assert printed.startswith(text.read_text()) and str(text) in printed
    assert f"by <code>jaxcontact calibrate {good} --law" in page.read_text()
    assert page.read_text().startswith("<!doctype html>") and not (out / REPORT).exists()


def test_files_are_replaced_and_readable(good, tmp_path, monkeypatch, capsys):
    """In the current folder, without `--out`."""
    monkeypatch.chdir(tmp_path)
    for name in (FIGURE, NUMBERS):
        (tmp_path / name).write_text("old")
    ball = "--mass .0027 --radius .02 --drag-coefficient .5 --stiffness 1e6".split()
    law = ["--law", "constant_damping"]
    assert main(["calibrate", good.name, *law, *ball, "--quiet", "--json"]) == 0
    printed = capsys.readouterr().out
    assert printed == (tmp_path / NUMBERS).read_text()
    data = json.loads(printed)
    assert [*data["drag"].values()] == [0.0027, 0.02, 0.5, 1.204]
    assert data["given"] == ["mass", "stiffness"]
    mask = os.umask(0)
    os.umask(mask)
    for name in (FIGURE, NUMBERS):
        path = tmp_path / name
        assert path.read_bytes() != b"old"
        assert stat.S_IMODE(path.stat().st_mode) == 0o666 & ~mask


def test_a_fit_that_does_not_converge_is_said(good, tmp_path, capsys, monkeypatch):
    from jaxcontact.lab.choice import table

    impatient = functools.partial(table.fit, max_steps=2)
    monkeypatch.setattr(table, "fit", impatient)
    options = ["--law", "constant_damping", "--out", str(tmp_path), "--quiet", "--details"]
    assert main(["calibrate", str(good), *options]) == 1
    printed = capsys.readouterr().out
    assert "NO, in 2 steps: 2 steps were not enough" in printed
    assert "the median of 220 pairs from" in printed
    assert "NOT converged, do not use: constant e, constant c" in printed
    loaded = jc.load_calibration(tmp_path / NUMBERS)
    assert not loaded.converged and loaded.law is None


FIT = ("--law", "exact", "--mass", "1", "--stiffness", "1e6")


def judged(folder, capsys, text):
    """Whether a constant e describes a table, by `calibrate` and `fit impacts`; the notes."""
    path = folder / "table.csv"
    path.write_text(text)
    told = jc.calibrate(jc.read_recording(path), laws="constant_damping")
    fitted = asked(capsys, "fit", "impacts", str(path), *FIT)
    marked = [row for pair in told.pairs if pair.marked for row in pair.rows]
    assert ", ".join(map(str, marked)) in "; ".join(fitted["read_as"])
    constant = told.choice.laws[0]
    # For a wrong law, errors of e and of ln e weight rows differently.
    np.testing.assert_allclose(
        fitted["parameters"]["law.e"],
        told.choice.fits["constant e"].params["e"],
        rtol=1e-4 if constant.adequate else 5e-3,
    )
    return constant.adequate, fitted["adequate"], fitted["read_as"]


def test_fit_impacts_gives_the_verdict_of_calibrate(tmp_path, capsys):
    """The same rows, weights and standard deviations."""
    random = np.random.default_rng(2)
    v = np.linspace(0.5, 4, 20)
    e = 0.8 + 0.01 * random.normal(size=20)
    e[4] = 0.4
    rows = list(zip(v, e, strict=True))
    plain = "v,e\n" + "".join(f"{a},{b}\n" for a, b in rows)
    calibrated, fitted, notes = judged(tmp_path, capsys, plain)
    assert (calibrated, fitted) == (True, True)
    assert "left out, as in `calibrate`: row 6" in notes[-1]
    small = "v,e,u(e)\n" + "".join(f"{a},{b},0.003\n" for a, b in rows)
    calibrated, fitted, notes = judged(tmp_path, capsys, small)
    assert (calibrated, fitted) == (False, False)
    assert any("standard deviations" in one for one in notes)
    falling = "v,e\n" + "".join(f"{a},{b - 0.03 * a}\n" for a, b in rows)
    calibrated, fitted, _ = judged(tmp_path, capsys, falling)
    assert (calibrated, fitted) == (False, False)


# `--ball all`: a row for each ball, as each has alone.

ALIKE = 1e-9  # relative: the same search of the same data, measured 0
CLOSED = 1e-6
"""Of a constant e, relative: the search stops at 1e-8 of its parameter, measured 2e-11."""


def table(balls, seed=0):
    """Return the text of a table of e(v), by ball: its factor c/K and its number of rows."""
    random = np.random.default_rng(seed)
    lines = ["ball,speed (mm/s),COR"]
    for ball, (c, rows) in balls.items():
        v = random.uniform(0.4, 4, rows)
        e = 1 / (1 + c * v) + 0.006 * random.normal(size=rows)
        lines += [f"{ball},{1e3 * a:.3f},{b:.5f}" for a, b in zip(v, e, strict=True)]
    return "\n".join(lines) + "\n"


def written(folder):
    return list(csv.DictReader((folder / "calibration.csv").read_text().splitlines()))


def run(tmp_path, text, *options):
    path = tmp_path / "many.csv"
    path.write_text(text)
    return main(["calibrate", str(path), "--ball", "all", "--out", str(tmp_path / "o"), *options])


def test_each_row_is_that_of_the_ball_alone(tmp_path, capsys):
    text = table({"red, big": (0.05, 12), "blue": (0.15, 9), "few": (0.1, 3)})
    # A wrong reading, in line 16.
    lines = text.splitlines()
    lines[15] = lines[15].rpartition(",")[0] + ",0.2"
    law = ["--law", "constant_damping", "--stiffness", "1e5", "--at", "1", "--at", "3"]
    text = "\n".join(lines).replace("red, big", '"red, big"')
    assert run(tmp_path, text, *law, "--quiet") == 0
    printed = capsys.readouterr().out.splitlines()
    assert "constant_damping for each ball of" in printed[0]
    assert printed[1] == "3 balls: 2 converged, 1 too_few_points"
    assert printed[3].startswith("  c/K (s/m) ") and "±" in printed[3]
    rows = {row["ball"]: row for row in written(tmp_path / "o")}
    assert rows["few"]["status"] == "too_few_points" and rows["few"]["c (N s/m^(5/2))"] == ""
    assert rows["blue"]["rows left out"] == "16" and rows["blue"]["pairs"] == "8"
    for ball in ("red, big", "blue"):
        recording = jc.read_recording(tmp_path / "many.csv", ball=ball)
        alone = jc.calibrate(recording, laws="constant_damping", stiffness=1e5, at=[1, 3])
        row = rows[ball]
        own = [float(row["c (N s/m^(5/2))"]), float(row["standard error of c (N s/m^(5/2))"])]
        np.testing.assert_allclose(own, [alone.law.c, alone.standard_errors["c"]], rtol=ALIKE)
        for point in alone.at[2:]:
            name = f"e at {point.velocity:g} m/s"
            numbers = [float(row[one]) for one in (name, f"{name}, low", f"{name}, high")]
            expected = [point.restitution, point.low, point.high]
            np.testing.assert_allclose(numbers, expected, rtol=ALIKE)


def test_a_constant_e_is_the_mean_of_its_logarithm(tmp_path, capsys):
    assert run(tmp_path, table({"a": (0.03, 10), "b": (0.1, 6)}), "--law=exact", "--json") == 0
    whole = json.loads(capsys.readouterr().out)
    assert "velocity" in whole["read_as"][0]
    columns = np.genfromtxt(tmp_path / "many.csv", delimiter=",", skip_header=1, dtype=str)
    for row in whole["balls"]:
        y = np.log(columns[columns[:, 0] == row["ball"], 2].astype(float))
        # With at least eight rows the error is the sandwich, n/(n-1) of the mean square.
        error = y.std(ddof=1) / np.sqrt(y.size)
        numbers = [row["e"], row["standard error of e"]]
        np.testing.assert_allclose(numbers, np.exp(y.mean()) * np.array([1, error]), rtol=CLOSED)
    assert len(written(tmp_path / "o")) == 2


def test_more_balls_compile_nothing(tmp_path, capsys, compiled):
    law = ("--law", "constant_damping", "--quiet")
    assert run(tmp_path, table({"a": (0.05, 9)}), *law) == 0
    compiled.clear()
    balls = {f"ball {k}": (0.02 + 0.005 * k, 5 + k) for k in range(25)}
    assert run(tmp_path, table(balls, 1), *law) == 0 and compiled == []
    assert len(written(tmp_path / "o")) == 25
    assert "and 5 more; --details prints all" in capsys.readouterr().out


def test_the_page_shows_what_is_printed(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    page = (Path(__file__).parents[3] / "docs" / "calibrate.md").read_text(encoding="utf-8")
    command, shown = re.findall(r"```bash\n(.* all .*)\n```\n\n```text\n([^`]*)```", page)[0]
    assert main([*command.split()[1:], "--quiet"]) == 0 and capsys.readouterr().out == shown
