"""`jaxcontact scene` and `sweep`: files, examples, ranges, tables and pictures."""

import argparse
import json
import struct

import numpy as np
import pandas as pd
import pytest
from PIL import Image

import jaxcontact as jc
from jaxcontact.lab.cli import main
from jaxcontact.lab.cli.options import assignment, span

FALL = """
duration = 0.5
times = 6
instantaneous = true
gravity = [0.0, -9.81]
law = { name = "exact", e = 0.5 }

[[sphere]]
name = "ball"
radius = 0.1
mass = 1
position = [0.0, 0.5]

[[plane]]
name = "floor"
point = [0.0, 0.0]
normal = [0.0, 1.0]
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The current folder, with the file of a scene."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "fall.toml").write_text(FALL)
    return tmp_path


def asked(capsys, *arguments, code=0):
    """The JSON that a command prints, and nothing else on stdout."""
    assert main([*arguments, "--json", "--quiet"]) == code
    printed = capsys.readouterr()
    assert printed.err == ""
    return json.loads(printed.out)


def test_tables_and_pictures(folder, capsys, monkeypatch):
    # A shorter film than the default.
    from jaxcontact import plot

    whole = plot.animate
    monkeypatch.setattr(plot, "animate", lambda run, **how: whole(run, seconds=0.2, **how))
    line = "scene fall.toml --out results --plot results/run.png --animate film.gif"
    assert main(line.split()) == 0
    shown = capsys.readouterr()
    assert "completed" in shown.out and "ball - floor" in shown.out
    assert "compiling and running the scene" in shown.err
    names = ["impacts.csv", "run.csv", "run.png"]
    assert sorted(path.name for path in (folder / "results").iterdir()) == names
    assert all(f"results/{name}" in shown.out for name in names) and "film.gif" in shown.out
    rows, impacts = (pd.read_csv(f"results/{name}.csv") for name in ("run", "impacts"))
    assert rows.time.tolist() == pytest.approx([0, 0.1, 0.2, 0.3, 0.4, 0.5])
    assert rows["position[0,1]"][2] == pytest.approx(0.5 - 9.81 * 0.02)
    assert (impacts.first_name[0], impacts.second_name[0]) == ("ball", "floor")
    with Image.open("film.gif") as film, Image.open("results/run.png") as picture:
        assert film.n_frames == 5
        # A column of air is higher than wide.
        assert picture.height > picture.width > 1000


def test_nothing_is_written_unless_asked_for(folder, capsys):
    told = asked(capsys, "scene", "fall.toml")
    assert (told["status"], told["reached"], told["files"]) == ("COMPLETED", 0.5, [])
    touched = {told["bodies"][k] for k in told["impacts"]["second"]}
    assert touched == {"floor"} and len(told["impacts"]["time"]) == len(told["impacts"]["first"])
    assert [path.name for path in folder.iterdir()] == ["fall.toml"]


def test_a_run_that_stops_ends_with_1(folder, capsys):
    (folder / "few.toml").write_text("max_impacts = 1\n" + FALL.replace("0.5\n", "0.9\n", 1))
    assert main("scene few.toml --quiet --out . --plot run.png".split()) == 1
    shown = capsys.readouterr()
    assert "too many impacts" in shown.out
    assert shown.err == "no pictures: the run has no values to draw\n"
    names = ["fall.toml", "few.toml", "impacts.csv", "run.csv"]
    assert sorted(path.name for path in folder.iterdir()) == names


@pytest.mark.parametrize("name", ["box", "line", "table"])
def test_examples_are_shown_as_files_that_can_be_read(name, folder, capsys):
    assert main(["scene", "--example", name, "--show", "--quiet"]) == 0
    text = capsys.readouterr().out
    assert text.startswith("# ")
    (folder / "mine.toml").write_text(text)
    assert main("scene mine.toml --show --quiet".split()) == 0
    assert capsys.readouterr().out == text


def test_a_scene_becomes_the_model_of_an_engine(folder, capsys):
    soft = FALL.replace("instantaneous = true", "stiffness = 1e6").replace("times = 6", "times = 3")
    (folder / "soft.toml").write_text(soft)
    assert main("scene soft.toml --to lammps --out model --quiet".split()) == 0
    assert "mpirun" in capsys.readouterr().out
    model = sorted(path.name for path in (folder / "model").iterdir())
    assert model == ["scene.data", "scene.in"]
    # A step of a robot misses the tolerance, says so, and writes.
    robot = "scene soft.toml --to mujoco --time-step 0.0005 --out robot"
    told = asked(capsys, *robot.split(), code=1)
    assert told["expected_error"] > told["tolerance"] == 1e-3
    assert told["files"] == ["robot/scene.xml", "robot/run.py"]


# `jaxcontact sweep`: ranges, tables, maps, and refused input.

SAME = 1e-15  # the same impacts in other batches: measured 2e-16


BAD_RANGES = {
    "1:2": "neither a number nor of the form", "1:2:3:4": "neither", "1:2:3:log:5": "neither",
    "a:2:3": "'a' is not a number", "1:inf:3": "not a finite number",
    "1:2:0": "'0' in '1:2:0' is not a count", "1:2:2.5": "is not a count",
    "0:2:3:log": "must be positive to be spaced by a factor",
}  # fmt: skip


def test_ranges():
    assert span("0.5") == 0.5
    np.testing.assert_array_equal(span("0:1:5"), np.linspace(0, 1, 5))
    np.testing.assert_array_equal(span("0.01:10:4:log"), np.geomspace(0.01, 10, 4))
    name, values = assignment("c=1:2:2", span, "RANGE")
    assert name == "c" and list(values) == [1, 2]
    for text, words in BAD_RANGES.items():
        with pytest.raises(argparse.ArgumentTypeError, match=words):
            span(text)


def test_csv(tmp_path, capsys):
    out = tmp_path / "result.csv"
    line = "sweep --law hu_guo --e 0.3:1.1:5 --velocity 0.1:10:3:log --mass 2 --quiet --out"
    assert main([*line.split(), str(out)]) == 0
    rows = pd.read_csv(out)
    assert len(rows) == 15 and list(rows)[:3] == ["e", "velocity", "restitution"]
    good, bad = rows[rows.e <= 1], rows[rows.e > 1]
    assert set(good.status) == {"SEPARATED"} and set(bad.status) == {"INVALID_INPUT"}
    assert bad.duration.isna().all()
    hit = jc.impact(jc.HuGuo(e=good.e.to_numpy()), jc.Contact(2.0, 1e8), good.velocity.to_numpy())
    for name in ("duration", "max_force"):
        np.testing.assert_allclose(good[name], getattr(hit, name), rtol=SAME)
    text = capsys.readouterr()
    assert text.out.startswith("Sweep of hu_guo: e 5 × velocity 3, 15 lanes")
    assert "12 separated, 3 invalid_input" in text.out
    assert text.err == ""


def test_netcdf_and_map(tmp_path, capsys):
    xarray = pytest.importorskip("xarray")
    out, plot = tmp_path / "result.nc", tmp_path / "map.png"
    line = "sweep --law hu_guo --e 0.05:1:6 --velocity 0.01:10:4:log --field duration"
    assert main([*line.split(), "--out", str(out), "--plot", str(plot)]) == 0
    assert "compiling and solving 24 impacts" in capsys.readouterr().err
    with xarray.open_dataset(out, engine="scipy") as data:
        assert data.duration.dims == ("e", "velocity") and data.duration.attrs["units"] == "s"
        assert data.attrs["function"] == "hu_guo" and float(data.mass) == 1.0
    # As stated in the help: 6.4 in by 4.4 in, at 200 pixels an inch.
    assert plot.read_bytes()[:24] == b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR" + struct.pack(
        ">2I", 1280, 880
    )
    assert sorted(path.name for path in tmp_path.iterdir()) == ["map.png", "result.nc"]


def test_other_parameters(tmp_path, capsys):
    out = tmp_path / "result.csv"
    line = "sweep --law constant_damping --param c=1e6:1e7:2:log --exponent 1 --out"
    told = asked(capsys, *line.split(), str(out))
    assert told["axes"]["c"] == pytest.approx([1e6, 1e7]) and told["status"] == {"SEPARATED": 2}
    assert (told["files"], told["complete"]) == ([str(out)], True)
    rows = out.read_text().splitlines()
    assert rows[0].startswith("c,restitution") and len(rows) == 3


def test_netcdf_without_xarray(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert main(["sweep", "--law=hu_guo", "--e=.5", "--quiet", f"--out={tmp_path}/a.nc"]) == 2
    assert "needs xarray (pip install 'jaxcontact[data]')" in capsys.readouterr().err


FAR = ["1e-300", "1e300", "5e-324", "1.7e308"]


@pytest.mark.parametrize("option", ["mass", "stiffness", "velocity"])
def test_extreme_numbers_end_in_a_sentence(option, tmp_path, capsys):
    """The last digit of a number may lie outside what doubles hold: that is said, not hidden."""
    at = {"mass": "1", "stiffness": "1e8", "velocity": "1"}
    for far in FAR:
        given = [f"--{name}={far if name == option else x}" for name, x in at.items()]
        code = main(["impact", "--law", "hu_guo", "--e", "0.5", *given])
        shown = capsys.readouterr()
        assert (code, "nan" in shown.out, "inf" in shown.out) == (code, False, False)
        assert code == 0 or (code == 2 and shown.err.splitlines()[-1].startswith("error: "))
    out, plot = tmp_path / "x.csv", tmp_path / "x.png"
    line = f"sweep --law hu_guo --e 0.5 --{option} 5e-324:1.7e308:5:log --quiet"
    code = main([*line.split(), "--out", str(out), "--plot", str(plot)])
    shown = capsys.readouterr().out
    rows = pd.read_csv(out)
    beyond = (~np.isfinite(rows[rows.status == "SEPARATED"][FIELDS])).any(axis=1).sum()
    assert (code, "too large for double precision" in shown) == (int(beyond > 0), beyond > 0)
    assert plot.stat().st_size > 0


FIELDS = ["duration", "compression_time", "max_indentation", "max_force", "energy_loss"]


def test_a_number_that_stands_in_many_rows_is_the_same_in_all(tmp_path):
    """Columns of fewer dimensions are turned into text once; masks and strings as well."""

    def function(e, v):
        hit = jc.impact(jc.HuGuo(e=e), jc.Contact(1.0, 1e8), v)
        return {"hit": hit.duration, "e": hit.restitution, "pair": np.array([1.0, 2.0]) * v}

    axes = {"e": [0.3, 1.5, 0.9], "v": np.append(np.linspace(-1, 1, 6000), 0.1)}
    table = jc.sweep(function, **axes)
    table.to_csv(tmp_path / "x.csv")
    rows = np.loadtxt(tmp_path / "x.csv", str, delimiter=",")
    assert (",".join(rows[0]), len(rows)) == ("e,v,hit,e,pair[0],pair[1],status", 18004)
    e, v = np.meshgrid(axes["e"], axes["v"], indexing="ij")
    columns = [e, v, table["hit"], table["e"], *np.moveaxis(table["pair"], -1, 0)]
    np.testing.assert_array_equal(rows[1:, :6].astype(float).T, np.reshape(columns, (6, -1)))
    names = [jc.Status(code).name for code in table.status.ravel().tolist()]
    assert rows[1:, 6].tolist() == names
