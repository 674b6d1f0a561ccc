"""All commands have one style: options, JSON, exit codes, messages, completion.

The figures and numbers of `jaxcontact paper`.
"""

import argparse
import importlib.resources
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import jaxcontact as jc
from benchmarks.lab.tracks import draw
from jaxcontact import paper
from jaxcontact._laws import list_laws
from jaxcontact.extend import constant_laws
from jaxcontact.lab.cli import _COMMANDS, _parser, main
from jaxcontact.lab.cli.commands.laws import table
from tests.lab.test_cli.test_scene import FALL, asked

E = [0.9, 0.85, 0.8, 0.78]
V = [0.5, 1.0, 2.0, 3.0]

TRACKED = 705  # the draw of a track with five impacts, e = 0.84, at 120 frames per second


def test_help_and_version_do_not_wait_for_jax():
    code = (
        "import sys\nfrom jaxcontact.lab.cli import main\n"
        "for option in ('--help', '--version'):\n"
        "    try:\n        main([option])\n    except SystemExit as end:\n"
        "        assert end.code == 0\n"
        "assert not {'jax', 'numpy', 'matplotlib'} & set(sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    for words in (f"jaxcontact {jc.__version__}", "130 interrupted", *_COMMANDS):
        assert words in done.stdout


OPTIONS = {
    "calibrate": "--law --ball --out --gravity --mass --radius --drag-coefficient --air-density "
    "--stiffness interval_s rebound_height_m",
    "impact": "--law --e --param --exponent --plot N/mⁿ",
}


@pytest.mark.parametrize("name", _COMMANDS)
def test_every_command_has_the_same_options_and_says_its_exit_codes(name, capsys):
    with pytest.raises(SystemExit) as caught:
        main([name, "--help"])
    assert caught.value.code == 0
    told = capsys.readouterr().out
    assert "options of every command" in told and "exit codes: 0 done" in told
    own = OPTIONS.get(name, "").split()
    assert all(option in told for option in ("--json", "--quiet", "--no-cache", *own))
    # One name per concept.
    kinds = {"--law": "NAME", "--mass": "KG", "--stiffness": "K", "--e": "E", "--ball": "NAME"}
    (commands,) = (a for a in _parser()._actions if isinstance(a, argparse._SubParsersAction))
    for action in commands.choices[name]._actions:
        for option in set(action.option_strings) & set(kinds):
            assert action.metavar == kinds[option]


CONTACT = "--mass=1 --stiffness=1e6"
LAW = f"--law=hu_guo --e=0.7 {CONTACT}"
HIT = f"{CONTACT} --velocity=1"
EXAMPLE = "impact --law hu_guo --e 0.7 --mass 1 --stiffness 1.4e8 --velocity 4.2 --quiet"
ROOT = Path(__file__).parents[3]

SAID = {
    "calibrat": "did you mean calibrate?",
    "impact --velociti 3": "unknown: --velociti; did you mean --velocity?",
    "calibrate --collumns=v=1": "unknown: --collumns=v=1; did you mean --columns?",
    "laws more": "unknown: more",
    "fit impact x.csv": "did you mean impacts?",
    "export --engine drake --velocity fast": "argument --velocity: 'fast' is not a",
    "": "the following arguments are required: COMMAND",
}
SAID |= {
    f"calibrate --{name}={value}": f"argument --{name}"
    for name in ("gravity", "mass", "radius", "stiffness")
    for value in ("-1", "0", "nan", "inf", "x")
}
SAID |= {
    f"impact {LAW} --velocity=1 --{name}={value}": f"argument --{name}"
    for name, value in (("mass", "-1"), ("stiffness", "0"), ("velocity", "nan"), ("e", "x"))
}


@pytest.mark.parametrize("words", SAID)
def test_what_is_not_understood_is_told_with_a_suggestion(words, capsys):
    with pytest.raises(SystemExit) as caught:
        main(words.split())
    assert caught.value.code == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith("error: ") and SAID[words] in printed.err
    assert "--help` lists all options" in printed.err


INTERVALS = "ball,drop_height_m,trial,bounce,interval_s\n"
FORCES = 100 * np.maximum(np.sin(np.pi * (np.arange(100) - 20) / 40), 0) * (np.arange(100) < 60)
FILES = {
    "table.csv": "v,e\n0.5,0.9\n1,0.85\n2,0.8\n3,0.78\n",
    "balls.csv": "ball,v,e\na,1,0.9\nb,1,0.8\n",
    "cell.csv": "ball,v,e\na,1,0.9\nb,1,high\n",
    "all.csv": "ball,v,e\na,1,0.9\nall,1,0.8\n",
    "calibration.csv": "ball,v,e\na,1,0.9\nb,1,0.8\n",
    "record.csv": "time,force\n" + "".join(f"{k}e-5,{f:.3f}\n" for k, f in enumerate(FORCES)),
    "short.csv": INTERVALS + "a,1,1,1,0.4\n",
    "two.csv": INTERVALS + "a,1,1,1,.4\nb,1,1,1,.4\n",
    "without.csv": "ball,drop_height_m,trial,bounce\na,1,1,1\n",
    "fall.toml": FALL,
    "bad.toml": FALL.replace("duration", "# duration"),
    "late.toml": "rtol = 2\n" + FALL,
    "angles.csv": "angle (deg),speed,et,e,ball\n30,2,0.7,0.9,a\n40,2,0.7,0.9,b\n",
}
OBLIQUE, HEIGHTS = (
    importlib.resources.files("jaxcontact.data") / name
    for name in ("oblique_rebounds.csv", "rebound_heights.csv")
)
DAMPING = f"fit damping table.csv {CONTACT}"
EVERY = "--ball all --out o"
WRONG = {
    "impact --law hu_gou --e 0.7 {HIT}": "Did you mean 'hu_guo'?",
    "impact {LAW} --velocity 2 --param ee=1": "no parameter ee; its parameters: e. Did you mean 'e",
    "impact --law=nonsense --e=.5 {HIT}": "not a law; the laws are",
    "impact --law=hu_guo {HIT}": "hu_guo also needs --e E",
    "impact --law=constant_damping {HIT}": "also needs --param c=NUMBER",
    "impact --law=hu_guo --e=.5 --param=c=1 {HIT}": "has no parameter c; its parameters: e",
    "impact --law=damped --e=.5 {HIT}": "has no parameter e; its parameters: alpha",
    "impact --law=damped --param=alpha=1 --param=alpha=2 {HIT}": "given twice",
    "impact --law=hu_guo --e=.5 --param=e=.6 {HIT}": "already given by --e",
    "impact --law=hu_guo --e=1.5 {HIT}": "`e` must be in",
    "impact --law=tsuji --e=.5 --exponent=1 {HIT}": "tsuji is made for 1.5",
    "impact {LAW} --velocity=1e-12": "`velocity` must be in [1e-09, inf)",
    "impact {LAW} --velocity=1 --plot=x.doc": "must end in .png, .pdf or .svg",
    "export {LAW} --velocity 2 --engine yad": "error: --engine must be one of",
    "export {LAW} --velocity 2 --engine yade": "--radius is needed for engine 'yade'",
    "export {LAW} --engine drake": "--velocity is needed",
    "export --engine drake": "give either --law, with its parameters, or --from FILE",
    "export --engine drake --law hu_guo --e 0.7 --velocity 2": "--mass and --stiffness are",
    "paper fig7": "Did you mean 'fig",
    "paper --out table.csv fig6": "table.csv",
    "scene": "give either a FILE or --example box, line, table",
    "scene fall.toml --example line": "give either a FILE or --example",
    "scene --example cradle": "--example must be one of 'box', 'line', 'table', but is",
    "scene none.toml": "none.toml",
    "scene fall.toml --out fall.toml": "--out fall.toml is not a folder",
    "scene fall.toml --plot run.jpg": "--plot run.jpg: the name must end in .png, .pdf or",
    "scene fall.toml --animate run.mp4": "--animate run.mp4: the name must end in .gif",
    "scene fall.toml --plot run.png --axes xz": "--axes must be xy or yx, but is xz",
    "scene bad.toml": "bad.toml, at the top: the key 'duration' must be given",
    "scene late.toml": "late.toml: Argument `rtol` must be a number in (0, 1), but is 2",
    "scene fall.toml --to lammps": "--to needs --out",
    "scene fall.toml --to lammps --out x --plot a.png": "--to makes none",
    "scene fall.toml --time-step 0.1": "--to, which is missing",
    "scene fall.toml --tolerance 0.1": "--to, which is missing",
    "scene fall.toml --to lammps --out x": "must have a `stiffness`",
    "scene fall.toml --to yade --out x": "must be one of",
    "sweep {LAW} --velocity 1:2:3 --out a.csv --plot a.png --field forc": "--field: 'forc' is not",
    "sweep --out=a.csv --law=hu_guo --e=1.5": "e must be in (0, 1], but is 1.5",
    "sweep --out=a.csv --law=hu_guo --e=.3:.9:3 --mass=-1": "mass must be in (0, inf), but is -1",
    "sweep --out=a.csv --law=hu_guo --e=.3:.9:3 --velocity=0": "velocity must be in",
    "sweep --law=hu_guo --e=.3:.9:3 --out=a.txt": "must end in .nc or .csv",
    "sweep --out=a.csv --law=hu_guo --e=.3:.9:3 --plot=a.doc": "must end in .png, .pdf or .svg",
    "sweep --out=a.csv --law=hu_guo --e=.5 --plot=a.png": "one or two ranges, but there are 0",
    "design {LAW} --speeds 1:2:3 --sigma E=0.1": "--sigma E: the quantities are e,",
    "design {LAW} --speeds 1:2:3 --sigma e=0.1 --readings 0": "--readings must",
    "fit impacts table.csv": "--law is needed, as the law from which the fit starts",
    "fit impacts table.csv --law hu_guo": "--mass and --stiffness are needed",
    "fit impacts balls.csv --law exact {CONTACT}": "holds several balls (a, b); choose one with "
    "--ball",
    "fit record table.csv": "column time: is missing; the columns time are needed",
    "fit damping table.csv --columns sped=1": "--columns names 'sped', which is",
    "{DAMPING} --sigma f=1": "--sigma f: the columns are e",
    "{DAMPING} --gravity 9.8": "--gravity is for bounces only",
    "{DAMPING} --rate 120": "--rate is for bounces only",
    "{DAMPING} --low-pass": "--low-pass is for record only",
    "{DAMPING} --sheet a": "has no sheets; omit --sheet",
    "fit bounces table.csv {LAW}": "holds speeds and restitutions; fit them with",
    "calibrate none.csv": "none.csv: cannot be read",
    "calibrate without.csv": "error: without.csv, row 1, column interval_s: is missing",
    "calibrate short.csv": "short.csv, column interval_s: 0 usable pairs of successive",
    "calibrate two.csv": "row 3, column ball: holds several balls (a, b); choose one with --ball",
    "calibrate --ball golf": "has no ball 'golf'; it holds pingpong, blue, tennis",
    "calibrate --law nonsense": "--law must be one of",
    "calibrate --radius 0.02 --drag-coefficient 0.45": "--drag-coefficient alone cannot correct "
    "for drag: also give --mass",
    "calibrate --air-density 1.2": "--air-density alone cannot correct for drag",
    "calibrate --report ball.jpg": "ball.jpg: the name must end in .html, .md, .txt",
    "calibrate --report ball.pdf": "--report ball.pdf: write it as .html, open that",
    "calibrate table.csv --out table.csv": "is not a folder",
    "calibrate table.csv --law constant_damping --out table.csv/below": "table.csv",
    "calibrate balls.csv {EVERY}": "--ball all fits one law to each ball: choose it",
    "calibrate balls.csv {EVERY} --law none": "--law must be one of",
    "calibrate balls.csv {EVERY} --law exact --report": "--report is for one ball",
    "calibrate cell.csv {EVERY} --law exact": "cell.csv, row 3, column e: 'high' is not a number",
    "calibrate all.csv {EVERY} --law exact": "is called 'all'",
    "calibrate record.csv {EVERY} --law exact": "is a record of one ball",
    "calibrate calibration.csv --ball all --law exact --out .": "is the file that is read",
    "calibrate calibration.csv": "or fit one --law to each with --ball all",
    "calibrate angles.csv": "choose one with --ball",
    "calibrate angles.csv --columns ball=ball": "choose one with --ball",
    "calibrate angles.csv --ball all": "has no ball 'all'",
    "calibrate angles.csv --ball a --law exact": "--law does not apply to oblique impacts",
    "calibrate {OBLIQUE}": "--restitution must be given",
    "calibrate {OBLIQUE} --restitution 1": "--radius must be given in m",
    "calibrate {OBLIQUE} --restitution 1 --at 3": "--at does not apply to oblique impacts",
    "calibrate {OBLIQUE} --restitution 2 --radius 0.0025": "--restitution must be",
    "calibrate {HEIGHTS} --restitution 1": "--restitution is for oblique impacts only",
}


@pytest.mark.parametrize("words", WRONG)
def test_bad_input_is_told_and_nothing_is_written(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    given = words.format(**globals())
    for name in set(given.replace("/", " ").split()) & FILES.keys():
        (tmp_path / name).write_text(FILES[name])
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    assert main([*given.split(), "--quiet"]) == 2
    printed = capsys.readouterr()
    assert printed.out == "" and printed.err.startswith("error: ") and WRONG[words] in printed.err
    # An oblique table has no row for each ball.
    assert "angles" not in words or "--ball all" not in printed.err
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_fit_of_a_file_as_it_was_saved(tmp_path, capsys):
    file = tmp_path / "table.csv"
    file.write_text("v (mm/s);COR\n500;0,9\n1000;0,85\n2000;0,8\n3000;0,78\n")
    arguments = ["fit", "damping", str(file), *CONTACT.split()]
    told = asked(capsys, *arguments)
    wanted = jc.fit_damping(jc.Contact(1.0, 1e6), V, E)
    assert told["parameters"] == pytest.approx({"c": wanted.values[0]}, rel=1e-12)
    assert told["standard_errors"] == pytest.approx({"c": wanted.errors[0]}, rel=1e-9)
    assert told["read_as"][0] == 'velocity = "v (mm/s)" / 1000'
    assert main([*arguments, "--quiet"]) == 0 and "read as: velocity" in capsys.readouterr().out
    bounces = tmp_path / "h.txt"
    bounces.write_text("height_mm\n800\n610\n470\n355\n272\n")
    robust = ("fit", "bounces", str(bounces), "--law", "exact", "--robust")
    told = asked(capsys, *robust)
    assert told["parameters"]["law.e"] == pytest.approx(0.873, abs=0.002)
    # In air, which slows the ball, impacts lose less.
    ball = "--mass 0.0027 --radius 0.02 --drag-coefficient 0.45 --gravity 9.8".split()
    told = asked(capsys, *robust, *ball)
    heights = np.array([0.8, 0.61, 0.47, 0.355, 0.272])
    start = jc.ExactRestitution(e=0.7), jc.Contact(1.0, 1.0)
    air = {"gravity": 9.8, "drag": jc.Drag(0.0027, 0.02, 0.45), "loss": jc.Huber()}
    wanted = jc.fit_bounces(*start, heights[:-1], heights[1:], kind="heights", **air)
    assert told["parameters"]["law.e"] == pytest.approx(wanted.values[0], rel=1e-9)
    assert told["parameters"]["law.e"] > 0.9


def test_fit_of_a_record_with_an_offset(tmp_path, capsys):
    hit = jc.trajectory(jc.ConstantDamping(c=4e4), jc.Contact(0.05, 1e6), 2.0)
    time = np.linspace(0, 0.01, 150)
    force = np.interp(time - 0.004, hit.time, hit.force, left=0, right=0)
    force += 9 + 2 * np.random.default_rng(0).normal(size=150)
    file = tmp_path / "force.csv"
    np.savetxt(file, np.column_stack([time, force]), header="time (s),force (N)", delimiter=",")
    law = "--law constant_damping --param c=2e4 --mass .05 --stiffness 2e6 --velocity 1.2"
    arguments = "fit", "record", str(file), *law.split()
    told = asked(capsys, *arguments, "--low-pass")
    assert "a low-pass filter of force does not lower AICc and is left out" in told["notes"][-1]
    assert told["parameters"]["contact.stiffness"] == pytest.approx(1e6, rel=0.1)
    other = asked(capsys, *arguments, "--start-time", "0.0041")
    assert other["parameters"] == pytest.approx(told["parameters"], rel=1e-5)


def test_fit_of_a_track_by_its_frames(tmp_path, capsys):
    truth = draw(np.random.default_rng([0, TRACKED]), kind="trackpy")
    track = tmp_path / "track.csv"
    track.write_text(truth.text)
    rate = "--rate", str(truth.rate)
    told = asked(capsys, "fit", "bounces", str(track), "--law", "exact", *rate)
    # Errors of the times only: measured 1.2e-4 of e.
    assert told["parameters"]["law.e"] == pytest.approx(truth.e, rel=5e-4)


def test_design(capsys):
    arguments = "--law exact --e 0.8 --mass 1 --stiffness 1e6 --speeds 0.5:3:6 --sigma e=0.01"
    told = asked(capsys, "design", *arguments.split(), "--hold", "stiffness", "--readings", "4")
    assert told["quantity"] == ["e"] * 4
    assert told["standard_errors"]["law.e"] == pytest.approx(0.005, rel=1e-6)


@pytest.mark.slow(reason="a calibration of its own, 15 s; test_newcomer exports one, too")
def test_export_of_a_law_and_of_a_calibration(tmp_path, capsys):
    of_law = ("export", *LAW.split(), "--velocity", "2", "--engine", "exudyn")
    told = asked(capsys, *of_law)
    assert told["target"] == pytest.approx(told["delivered"]) == pytest.approx(0.69730, abs=5e-5)
    # 0 and infinity: everywhere.
    assert (told["holds"]["from"], told["holds"]["to"]) == (0.0, None)
    law = jc.ConstantDamping(c=1e5)
    e = np.asarray(jc.impact(law, jc.Contact(1.0, 1e6), np.array(V)).restitution)
    table = jc.read_recording(velocity=V, restitution=e + 0.002 * np.array([1, -1, 1, -1]))
    cal = jc.calibrate(table, laws="constant_damping")
    file = str(tmp_path / "cal.json")
    cal.save(file)
    of_file = ["export", "--from", file, "--engine", "drake"]
    assert main([*of_file, "--quiet"]) == 2
    assert (
        "error: the calibration was made without --mass and --stiffness and does not determine"
        in capsys.readouterr().err
    )
    told = asked(capsys, *of_file, "--mass", "2", "--stiffness", "3e6")
    # c/K was determined, and Drake's e is that of α = d v.
    assert told["parameters"]["hunt_crossley_dissipation"] == pytest.approx(float(cal.law.c), 1e-6)
    assert [told["velocity"][0], told["velocity"][-1]] == pytest.approx([0.5, 3.0])
    with pytest.raises(ValueError, match="made without `mass` and `stiffness`"):
        jc.export(cal, engine="drake")
    again = jc.export(cal, jc.Contact(2.0, 3e6), engine="drake")
    assert dict(again.parameters) == pytest.approx(told["parameters"], rel=1e-9)


def test_completion_knows_commands_options_and_laws(capsys):
    from jaxcontact.engines import engines

    assert all(engine in _COMMANDS["export"].EPILOG for engine in engines())
    for shell in ("bash", "zsh"):
        with pytest.raises(SystemExit) as caught:
            main(["--completion", shell])
        assert caught.value.code == 0
        script = capsys.readouterr().out
        assert all(word in script for word in ("calibrate", "--stiffness", "hu_guo", "mercurydpm"))


def test_the_page_names_all_commands_and_problems():
    from jaxcontact.lab.cli.commands.fit import _PROBLEMS

    text = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    assert re.findall(r"^\| `jaxcontact (\w+)", text, re.MULTILINE) == list(_COMMANDS)
    (problems,) = re.findall(r"parameters from columns: ([^|]*) \|", text)
    assert problems.split(", ") == list(_PROBLEMS)


def test_an_interrupt_is_no_traceback(monkeypatch, capsys):
    def interrupt(*unused):
        raise KeyboardInterrupt

    monkeypatch.setattr(_COMMANDS["laws"], "run", interrupt)
    assert main(["laws", "--quiet"]) == 130 and capsys.readouterr().err == "interrupted\n"


def test_one_figure_and_the_names_of_all(tmp_path, capsys):
    assert list(paper.FIGURES)[:7] == ["fig3", "fig4", "fig5", "fig6", "fig8", "fig9", "fig10"]
    assert all(getattr(paper, name) is figure for name, figure in paper.FIGURES.items())
    folder = tmp_path / "new" / "folder"
    # Without --json the output is numbers.md.
    told = asked(capsys, "paper", "--out", str(folder), "fig6")
    numbers = paper.numbers()
    assert [(one["name"], one["ours"]) for one in told] == [
        (number.published.name, number.ours) for number in numbers
    ]
    assert (folder / "numbers.md").read_text() == paper.markdown(numbers)
    assert (folder / "fig6.png").read_bytes().startswith(b"\x89PNG")
    tables = paper.fig6().tables
    assert {path.name for path in folder.iterdir()} == {"fig6.png", "numbers.md"} | {
        f"fig6_{name}.csv" for name in tables
    }
    written = np.genfromtxt(folder / "fig6_restitution.csv", delimiter=",", names=True)
    np.testing.assert_array_equal(written["hu_guo"], tables["restitution"]["hu_guo"])


# `jaxcontact impact`, the entry point itself, and the installed command.

LOSS = 1e-12  # energy loss against ½ m v² (1-e²), the same numbers in another order: measured 2e-16


def test_the_example(capsys):
    found = asked(capsys, *EXAMPLE.split())
    # α = 9/14 delivers this e, by 40-digit arithmetic to four digits.
    np.testing.assert_allclose(found["restitution"], 0.6973, atol=5.1e-5)
    e = found["restitution"]
    np.testing.assert_allclose(found["rebound_velocity"], 4.2 * e, rtol=LOSS)
    np.testing.assert_allclose(found["energy_loss"], 0.5 * 4.2**2 * (1 - e**2), rtol=LOSS)
    assert found["status"] == "SEPARATED" and found["units"]["duration"] == "s"
    assert 0 < found["compression_time"] < found["duration"]


def test_the_text_and_a_figure(tmp_path, capsys):
    path = tmp_path / "figure.svg"
    assert main([*EXAMPLE.split(), "--plot", str(path)]) == 0
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
        assert main(EXAMPLE.split()) == 0
    monkeypatch.undo()
    assert capsys.readouterr() == ("", "")


def test_the_module_is_the_command(capsys):
    """In double precision; float32 would have other last digits."""
    words = [sys.executable, "-W", "error", "-m", "jaxcontact", *EXAMPLE.split(), "--json"]
    run = subprocess.run(words, capture_output=True, text=True, cwd=ROOT, timeout=120)
    assert (run.returncode, run.stderr) == (0, "")
    assert json.loads(run.stdout) == asked(capsys, *EXAMPLE.split())


# `jaxcontact laws`: every law, and the restitution it delivers.


@pytest.fixture(scope="module")
def rows():
    return {row["law"]: row for row in table()}


def test_every_law_is_there_with_its_source_and_what_it_delivers(rows):
    assert list(rows) == list_laws()
    assert all(row["formula"] and row["source"] for row in rows.values())
    delivered = {
        name: list(row["delivers"].values()) for name, row in rows.items() if row["delivers"]
    }
    assert {*delivered} >= {*constant_laws()}
    assert all(e is not None and 0 <= e <= 1 for numbers in delivered.values() for e in numbers)
    np.testing.assert_allclose(delivered["exact"], (0.9, 0.7, 0.5, 0.3, 0.1), rtol=1e-12)


def test_the_text_and_the_json(rows, capsys):
    assert main(["laws", "--quiet"]) == 0
    lines = {line.split()[0]: line for line in capsys.readouterr().out.splitlines()}
    for text in ("3(1-e)/(2e)", "0.8999", "0.6973", "0.4877", "0.2707", "0.0741", "Hu & Guo 2015"):
        assert text in lines["hu_guo"]
    assert lines["hertz"].split().count("-") == 5
    assert main(["laws", "--json", "--quiet"]) == 0
    assert json.loads(capsys.readouterr().out) == list(rows.values())
