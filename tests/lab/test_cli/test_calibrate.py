"""`jaxcontact calibrate`: its output, its files, and the input it refuses."""

import functools
import json
import os
import stat

import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact.lab.cli import main
from jaxcontact.lab.cli.commands.calibrate import FIGURE, NUMBERS, REPORT
from tests.lab.simulate import recording

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


def test_drag_mass_and_stiffness(tmp_path, capsys):
    drag = ["--mass", "0.0027", "--radius", "0.02", "--drag-coefficient", "0.5"]
    options = ["--ball", "pingpong", *drag, "--stiffness", "1e6", "--law", "kuwabara_kono"]
    options += ["--details"]
    assert main(["calibrate", *options, "--out", str(tmp_path), "--quiet"]) == 0
    assert "corrected in the flights" in capsys.readouterr().out
    data = json.loads((tmp_path / NUMBERS).read_text())
    constant, viscous = data["choice"]["laws"]
    assert abs(constant["estimates"][0]["value"] - 0.955) < 0.002
    kappa, _, a = viscous["estimates"]
    np.testing.assert_allclose(a["value"] * (1e6 / 0.0027) ** 0.4, kappa["value"], rtol=1e-12)


def test_files_are_replaced_and_readable(good, tmp_path, monkeypatch, capsys):
    """In the current folder, without `--out`."""
    monkeypatch.chdir(tmp_path)
    for name in (FIGURE, NUMBERS):
        (tmp_path / name).write_text("old")
    assert main(["calibrate", good.name, "--law", "constant_damping", "--quiet", "--json"]) == 0
    assert capsys.readouterr().out == (tmp_path / NUMBERS).read_text()
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
    assert main(["fit", "impacts", str(path), *FIT, "--json"]) == 0
    fitted = json.loads(capsys.readouterr().out)
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
