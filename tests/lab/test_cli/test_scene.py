"""`jaxcontact scene`: files, examples, tables and pictures, and refused input."""

import json

import pandas as pd
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
    line = "scene fall.toml --out results --plot results/run.png --animate film.gif"
    assert main(line.split()) == 0
    shown = capsys.readouterr()
    assert "completed" in shown.out and "ball - floor" in shown.out
    assert "compiling and running the scene" in shown.err
    names = ["impacts.csv", "run.csv", "run.png"]
    assert sorted(path.name for path in (tmp_path / "results").iterdir()) == names
    assert all(f"results/{name}" in shown.out for name in names) and "film.gif" in shown.out
    rows, impacts = (pd.read_csv(f"results/{name}.csv") for name in ("run", "impacts"))
    assert rows.time.tolist() == pytest.approx([0, 0.1, 0.2, 0.3, 0.4, 0.5])
    assert rows["position[0,1]"][2] == pytest.approx(0.5 - 9.81 * 0.02)
    assert (impacts.first_name[0], impacts.second_name[0]) == ("ball", "floor")
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


def test_a_scene_becomes_the_model_of_an_engine(tmp_path, capsys):
    soft = FALL.replace("instantaneous = true", "stiffness = 1e6").replace("times = 6", "times = 3")
    (tmp_path / "soft.toml").write_text(soft)
    assert main("scene soft.toml --to lammps --out model --quiet".split()) == 0
    assert "mpirun" in capsys.readouterr().out
    model = sorted(path.name for path in (tmp_path / "model").iterdir())
    assert model == ["scene.data", "scene.in"]
    # A step of a robot misses the tolerance, says so, and writes.
    robot = "scene soft.toml --to mujoco --time-step 0.0005 --out robot --quiet --json"
    assert main(robot.split()) == 1
    told = json.loads(capsys.readouterr().out)
    assert told["expected_error"] > told["tolerance"] == 1e-3
    assert told["files"] == ["robot/scene.xml", "robot/run.py"]
