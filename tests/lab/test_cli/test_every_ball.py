"""`jaxcontact calibrate --ball all`: a row for each ball, as each has alone."""

import csv
import io
import json
import re
from pathlib import Path

import numpy as np

import jaxcontact as jc
from jaxcontact.lab.cli import main

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
    return list(csv.DictReader(io.StringIO((folder / "calibration.csv").read_text())))


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
