"""`jaxcontact calibrate`: its output, its files, and the input it refuses."""

import functools
import json
import os
import stat

import numpy as np
import pytest

import jaxcontact as jc
from jaxcontact._cli import main
from jaxcontact._cli.commands.calibrate import FIGURE, NUMBERS, REPORT
from tests.test_lab.simulate import recording

HEADER = "ball,drop_height_m,trial,bounce,interval_s\n"
GOOD = recording(lambda v: 0.88, 1)


@pytest.fixture
def good(tmp_path):
    path = tmp_path / "good.csv"
    path.write_text(GOOD)
    return path


def test_the_shipped_ball(tmp_path, capsys):
    out = tmp_path / "new" / "folder"
    assert main(["calibrate", "--out", str(out), "--at", "2", "--at=6"]) == 0
    printed = capsys.readouterr()
    lines = printed.out.splitlines()
    assert "ball blue" in lines[0] and len(lines) <= 25
    assert lines[2].startswith("e = 0.8799 ± 0.0017 (95 %) at 0.675 to 3.2 m/s")
    assert lines[3].startswith("e = 0.8799 ± 0.0017 (95 %) at 2 m/s")
    assert lines[4].startswith("e = 0.8799 ") and "no pair is so fast" in lines[4]
    assert "294 pairs" in printed.out and "23" in printed.out
    assert str(out / NUMBERS) in printed.out
    # The first line of progress comes before any compilation.
    assert printed.err.startswith("[  0.0 s] reading the recording")
    assert "fitting Kuwabara-Kono" in printed.err
    assert sorted(p.name for p in out.iterdir()) == [NUMBERS, FIGURE]
    data = json.loads((out / NUMBERS).read_text())
    assert data["recording"]["ball"] == "blue"
    assert sum(pair["marked"] for pair in data["pairs"]) == 23
    assert isinstance(jc.load_calibration(out / NUMBERS).law, jc.ExactRestitution)
    assert (out / FIGURE).read_bytes().startswith(b"\x89PNG")


def test_a_file_of_one_s_own(good, tmp_path, capsys):
    options = ["--out", str(tmp_path / "o"), "--law", "all", "--report", "--details", "--quiet"]
    assert main(["calibrate", str(good), *options]) == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    page = (tmp_path / "o" / REPORT).read_text()
    assert f"({FIGURE})" in page
    # The printed text, except for the line that names the files.
    title, _, rest = printed.out.rpartition("Written")[0].strip().partition("\n\n")
    assert page.startswith(f"# {' '.join(title.split())}\n") and rest in page
    assert "0 of 220 pairs" in printed.out
    data = json.loads((tmp_path / "o" / NUMBERS).read_text())
    found = data["choice"]["laws"][0]["estimates"][0]
    assert abs(found["value"] - 0.88) < 4 * found["standard_error"]


def test_a_report_is_what_its_ending_says(good, tmp_path, capsys):
    text, page = tmp_path / "a.txt", tmp_path / "a.html"
    options = ["--law", "constant_damping", "--out", str(tmp_path), "--quiet"]
    assert main(["calibrate", str(good), *options, "--details", "--report", str(text)]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith(text.read_text()) and str(text) in printed
    assert main(["calibrate", str(good), *options, f"--report={page}", "--radius", "0.02"]) == 0
    assert page.read_text().startswith("<!doctype html>")
    assert not (tmp_path / REPORT).exists()


def test_the_current_folder_is_the_default(good, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["calibrate", good.name, "--law", "constant_damping", "--quiet"]) == 0
    assert (tmp_path / FIGURE).exists()
    assert (tmp_path / NUMBERS).exists()


SPEED_DEPENDENT = ["constant_damping", "power_damping", "kuwabara_kono"]
SPEED_DEPENDENT += ["thornton_plastic", "viscoplastic", "wet_restitution", "jkr"]
SPEED_DEPENDENT += ["power_restitution"]


@pytest.mark.parametrize(
    ("law", "laws"),
    [("kuwabara_kono", ["exact", "kuwabara_kono"]), ("hu_guo", ["hu_guo", *SPEED_DEPENDENT])],
)
def test_a_choice_of_law(good, tmp_path, capsys, law, laws):
    assert main(["calibrate", str(good), "--law", law, "--out", str(tmp_path), "--quiet"]) == 0
    data = json.loads((tmp_path / NUMBERS).read_text())
    assert [fit["law"] for fit in data["choice"]["laws"]] == laws
    estimates = [one["name"] for one in data["choice"]["laws"][0]["estimates"]]
    assert ("e delivered" in estimates) == (law == "hu_guo")


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


def test_files_are_replaced_and_readable(good, tmp_path, capsys):
    for name in (FIGURE, NUMBERS):
        (tmp_path / name).write_text("old")
    options = ["--law", "constant_damping", "--out", str(tmp_path), "--quiet", "--json"]
    assert main(["calibrate", str(good), *options]) == 0
    assert capsys.readouterr().out == (tmp_path / NUMBERS).read_text()
    mask = os.umask(0)
    os.umask(mask)
    for name in (FIGURE, NUMBERS):
        path = tmp_path / name
        assert path.read_bytes() != b"old"
        assert stat.S_IMODE(path.stat().st_mode) == 0o666 & ~mask


BAD_FILES = {
    "missing column": (
        "ball,drop_height_m,trial,bounce\na,1,1,1\n",
        "row 1, column interval_s: is missing",
    ),
    "text": (HEADER + "a,1,1,1,0.4\na,1,1,2,fast\n", "row 3, column interval_s: 'fast'"),
    "negative": (HEADER + "a,1,1,1,0.4\na,1,1,2,-0.36\n", "row 3, column interval_s: must be"),
    "not a number": (HEADER + "a,1,1,1,nan\n", "row 2, column interval_s: 'nan'"),
    "no pair": (HEADER + "a,1,1,1,0.4\n", "column interval_s: 0 usable pairs of successive"),
    "no rows": (HEADER, "row 1, column interval_s: holds a header"),
    "empty": ("", "row 1: is empty"),
    "two balls": (
        HEADER + "a,1,1,1,.4\nb,1,1,1,.4\n",
        "row 3, column ball: holds several balls (a, b); choose one with --ball",
    ),
    "heights": (
        "ball,drop_height_m,trial,rebound_height_m\na,0.5,1,high\n",
        "row 2, column rebound_height_m: 'high' is not a number",
    ),
    "table": ("velocity,restitution\n1,0.9\n2,\n", "row 3, column restitution: is empty"),
}


@pytest.mark.parametrize("case", BAD_FILES)
def test_a_bad_file_is_named_and_nothing_is_written(case, tmp_path, capsys):
    text, message = BAD_FILES[case]
    path, out = tmp_path / "bad.csv", tmp_path / "out"
    path.write_text(text)
    assert main(["calibrate", str(path), "--out", str(out)]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    error = [line for line in printed.err.splitlines() if line.startswith("error: ")]
    assert len(error) == 1
    assert f"{path}, {message}" in error[0]
    assert not out.exists()
    assert [p.name for p in tmp_path.iterdir()] == ["bad.csv"]


BAD_OPTIONS = {
    "no such file": (["none.csv"], "none.csv: cannot be read"),
    "no such ball": (["--ball", "golf"], "has no ball 'golf'; it holds pingpong, blue, tennis"),
    "no such law": (["--law", "nonsense"], "--law must be one of"),
    "half a drag": (
        ["--radius", "0.02", "--drag-coefficient", "0.45"],
        "--drag-coefficient alone cannot correct for drag: also give --mass",
    ),
    "report": (["--report", "ball.jpg"], "ball.jpg: the name must end in .html, .md, .txt"),
    "pdf": (["--report", "ball.pdf"], "--report ball.pdf: write it as .html, open that"),
    "air alone": (["--air-density", "1.2"], "--air-density alone cannot correct for drag"),
}


@pytest.mark.parametrize("case", BAD_OPTIONS)
def test_bad_options_are_refused(case, tmp_path, monkeypatch, capsys):
    options, message = BAD_OPTIONS[case]
    monkeypatch.chdir(tmp_path)
    assert main(["calibrate", *options]) == 2
    assert message in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_mass_or_a_radius_alone_leaves_drag_off(good, tmp_path, capsys):
    options = ["--law", "constant_damping", "--out", str(tmp_path), "--quiet", "--mass", "0.05"]
    for more, missing in (
        ([], "--radius and --drag-coefficient"),
        (["--radius", ".012"], "--drag"),
    ):
        assert main(["calibrate", str(good), *options, *more]) == 0
        data = json.loads((tmp_path / NUMBERS).read_text())
        said = " ".join(capsys.readouterr().out.split())
        assert f"air drag is left out: its correction also needs {missing}" in said
        assert data["drag"] is None


@pytest.mark.parametrize("option", ["--gravity", "--mass", "--radius", "--stiffness"])
@pytest.mark.parametrize("value", ["-1", "0", "nan", "inf", "x"])
def test_bad_numbers_are_refused(option, value, capsys):
    with pytest.raises(SystemExit) as caught:
        main(["calibrate", f"{option}={value}"])
    assert caught.value.code == 2
    assert option in capsys.readouterr().err


def test_a_file_in_place_of_the_folder_is_refused(good, capsys):
    assert main(["calibrate", str(good), "--out", str(good)]) == 2
    assert "is not a folder" in capsys.readouterr().err
    assert good.read_text() == GOOD


def test_a_folder_that_cannot_be_written_is_an_error(good, tmp_path, capsys):
    blocked = tmp_path / "file"
    blocked.write_text("")
    out = blocked / "below"
    options = ["--law", "constant_damping", "--out", str(out), "--quiet"]
    assert main(["calibrate", str(good), *options]) == 2
    assert str(blocked) in capsys.readouterr().err


def test_a_fit_that_does_not_converge_is_said(good, tmp_path, capsys, monkeypatch):
    from jaxcontact._calibration.choice import table

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
    """The same rows, weights and standard deviations, in a file of two balls."""
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
    two = tmp_path / "two.csv"
    two.write_text("ball,v,e\n" + "".join(f"{'ab'[int(a < 2)]},{a},{b}\n" for a, b in rows))
    assert main(["fit", "impacts", str(two), *FIT]) == 2
    assert "holds several balls (b, a); choose one with --ball" in capsys.readouterr().err
