"""Tasks of a new user with a ball and a simulator, from README and docs alone.

Each is one command, or at most ten lines of Python. The recordings are simulated from a ball of
known restitution.
"""

from __future__ import annotations

import json
import shlex

import numpy as np
import pytest

from benchmarks.lab import tracks
from benchmarks.lab.sound import as_wave, draw
from jaxcontact.lab.cli import main
from tests.lab.sources import german, lines, workbook, written

E = 0.8
GRAVITY = 9.81
RANDOM = np.random.default_rng(7)
SPEED = np.geomspace(0.5, 4.0, 24)
SCATTERED = E * (1 + 0.01 * RANDOM.normal(size=24))
ROWS = np.stack([SPEED, SCATTERED], axis=1)
HEIGHTS = np.stack([np.linspace(20, 150, 24), np.linspace(20, 150, 24) * SCATTERED**2], axis=1)

CLEAR = 4  # the draw of a sound with a clear drop: e = 0.64, 37 dB over the noise
TRACKED = 705  # the draw of a track with five impacts, e = 0.84, at 120 frames per second
FEW_ERRORS = 4.0  # standard errors: one draw in 16,000 is farther off, and these draws are fixed


def intervals() -> str:
    """Times between twelve impacts of a drop from 0.8 m, each error 1 %, in a column."""
    first = 2 * E * np.sqrt(2 * 0.8 / GRAVITY)
    scatter = np.cumprod(np.r_[1, 1 + 0.01 * RANDOM.normal(size=11)])
    return "".join(f"{t:.5f}\n" for t in first * E ** np.arange(12) * scatter)


LONE = intervals()
SAVED = {
    "decimal comma": lines("speed (mm/s);COR", ROWS * [1000, 1], ";", number=german),
    "UTF-16 of a spreadsheet": lines("h0 / cm\th1 / cm", HEIGHTS, "\t").encode("utf-16"),
    "one column of intervals": f"interval_s\n{LONE}",
    "a workbook": workbook(
        ("about", [["made on Monday"]]), ("runs", [["v (m/s)", "COR"], *ROWS.tolist()])
    ),
}


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    """The exit code of a command in an empty folder, and what it printed."""
    monkeypatch.chdir(tmp_path)

    def told(command: str) -> tuple[int, str, str]:
        before = capsys.readouterr()
        assert not before.err, "what came before said something"
        program, *words = shlex.split(command)
        assert program == "jaxcontact"
        code = main(words)
        printed = capsys.readouterr()
        return code, printed.out, printed.err

    return told


def calibrated(run, command: str) -> dict:
    code, out, err = run(f"jaxcontact calibrate {command} --quiet --json")
    assert (code, err) == (0, "")
    return json.loads(out)


def assert_delivers(data: dict, truth: float = E) -> None:
    e = next(one for one in data["choice"]["laws"][0]["estimates"] if one["name"] == "e")
    assert abs(e["value"] - truth) < FEW_ERRORS * e["standard_error"] < 0.05


@pytest.mark.parametrize("content", SAVED)
def test_a_file_as_it_was_saved(content, run, tmp_path):
    written(tmp_path, "ball.csv", SAVED[content])
    assert_delivers(calibrated(run, "ball.csv"))


REFUSED = {
    "a column without a heading": (LONE, "heights intervals --columns", "'interval [s]=1'"),
    "percent": (lines("speed,e", ROWS * [1, 100]), "percent 100", "'e [%]=2,speed=1'"),
}


@pytest.mark.parametrize("content", REFUSED)
def test_what_is_refused_is_read_as_the_message_says(content, run, tmp_path):
    text, words, columns = REFUSED[content]
    (tmp_path / "ball.csv").write_text(text)
    code, _, err = run("jaxcontact calibrate ball.csv")
    assert code == 2 and all(word in err for word in words.split())
    assert_delivers(calibrated(run, f"ball.csv --columns {columns}"))


def test_a_sound(run, tmp_path):
    truth = draw(np.random.default_rng([0, CLEAR]))
    (tmp_path / "bounce.wav").write_bytes(as_wave(truth))
    assert_delivers(calibrated(run, "bounce.wav --law constant_damping"), truth.e)
    assert (tmp_path / "sound.png").exists()


def test_a_video(run, tmp_path):
    truth = tracks.draw(np.random.default_rng([0, TRACKED]), kind="trackpy")
    (tmp_path / "ball.csv").write_text(truth.text)
    options = "--rate 120 --law constant_damping"
    code, _, err = run("jaxcontact calibrate ball.csv --quiet")
    assert code == 2 and "give the frames per second as --rate" in err
    assert_delivers(calibrated(run, f"ball.csv {options} --report ball.html"), truth.e)
    assert (tmp_path / "track.png").read_bytes().startswith(b"\x89PNG")
    text = (tmp_path / "ball.html").read_text()
    assert "The track, with the parabolas between impacts" in text and "5 impacts in 1 drop" in text


def test_into_the_simulator(run, tmp_path):
    written(tmp_path, "ball.csv", SAVED["decimal comma"])
    assert run("jaxcontact calibrate ball.csv --mass 1 --stiffness 1e6 --quiet")[0] == 0
    command = "jaxcontact export --from calibration.json --velocity 2 --engine mujoco --quiet"
    code, out, err = run(command)
    assert (code, err) == (0, "") and '<option timestep="' in out and '<geom solref="' in out
