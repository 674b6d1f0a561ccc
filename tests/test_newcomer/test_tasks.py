"""Fourteen tasks of a new user with a ball and a simulator, from README and docs alone.

Each is one command, or at most ten lines of Python. The recordings are simulated from a ball of
known restitution.
"""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import numpy as np
import openpyxl
import pandas as pd
import pytest

import jaxcontact as jc
from benchmarks import track_truths
from benchmarks.record_truths import impact
from benchmarks.sound_truths import as_wave, draw
from jaxcontact._cli import main

E = 0.8
GRAVITY = 9.81
RANDOM = np.random.default_rng(7)
SPEED = np.geomspace(0.5, 4.0, 24)
SCATTERED = E * (1 + 0.01 * RANDOM.normal(size=24))
ROWS = np.stack([SPEED, SCATTERED], axis=1)

CLEAR = 4
"""The draw of a sound with a clear drop: e = 0.64, 37 dB over the noise."""

TRACKED = 705
"""The draw of a track with five impacts, e = 0.84, at 120 frames per second."""

FEW_ERRORS = 4.0
"""Standard errors: one draw in 16,000 is farther off, and these draws are fixed."""


def intervals(drops: int = 3, bounces: int = 9) -> list[list[float]]:
    """Times between the impacts of drops from about a metre, each error 1 %."""
    found = []
    for height in np.linspace(0.8, 1.2, drops):
        first = 2 * E * np.sqrt(2 * height / GRAVITY)
        scatter = np.cumprod(np.r_[1, 1 + 0.01 * RANDOM.normal(size=bounces - 1)])
        found.append((first * E ** np.arange(bounces) * scatter).tolist())
    return found


def text_of(rows: np.ndarray, heading: str, separator: str, mark: str = ".") -> str:
    lines = (separator.join(f"{x:.5f}".replace(".", mark) for x in row) for row in rows)
    return "\n".join([heading, *lines]) + "\n"


def decimal_comma() -> bytes:
    scaled = ROWS * [1000, 1]
    return text_of(scaled, "speed (mm/s);COR", ";", ",").encode()


def utf_16_of_a_spreadsheet() -> bytes:
    drop = np.linspace(20, 150, 24)
    rows = np.stack([drop, drop * SCATTERED**2], axis=1)
    return text_of(rows, "h0 / cm\th1 / cm", "\t").encode("utf-16")


def one_column_of_intervals() -> bytes:
    return ("interval_s\n" + "\n".join(f"{t:.5f}" for t in intervals(1, 12)[0]) + "\n").encode()


def lone_column() -> bytes:
    return one_column_of_intervals().split(b"\n", 1)[1]


def percent() -> bytes:
    return text_of(ROWS * [1, 100], "speed,e", ",").encode()


def notes_of_a_laboratory() -> bytes:
    table = text_of(ROWS, '"v [m/s]","e"', ",").replace("\n", "\r\n", 4)
    return ("# Kugel 3, Höhe 2 m über dem Boden\r\n\r\n" + table).encode("latin-1")


def kilometres_an_hour() -> bytes:
    rows = np.stack([3.6 * SPEED, 3.6 * SPEED * SCATTERED], axis=1)
    return text_of(rows, "v_in [km/h];v_out [km/h]", ";").encode()


def workbook(file: Path) -> None:
    book = openpyxl.Workbook()
    book.active.append(["made on Monday"])
    sheet = book.create_sheet("runs")
    sheet.append(["v (m/s)", "COR"])
    for row in ROWS.tolist():
        sheet.append(row)
    book.save(file)


def run(command: str, folder: Path, capsys: pytest.CaptureFixture) -> tuple[int, str, str]:
    """The exit code of a command in a folder, and what it printed."""
    before = capsys.readouterr()
    assert not before.err, "what came before said something"
    program, *words = shlex.split(command)
    assert program == "jaxcontact"
    code = main(words)
    printed = capsys.readouterr()
    return code, printed.out, printed.err


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def assert_delivers(estimates: list[dict]) -> None:
    e = next(one for one in estimates if one["name"] == "e")
    assert abs(e["value"] - E) < FEW_ERRORS * e["standard_error"] < 0.05


def assert_calibrates(command: str, folder: Path, capsys: pytest.CaptureFixture) -> None:
    code, out, err = run(f"{command} --quiet --json", folder, capsys)
    assert (code, err) == (0, "")
    assert_delivers(json.loads(out)["choice"]["laws"][0]["estimates"])


@pytest.mark.parametrize(
    "content",
    [
        decimal_comma,
        utf_16_of_a_spreadsheet,
        one_column_of_intervals,
        notes_of_a_laboratory,
        kilometres_an_hour,
    ],
)
def test_a_file_as_it_was_saved(content, here, capsys):
    (here / "ball.csv").write_bytes(content())
    assert_calibrates("jaxcontact calibrate ball.csv", here, capsys)


def test_a_column_without_a_heading(here, capsys):
    (here / "ball.txt").write_bytes(lone_column())
    code, _, err = run("jaxcontact calibrate ball.txt", here, capsys)
    assert code == 2 and "heights" in err and "intervals" in err and "--columns" in err
    assert_calibrates("jaxcontact calibrate ball.txt --columns 'interval [s]=1'", here, capsys)


def test_percent(here, capsys):
    (here / "ball.csv").write_bytes(percent())
    code, _, err = run("jaxcontact calibrate ball.csv", here, capsys)
    assert code == 2 and "in percent" in err and "100" in err
    assert_calibrates("jaxcontact calibrate ball.csv --columns 'e [%]=2,speed=1'", here, capsys)


def test_a_workbook(here, capsys):
    workbook(here / "ball.xlsx")
    assert_calibrates("jaxcontact calibrate ball.xlsx", here, capsys)


def test_a_parquet_file(here, capsys):
    pd.DataFrame({"velocity": SPEED, "restitution": SCATTERED}).to_parquet(here / "ball.parquet")
    assert_calibrates("jaxcontact calibrate ball.parquet", here, capsys)


def test_a_frame_in_a_notebook():
    frame = pd.DataFrame({"v (m/s)": SPEED, "COR": SCATTERED})
    found = jc.calibrate(jc.read_recording(frame))
    e = found.choice.laws[0].estimates[0]
    assert e.name == "e" and abs(e.value - E) < FEW_ERRORS * e.standard_error


def test_a_sound(here, capsys):
    truth = draw(np.random.default_rng([0, CLEAR]))
    (here / "bounce.wav").write_bytes(as_wave(truth))
    code, out, err = run("jaxcontact calibrate bounce.wav --quiet --json", here, capsys)
    assert (code, err) == (0, "") and (here / "sound.png").exists()
    e = json.loads(out)["choice"]["laws"][0]["estimates"][0]
    assert abs(e["value"] - truth.e) < FEW_ERRORS * e["standard_error"] < 0.05


def test_a_video(here, capsys):
    truth = track_truths.draw(np.random.default_rng([0, TRACKED]), kind="trackpy")
    (here / "ball.csv").write_text(truth.text)
    command = "jaxcontact calibrate ball.csv --rate 120 --quiet --json"
    code, out, err = run(command, here, capsys)
    assert (code, err) == (0, "") and (here / "track.png").exists()
    e = json.loads(out)["choice"]["laws"][0]["estimates"][0]
    assert abs(e["value"] - truth.e) < FEW_ERRORS * e["standard_error"] < 0.05


@pytest.mark.slow(reason="a fit to a record, 25 s of CPU; test_records has the same from Python")
def test_a_force_plate(here, capsys):
    clock = np.arange(0, 0.06, 2e-5)
    time, force, after = impact(0.05, 2e6, 0.15, 2.0)
    reading = 7 - np.interp(clock - 0.02, time, force, left=0, right=0)
    reading += np.random.default_rng(4).normal(size=clock.size)
    rows = np.stack([1e3 * clock, reading], axis=1)
    (here / "plate.csv").write_text(text_of(rows, "Time (ms);Fz (N)", ";", ","))
    code, out, err = run("jaxcontact calibrate plate.csv --mass 0.05 --quiet --json", here, capsys)
    assert (code, err) == (0, "") and (here / "record.png").exists()
    one = json.loads(out)["impacts"][0]
    for name, truth in (("velocity", 2.0), ("restitution", after / 2), ("stiffness", 2e6)):
        assert abs(one[name] - truth) < FEW_ERRORS * one[f"{name}_error"] < 0.2 * truth


def test_into_the_simulator(here, capsys):
    (here / "ball.csv").write_bytes(decimal_comma())
    code, _, _ = run("jaxcontact calibrate ball.csv --mass 1 --stiffness 1e6 --quiet", here, capsys)
    assert code == 0
    command = "jaxcontact export --from calibration.json --velocity 2 --engine mujoco --quiet"
    code, out, err = run(command, here, capsys)
    assert (code, err) == (0, "") and '<option timestep="' in out and '<geom solref="' in out
