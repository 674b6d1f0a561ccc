"""`jaxcontact impact`, the entry point itself, and the installed command."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from jaxcontact.lab.cli import main

EXAMPLE = "impact --law hu_guo --e 0.7 --mass 1 --stiffness 1.4e8 --velocity 4.2 --quiet".split()
ROOT = Path(__file__).parents[3]

LOSS = 1e-12  # energy loss against ½ m v² (1-e²), the same numbers in another order: measured 2e-16


def test_the_example(capsys):
    assert main([*EXAMPLE, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    # α = 9/14 delivers this e, by 40-digit arithmetic to four digits.
    np.testing.assert_allclose(found["restitution"], 0.6973, atol=5.1e-5)
    e = found["restitution"]
    np.testing.assert_allclose(found["rebound_velocity"], 4.2 * e, rtol=LOSS)
    np.testing.assert_allclose(found["energy_loss"], 0.5 * 4.2**2 * (1 - e**2), rtol=LOSS)
    assert found["status"] == "SEPARATED" and found["units"]["duration"] == "s"
    assert 0 < found["compression_time"] < found["duration"]


def test_the_text_and_a_figure(tmp_path, capsys):
    path = tmp_path / "figure.svg"
    assert main([*EXAMPLE, "--plot", str(path)]) == 0
    out = capsys.readouterr().out
    assert all(words in out for words in ("parameter e       0.7\n", "restitution       0.697"))
    assert "separated" in out and path.read_bytes().startswith(b"<?xml")
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_numbers_without_a_course_to_draw(tmp_path, capsys):
    stiff = "impact --law damped --param alpha=1e200 --mass 1 --stiffness 1e4 --velocity 1 --quiet"
    assert main([*stiff.split(), "--plot", str(tmp_path / "a.png")]) == 1
    shown = capsys.readouterr()
    assert shown.err.startswith("no picture: ") and "not_converged" in shown.err
    assert "status            separated" in shown.out and not list(tmp_path.iterdir())


def test_a_reader_that_leaves_is_no_error(monkeypatch, capsys):
    reader, writer = os.pipe()
    os.close(reader)
    # Its end writes what is left, as that of Python does.
    with os.fdopen(writer, "w") as out:
        monkeypatch.setattr(sys, "stdout", out)
        assert main(EXAMPLE) == 0
    monkeypatch.undo()
    assert capsys.readouterr() == ("", "")


def test_the_module_is_the_command():
    words = [sys.executable, "-W", "error", "-m", "jaxcontact", *EXAMPLE, "--json"]
    run = subprocess.run(words, capture_output=True, text=True, cwd=ROOT, timeout=120)
    assert run.returncode == 0, run.stderr
    assert run.stderr == ""
    found = json.loads(run.stdout)
    # The command uses double precision; float32 would have other last digits.
    e = found["restitution"]
    np.testing.assert_allclose(found["energy_loss"], 0.5 * 4.2**2 * (1 - e**2), rtol=LOSS)
