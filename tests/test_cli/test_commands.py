"""All commands have one style: options, JSON, exit codes, messages, completion.

The figures and numbers of `jaxcontact paper`.
"""

import argparse
import csv
import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import jaxcontact as jc
from benchmarks.track_truths import draw
from jaxcontact import paper
from jaxcontact._cli import _COMMANDS, _parser, main

E = [0.9, 0.85, 0.8, 0.78]
V = [0.5, 1.0, 2.0, 3.0]

TRACKED = 705
"""The draw of a track with five impacts, e = 0.84, at 120 frames per second."""


def parsers():
    (commands,) = (a for a in _parser()._actions if isinstance(a, argparse._SubParsersAction))
    return commands.choices


def refused(capsys, *arguments):
    """The last lines of stderr, of arguments that are not understood."""
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    assert caught.value.code == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    return printed.err


def test_help_and_version_do_not_wait_for_jax():
    code = (
        "import sys\nfrom jaxcontact._cli import main\n"
        "for option in ('--help', '--version'):\n"
        "    try:\n        main([option])\n    except SystemExit as end:\n"
        "        assert end.code == 0\n"
        "assert not {'jax', 'numpy', 'matplotlib'} & set(sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert f"jaxcontact {jc.__version__}" in done.stdout
    assert "130 interrupted" in done.stdout


@pytest.mark.parametrize("name", _COMMANDS)
def test_every_command_has_the_same_options_and_says_its_exit_codes(name, capsys):
    with pytest.raises(SystemExit):
        main([name, "--help"])
    told = capsys.readouterr().out
    assert "options of every command" in told and "exit codes: 0 done" in told
    assert all(option in told for option in ("--json", "--quiet", "--no-cache"))
    # One name per concept.
    kinds = {"--law": "NAME", "--mass": "KG", "--stiffness": "K", "--e": "E", "--ball": "NAME"}
    for action in parsers()[name]._actions:
        for option in set(action.option_strings) & set(kinds):
            assert action.metavar == kinds[option]


SAID = {
    ("calibrat",): "did you mean calibrate?",
    ("impact", "--velociti", "3"): "unknown: --velociti; did you mean --velocity?",
    ("calibrate", "--collumns=v=1"): "unknown: --collumns=v=1; did you mean --columns?",
    ("laws", "more"): "unknown: more",
    ("fit", "impact", "x.csv"): "did you mean impacts?",
    ("export", "--engine", "drake", "--velocity", "fast"): "argument --velocity: 'fast' is not a",
    (): "the following arguments are required: COMMAND",
}


@pytest.mark.parametrize("arguments", SAID)
def test_what_is_not_understood_is_told_with_a_suggestion(arguments, capsys):
    told = refused(capsys, *arguments)
    assert told.startswith("error: ") and SAID[arguments] in told
    assert "--help` lists all options" in told


LAW = ("--law", "hu_guo", "--e", "0.7", "--mass", "1", "--stiffness", "1e6", "--quiet")
SWEEP = tuple("--velocity 1:2:3 --out a.csv --plot a.png --field forc".split())
WRONG = {
    ("impact", "--law", "hu_gou", *LAW[2:], "--velocity", "2"): "Did you mean 'hu_guo'?",
    ("impact", *LAW, "--velocity", "2", "--param", "ee=1"): "no parameter ee; its parameters: e. "
    "Did you mean 'e'?",
    ("export", *LAW, "--velocity", "2", "--engine", "yad"): "error: --engine must be one of",
    ("export", *LAW, "--velocity", "2", "--engine", "yade"): "--radius is needed for engine 'yade'",
    ("export", *LAW, "--engine", "drake"): "--velocity is needed",
    ("export", "--engine", "drake"): "give either --law, with its parameters, or --from FILE",
    ("export", "--engine", "drake", *LAW[:4], "--velocity", "2"): "--mass and --stiffness are",
    ("paper", "fig7"): "Did you mean 'fig",
    ("sweep", *LAW, *SWEEP): "--field: 'forc' is not one of",
    ("design", *LAW, "--speeds", "1:2:3", "--sigma", "E=0.1"): "--sigma E: the quantities are e,",
    ("design", *LAW, "--speeds", "1:2:3", "--sigma", "e=0.1", "--readings", "0"): "--readings must",
    ("fit", "impacts", "{file}"): "--law is needed, as the law from which the fit starts",
    ("fit", "impacts", "{file}", "--law", "hu_guo"): "--mass and --stiffness are needed",
    ("fit", "record", "{file}"): "column time: is missing; the columns time are needed",
    ("fit", "damping", "{file}", "--columns", "sped=1"): "--columns names 'sped', which is",
    ("fit", "damping", "{file}", *LAW[4:], "--sigma", "f=1"): "--sigma f: the columns are e",
    ("fit", "damping", "{file}", *LAW[4:], "--gravity", "9.8"): "--gravity is for bounces only",
    ("fit", "damping", "{file}", *LAW[4:], "--rate", "120"): "--rate is for bounces only",
    ("fit", "damping", "{file}", "--low-pass"): "--low-pass is for record only",
    ("fit", "damping", "{file}", "--sheet", "a"): "has no sheets; omit --sheet",
    ("fit", "bounces", "{file}", *LAW): "holds speeds and restitutions; fit them with",
}


@pytest.mark.parametrize("arguments", WRONG)
def test_bad_input_is_told_and_nothing_is_written(arguments, tmp_path, monkeypatch, capsys):
    file = tmp_path / "table.csv"
    file.write_text("v,e\n" + "".join(f"{v},{e}\n" for v, e in zip(V, E, strict=True)))
    monkeypatch.chdir(tmp_path)
    assert main([argument.format(file=file) for argument in arguments]) == 2
    printed = capsys.readouterr()
    assert printed.out == "" and WRONG[arguments] in printed.err
    assert list(tmp_path.iterdir()) == [file]


def asked(capsys, *arguments, code=0):
    """The JSON that a command prints, and nothing else on stdout."""
    assert main([*arguments, "--json", "--quiet"]) == code
    printed = capsys.readouterr()
    assert printed.err == ""
    return json.loads(printed.out)


def test_fit_of_a_file_as_it_was_saved(tmp_path, capsys):
    file = tmp_path / "table.csv"
    file.write_text("v (mm/s);COR\n500;0,9\n1000;0,85\n2000;0,8\n3000;0,78\n")
    arguments = ["fit", "damping", str(file), "--mass", "1", "--stiffness", "1e6"]
    told = asked(capsys, *arguments)
    contact = jc.Contact(1.0, 1e6)
    wanted = jc.fit_damping(contact, V, E)
    assert told["parameters"] == pytest.approx({"c": wanted.values[0]}, rel=1e-12)
    assert told["standard_errors"] == pytest.approx({"c": wanted.errors[0]}, rel=1e-9)
    assert told["read_as"][0] == 'velocity = "v (mm/s)" / 1000'
    assert main([*arguments, "--quiet"]) == 0
    assert "read as: velocity" in capsys.readouterr().out
    bounces = tmp_path / "h.txt"
    bounces.write_text("height_mm\n800\n610\n470\n355\n272\n")
    told = asked(capsys, "fit", "bounces", str(bounces), "--law", "exact", "--robust")
    assert told["parameters"]["law.e"] == pytest.approx(0.873, abs=0.002)
    # In air, which slows the ball, impacts lose less.
    ball = (
        "--mass",
        "0.0027",
        "--radius",
        "0.02",
        "--drag-coefficient",
        "0.45",
        "--gravity",
        "9.8",
    )
    told = asked(capsys, "fit", "bounces", str(bounces), "--law", "exact", "--robust", *ball)
    heights = np.array([0.8, 0.61, 0.47, 0.355, 0.272])
    drag = jc.Drag(0.0027, 0.02, 0.45)
    wanted = jc.fit_bounces(
        *(jc.ExactRestitution(e=0.7), jc.Contact(1.0, 1.0), heights[:-1], heights[1:]),
        kind="heights",
        gravity=9.8,
        drag=drag,
        loss=jc.Huber(),
    )
    assert told["parameters"]["law.e"] == pytest.approx(wanted.values[0], rel=1e-9)
    assert told["parameters"]["law.e"] > 0.9


def test_fit_of_a_record_with_an_offset(tmp_path, capsys):
    hit = jc.trajectory(jc.ConstantDamping(c=4e4), jc.Contact(0.05, 1e6), 2.0)
    time = np.linspace(0, 0.01, 150)
    force = np.interp(time - 0.004, hit.time, hit.force, left=0, right=0)
    force += 9 + 2 * np.random.default_rng(0).normal(size=150)
    file = tmp_path / "force.csv"
    np.savetxt(file, np.column_stack([time, force]), header="time (s),force (N)", delimiter=",")
    law = "--law", "constant_damping", "--param", "c=2e4", "--mass", ".05", "--stiffness", "2e6"
    arguments = "fit", "record", str(file), *law, "--velocity", "1.2"
    told = asked(capsys, *arguments, "--low-pass")
    assert "a low-pass filter of force does not lower AICc and is left out" in told["notes"][-1]
    assert told["parameters"]["contact.stiffness"] == pytest.approx(1e6, rel=0.1)
    other = asked(capsys, *arguments, "--start-time", "0.0041")
    assert other["parameters"] == pytest.approx(told["parameters"], rel=1e-5)


def test_fit_of_a_track_by_its_frames(tmp_path, capsys):
    truth = draw(np.random.default_rng([0, TRACKED]), kind="trackpy")
    track = tmp_path / "track.csv"
    track.write_text(truth.text)
    arguments = ["fit", "bounces", str(track), "--law", "exact"]
    assert main([*arguments, "--quiet"]) == 2
    assert "give the frames per second as --rate" in capsys.readouterr().err
    told = asked(capsys, *arguments, "--rate", str(truth.rate))
    # Errors of the times only: measured 1.2e-4 of e.
    assert told["parameters"]["law.e"] == pytest.approx(truth.e, rel=5e-4)


def test_design(capsys):
    arguments = ("--law", "exact", "--e", "0.8", "--mass", "1", "--stiffness", "1e6")
    speeds = ("--speeds", "0.5:3:6", "--sigma", "e=0.01", "--hold", "stiffness", "--readings", "4")
    told = asked(capsys, "design", *arguments, *speeds)
    assert told["quantity"] == ["e"] * 4
    assert told["standard_errors"]["law.e"] == pytest.approx(0.005, rel=1e-6)


@pytest.mark.slow(reason="a calibration of its own, 15 s; test_newcomer exports one, too")
def test_export_of_a_law_and_of_a_calibration(tmp_path, capsys):
    told = asked(capsys, "export", *LAW, "--velocity", "2", "--engine", "exudyn")
    assert told["target"] == pytest.approx(told["delivered"]) == pytest.approx(0.69730, abs=5e-5)
    # 0 and infinity: everywhere.
    assert (told["holds"]["from"], told["holds"]["to"]) == (0.0, None)
    law = jc.ConstantDamping(c=1e5)
    e = np.asarray(jc.impact(law, jc.Contact(1.0, 1e6), np.array(V)).restitution)
    noise = 0.002 * np.array([1, -1, 1, -1])
    cal = jc.calibrate(
        jc.read_recording(velocity=V, restitution=e + noise), laws="constant_damping"
    )
    file = str(tmp_path / "cal.json")
    cal.save(file)
    assert main(["export", "--from", file, "--engine", "drake", "--quiet"]) == 2
    assert (
        "error: the calibration was made without --mass and --stiffness and does not determine"
        in capsys.readouterr().err
    )
    more = ("--mass", "2", "--stiffness", "3e6")
    told = asked(capsys, "export", "--from", file, *more, "--engine", "drake")
    # c/K was determined, and Drake's e is that of α = d v.
    assert told["parameters"]["hunt_crossley_dissipation"] == pytest.approx(float(cal.law.c), 1e-6)
    assert [told["velocity"][0], told["velocity"][-1]] == pytest.approx([0.5, 3.0])
    with pytest.raises(ValueError, match="made without `mass` and `stiffness`"):
        jc.export(cal, engine="drake")
    again = jc.export(cal, jc.Contact(2.0, 3e6), engine="drake")
    assert dict(again.parameters) == pytest.approx(told["parameters"], rel=1e-9)
    assert main(["export", *LAW, "--velocity", "2", "--engine", "exudyn"]) == 0
    text = capsys.readouterr().out
    assert "restitutionCoefficient=0.69" in text and "e is within 0.01 of the law's" in text


def test_the_same_e_with_another_contact():
    """Of each kind of law: c/K, and A (K/m)^(2/5), stay."""
    from jaxcontact._calibration.choice.kinds import law_in

    old, new = jc.Contact(1.0, 1.0), jc.Contact(0.2, 3e6)
    for law in (
        jc.ConstantDamping(c=0.3),
        jc.PowerDamping(c=0.3, power=-0.4, reference=1.5),
        jc.ExactRestitution(e=0.6),
    ):
        moved = law_in(law, old, new)
        before, after = (jc.impact(x, c, 2.0).restitution for x, c in ((law, old), (moved, new)))
        assert float(after) == pytest.approx(float(before), rel=1e-12)
    viscous = jc.KuwabaraKono(A=0.1)
    moved = law_in(viscous, old, new)
    assert float(moved.A) * (3e6 / 0.2) ** 0.4 == pytest.approx(0.1, rel=1e-12)


def test_completion_knows_commands_options_and_laws(capsys):
    from jaxcontact._export import engines

    assert all(engine in _COMMANDS["export"].EPILOG for engine in engines())
    for shell in ("bash", "zsh"):
        with pytest.raises(SystemExit) as caught:
            main(["--completion", shell])
        assert caught.value.code == 0
        script = capsys.readouterr().out
        assert all(word in script for word in ("calibrate", "--stiffness", "hu_guo", "mercurydpm"))


def test_the_page_names_all_commands_and_problems():
    from jaxcontact._cli.commands.fit import _PROBLEMS

    text = (Path(__file__).parents[2] / "docs" / "commands.md").read_text(encoding="utf-8")
    assert re.findall(r"^\| `jaxcontact (\w+)", text, re.MULTILINE) == list(_COMMANDS)
    (problems,) = re.findall(r"parameters from columns: ([^|]*) \|", text)
    assert problems.split(", ") == list(_PROBLEMS)
    # The printed lines are valid.
    for line in re.findall(r"^jaxcontact ((?!--).*)", text, re.MULTILINE):
        _parser().parse_args(line.split())


def test_an_interrupt_is_no_traceback(monkeypatch, capsys):
    def interrupt(*unused):
        raise KeyboardInterrupt

    monkeypatch.setattr(_COMMANDS["laws"], "run", interrupt)
    assert main(["laws", "--quiet"]) == 130
    assert capsys.readouterr().err == "interrupted\n"


def test_one_figure(tmp_path, capsys):
    folder = tmp_path / "new" / "folder"
    # Without --json the output is numbers.md.
    assert main(["paper", "--quiet", "--json", "--out", str(folder), "fig6"]) == 0
    table = paper.markdown(paper.numbers())
    told = json.loads(capsys.readouterr().out)
    assert [(one["name"], one["ours"]) for one in told] == [
        (number.published.name, number.ours) for number in paper.numbers()
    ]
    assert (folder / "numbers.md").read_text() == table
    assert (folder / "fig6.png").read_bytes().startswith(b"\x89PNG")
    tables = paper.fig6().tables
    assert {path.name for path in folder.iterdir()} == {"fig6.png", "numbers.md"} | {
        f"fig6_{name}.csv" for name in tables
    }
    with open(folder / "fig6_restitution.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    written = np.array([float(row["hu_guo"]) for row in rows])
    np.testing.assert_array_equal(written, tables["restitution"]["hu_guo"])


def test_every_figure_has_its_name():
    assert list(paper.FIGURES)[:7] == ["fig3", "fig4", "fig5", "fig6", "fig8", "fig9", "fig10"]
    for name, figure in paper.FIGURES.items():
        assert getattr(paper, name) is figure


@pytest.mark.parametrize("arguments", [["fig7"], ["--out", "{file}", "fig6"]])
def test_bad_arguments(tmp_path, capsys, arguments):
    file = tmp_path / "file"
    file.write_text("mine")
    assert main(["paper", *(word.format(file=file) for word in arguments)]) == 2
    assert "error: " in capsys.readouterr().err
    assert file.read_text() == "mine" and list(tmp_path.iterdir()) == [file]
