"""`jaxcontact impact`, the entry point itself, and the installed command."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from jaxcontact._cli import main

EXAMPLE = "impact --law hu_guo --e 0.7 --mass 1 --stiffness 1.4e8 --velocity 4.2 --quiet".split()

LOSS = 1e-12
"""Energy loss against ½ m v² (1-e²), the same numbers in another order: measured 2e-16."""


def numbers(capsys, *arguments):
    assert main([*arguments, "--json", "--quiet"]) == 0
    return json.loads(capsys.readouterr().out)


def test_the_example(capsys):
    found = numbers(capsys, *EXAMPLE)
    # α = 9/14 delivers this e, by 40-digit arithmetic to four digits.
    np.testing.assert_allclose(found["restitution"], 0.6973, atol=5.1e-5)
    e = found["restitution"]
    np.testing.assert_allclose(found["rebound_velocity"], 4.2 * e, rtol=LOSS)
    np.testing.assert_allclose(found["energy_loss"], 0.5 * 4.2**2 * (1 - e**2), rtol=LOSS)
    assert found["status"] == "SEPARATED"
    assert found["units"]["duration"] == "s"
    assert 0 < found["compression_time"] < found["duration"]


def test_the_text(capsys):
    assert main(EXAMPLE) == 0
    out = capsys.readouterr().out
    assert "parameter e       0.7\n" in out
    assert "restitution       0.697" in out
    assert "separated" in out


def test_other_parameters(capsys):
    contact = ("--mass", "1", "--stiffness", "1e8", "--velocity", "2")
    half = numbers(capsys, "impact", "--law", "constant_damping", "--param", "c=2.5e7", *contact)
    damped = numbers(capsys, "impact", "--law", "damped", "--param", "alpha=0.5", *contact)
    # α = c v/K = 0.5 is the same impact.
    np.testing.assert_allclose(half["restitution"], damped["restitution"], rtol=1e-12)
    assert half["parameters"] == {"c": 2.5e7}


@pytest.mark.parametrize("suffix", ["png", "svg", "pdf"])
def test_a_figure(tmp_path, suffix):
    path = tmp_path / f"figure.{suffix}"
    assert main([*EXAMPLE, "--plot", str(path)]) == 0
    start = path.read_bytes()[:8]
    assert start.startswith({"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}[suffix])
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_numbers_without_a_course_to_draw(tmp_path, capsys):
    stiff = "impact --law damped --param alpha=1e200 --mass 1 --stiffness 1e4 --velocity 1 --quiet"
    assert main([*stiff.split(), "--plot", str(tmp_path / "a.png")]) == 1
    shown = capsys.readouterr()
    assert shown.err.startswith("no picture: ") and "not_converged" in shown.err
    assert "status            separated" in shown.out and not list(tmp_path.iterdir())


BAD = {
    "law": ("--law=nonsense --e=.5", "not a law; the laws are"),
    "no e": ("--law=hu_guo", "hu_guo also needs --e E"),
    "no c": ("--law=constant_damping", "also needs --param c=NUMBER"),
    "wrong parameter": ("--law=hu_guo --e=.5 --param=c=1", "has no parameter c; its parameters: e"),
    "e not wanted": ("--law=damped --e=.5", "has no parameter e; its parameters: alpha"),
    "twice": ("--law=damped --param=alpha=1 --param=alpha=2", "given twice"),
    "e twice": ("--law=hu_guo --e=.5 --param=e=.6", "already given by --e"),
    "range": ("--law=hu_guo --e=1.5", "`e` must be in"),
    "exponent": ("--law=tsuji --e=.5 --exponent=1", "tsuji is made for 1.5"),
    "slow": ("--law=hu_guo --e=.5 --velocity=1e-12", "`velocity` must be in [1e-09, inf)"),
    "suffix": ("--law=hu_guo --e=.5 --plot=x.doc", "must end in .png, .pdf or .svg"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_refused(case, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    options, message = BAD[case]
    contact = ["--mass=1", "--stiffness=1e8", "--velocity=1"]
    assert main(["impact", *contact, *options.split(), "--quiet"]) == 2
    printed = capsys.readouterr()
    assert printed.err.startswith("error: ")
    assert message in printed.err
    assert printed.out == ""
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("option", ["--mass=-1", "--stiffness=0", "--velocity=nan", "--e=x"])
def test_bad_numbers_are_refused(option, capsys):
    with pytest.raises(SystemExit) as caught:
        main([*EXAMPLE, option])
    assert caught.value.code == 2
    assert option.split("=")[0] in capsys.readouterr().err


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ([], ("calibrate", "laws", "impact", "exit codes")),
        (
            ["calibrate"],
            tuple(
                "--law --ball --out --gravity --mass --radius --drag-coefficient --air-density "
                "--stiffness --quiet interval_s rebound_height_m".split()
            ),
        ),
        (["laws"], ("--json",)),
        (["impact"], ("--law", "--e ", "--param", "--exponent", "--json", "--plot", "N/mⁿ")),
    ],
)
def test_help_is_complete(command, words, capsys):
    with pytest.raises(SystemExit) as caught:
        main([*command, "--help"])
    assert caught.value.code == 0
    out = capsys.readouterr().out
    for word in words:
        assert word in out


def test_no_command_is_an_error(capsys):
    with pytest.raises(SystemExit) as caught:
        main([])
    assert caught.value.code == 2
    assert "COMMAND" in capsys.readouterr().err


def test_a_reader_that_leaves_is_no_error():
    with subprocess.Popen(
        [sys.executable, "-W", "error", "-m", "jaxcontact", *EXAMPLE],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        cwd=Path(__file__).parents[2],
    ) as run:
        assert run.stdout is not None
        assert run.stderr is not None
        run.stdout.close()
        assert run.stderr.read() == b""
        assert run.wait(timeout=120) == 0


def test_the_module_is_the_command():
    root = Path(__file__).parents[2]
    run = subprocess.run(
        [sys.executable, "-W", "error", "-m", "jaxcontact", *EXAMPLE, "--json"],
        capture_output=True,
        text=True,
        cwd=root,
        timeout=120,
    )
    assert run.returncode == 0, run.stderr
    assert run.stderr == ""
    found = json.loads(run.stdout)
    # The command uses double precision; float32 would have other last digits.
    e = found["restitution"]
    np.testing.assert_allclose(found["energy_loss"], 0.5 * 4.2**2 * (1 - e**2), rtol=LOSS)
