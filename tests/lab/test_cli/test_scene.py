"""`jaxcontact scene`: files, examples, tables and pictures, and refused input."""

import csv
import json

import pytest
from PIL import Image

from jaxcontact.lab.cli import main

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


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "fall.toml").write_text(FALL)


def test_tables_and_pictures(tmp_path, capsys, monkeypatch):
    # A shorter film than the default.
    from jaxcontact import plot

    whole = plot.animate
    monkeypatch.setattr(plot, "animate", lambda run, **how: whole(run, seconds=0.2, **how))
    assert (
        main("scene fall.toml --out results --plot results/run.png --animate film.gif".split()) == 0
    )
    shown = capsys.readouterr()
    assert "completed" in shown.out and "ball - floor" in shown.out
    assert "compiling and running the scene" in shown.err
    names = ["impacts.csv", "run.csv", "run.png"]
    assert sorted(path.name for path in (tmp_path / "results").iterdir()) == names
    assert all(f"results/{name}" in shown.out for name in names) and "film.gif" in shown.out
    with open("results/run.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["time"]) for row in rows] == pytest.approx([0, 0.1, 0.2, 0.3, 0.4, 0.5])
    assert float(rows[2]["position[0,1]"]) == pytest.approx(0.5 - 9.81 * 0.02)
    with open("results/impacts.csv", newline="") as file:
        (row, *_) = csv.DictReader(file)
    assert (row["first_name"], row["second_name"]) == ("ball", "floor")
    with Image.open("film.gif") as film, Image.open("results/run.png") as picture:
        assert film.n_frames == 5
        # A column of air is higher than wide.
        assert picture.height > picture.width > 1000


def test_nothing_is_written_unless_asked_for(tmp_path, capsys):
    assert main("scene fall.toml --quiet --json".split()) == 0
    shown = capsys.readouterr()
    assert shown.err == ""
    told = json.loads(shown.out)
    assert (told["status"], told["reached"], told["files"]) == ("COMPLETED", 0.5, [])
    touched = {told["bodies"][k] for k in told["impacts"]["second"]}
    assert touched == {"floor"} and len(told["impacts"]["time"]) == len(told["impacts"]["first"])
    assert [path.name for path in tmp_path.iterdir()] == ["fall.toml"]


def test_a_run_that_stops_ends_with_1(tmp_path, capsys):
    (tmp_path / "few.toml").write_text("max_impacts = 1\n" + FALL.replace("0.5\n", "0.9\n", 1))
    assert main("scene few.toml --quiet --out . --plot run.png".split()) == 1
    shown = capsys.readouterr()
    assert "too many impacts" in shown.out
    assert shown.err == "no pictures: the run has no values to draw\n"
    names = ["fall.toml", "few.toml", "impacts.csv", "run.csv"]
    assert sorted(path.name for path in tmp_path.iterdir()) == names


@pytest.mark.parametrize("name", ["box", "line", "table"])
def test_examples_are_shown_as_files_that_can_be_read(name, tmp_path, capsys):
    assert main(["scene", "--example", name, "--show", "--quiet"]) == 0
    text = capsys.readouterr().out
    assert text.startswith("# ")
    (tmp_path / "mine.toml").write_text(text)
    assert main("scene mine.toml --show --quiet".split()) == 0
    assert capsys.readouterr().out == text


BAD = {
    "nothing": ("", "give either a FILE or --example box, line, table"),
    "both": ("fall.toml --example line", "give either a FILE or --example"),
    "example": ("--example cradle", "--example must be one of 'box', 'line', 'table', but is"),
    "no file": ("none.toml", "none.toml"),
    "folder": ("fall.toml --out fall.toml", "--out fall.toml is not a folder"),
    "picture": ("fall.toml --plot run.jpg", "--plot run.jpg: the name must end in .png, .pdf or"),
    "film": ("fall.toml --animate run.mp4", "--animate run.mp4: the name must end in .gif"),
    "axes": ("fall.toml --plot run.png --axes xz", "--axes must be xy or yx, but is xz"),
    "content": ("bad.toml", "bad.toml, at the top: the key 'duration' must be given"),
    "late": ("late.toml", "late.toml: Argument `rtol` must be a number in (0, 1), but is 2"),
    "model": ("fall.toml --to lammps", "--to needs --out"),
    "model and picture": ("fall.toml --to lammps --out x --plot a.png", "--to makes none"),
    "step": ("fall.toml --time-step 0.1", "--to, which is missing"),
    "tolerance": ("fall.toml --tolerance 0.1", "--to, which is missing"),
    "hard": ("fall.toml --to lammps --out x", "must have a `stiffness`"),
    "engine": ("fall.toml --to yade --out x", "must be one of"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_refused(case, tmp_path, capsys):
    (tmp_path / "bad.toml").write_text(FALL.replace("duration", "# duration"))
    (tmp_path / "late.toml").write_text("rtol = 2\n" + FALL)
    before = sorted(tmp_path.iterdir())
    options, words = BAD[case]
    assert main(["scene", "--quiet", *options.split()]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ") and words in error
    assert sorted(tmp_path.iterdir()) == before


def test_a_scene_becomes_the_model_of_an_engine(tmp_path, capsys):
    soft = FALL.replace("instantaneous = true", "stiffness = 1e6").replace("times = 6", "times = 3")
    (tmp_path / "soft.toml").write_text(soft)
    assert main("scene soft.toml --to lammps --out model --quiet".split()) == 0
    assert "mpirun" in capsys.readouterr().out
    assert sorted(path.name for path in (tmp_path / "model").iterdir()) == [
        "scene.data",
        "scene.in",
    ]
    # A step of a robot misses the tolerance, says so, and writes.
    robot = "scene soft.toml --to mujoco --time-step 0.0005 --out robot --quiet --json"
    assert main(robot.split()) == 1
    told = json.loads(capsys.readouterr().out)
    assert told["expected_error"] > told["tolerance"] == 1e-3
    assert told["files"] == ["robot/scene.xml", "robot/run.py"]
