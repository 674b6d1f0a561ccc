"""Stored results of benchmarks: pages show them, and they keep what is promised.

Short forms of the studies of intervals, of plans, and of how often a model is inadequate.
"""

import importlib
import json

import numpy as np
import pytest

import jaxcontact as jc
from benchmarks import fit_adequacy, fit_coverage, fit_design, fit_many, memory_map, plastic_speed
from benchmarks.engines import lammps_adhesion, lammps_bed, laws_inside, scene_agreement
from benchmarks.study import DOCS, Study, by_line
from benchmarks.touches import batch

FORCES = 1e-12  # of the forces that diffrax and SciPy integrate: measured 2e-13
STEPS = 2e-3  # of LAMMPS' e at its finest step: measured 6e-4, for the slowest spheres with necks
NEAR = 1e-6  # largest difference from `jc.fit`, in standard errors: measured 6e-7
ERRORS = {"ours, for an error of 1 %": 0.01, "ours, for 0.1 %": 1e-3}
ERRORS["ours, for 1 %, 8 substeps"] = 0.01


def result(benchmark):
    return benchmark.STUDY.result()


STUDIES = (
    "fast_loops fit_adequacy fit_many gpu memory_map plastic_speed random_scenes run_time_error "
    "stability engines.lammps_adhesion engines.lammps_bed engines.laws_inside "
    "engines.scene_agreement lab.records lab.sound lab.tracks"
)


@pytest.mark.parametrize("name", STUDIES.split())
def test_the_page_has_the_tables(name):
    study = importlib.import_module(f"benchmarks.{name}").STUDY
    text = (DOCS / f"{study.page}.md").read_text(encoding="utf-8")
    shown = study.shown(study.result())
    if study.whole:
        # What its example prints is compared below.
        ours, there = (page.split("```") for page in (shown[""], text))
        assert ours[:3] + ours[4:] == there[:3] + there[4:] and "{" not in ours[-1]
    else:
        assert shown and study.on_page(text, study.result()) == text
        assert all(table.count("\n") > 1 for table in shown.values())
        with pytest.raises(ValueError, match=rf"{study.page}.md must have .*{name}.py"):
            study.on_page("a page", study.result())


def test_a_trial_writes_nothing_and_an_interrupted_study_goes_on(tmp_path, capsys):
    def counts(known, only):
        known = known or {}
        for k in range(only or 3):
            if f"{k}" not in known:
                print(f"measures {k}")
                yield known | {f"{k}": {"square": k * k}}
                known[f"{k}"] = {"square": k * k}

    options = {"--only": {"type": int}}
    study = Study("some.py", "", counts, options=options, trial="only", text=by_line)
    into = ["--into", str(tmp_path)]
    study.command(["--only", "2", *into])
    assert not list(tmp_path.iterdir()) and "measures 1" in capsys.readouterr().out
    for told in ("measures 0\nmeasures 1\nmeasures 2\n", ""):
        study.command(into)
        assert capsys.readouterr().out == told
    written = (tmp_path / "some.json").read_text()
    assert json.loads(written)["2"] == {"square": 4} and written.count("\n") == 5


def test_laws_inside_of_engines_keep_what_they_promise():
    found = result(laws_inside)
    versions = ", ".join(f"{name} {number}" for name, number in found["versions"].items())
    assert versions in (DOCS / "engines.md").read_text(encoding="utf-8")
    for row in found["rows"]:
        for cell in row["e"] if row["contact"] in ERRORS else ():
            worst = max(abs(cell[end] / cell["asked"] - 1) for end in ("low", "high"))
            assert worst < ERRORS[row["contact"]]


def test_a_gas_in_lammps_cools_faster_with_the_smaller_e():
    rows = result(lammps_bed)["rows"]
    assert rows["exported"]["e"] == pytest.approx(lammps_bed.E, abs=1e-9)
    energy = {name: np.array(row["gas"]["energy"]) for name, row in rows.items()}
    ratio = energy["tsuji"][1:] / energy["exported"][1:]
    # Haff's law E/E0 = (1 + t/τ)^-2 with 1/τ ~ 1 - e²: between 1 and the ratio of late times.
    losses = [1 - rows[name]["e"] ** 2 for name in ("exported", "tsuji")]
    assert np.all(ratio > 1) and np.all(ratio < (losses[0] / losses[1]) ** 2)


def test_adhesive_spheres_in_lammps_lose_the_energy_up_to_the_largest_pull():
    """The work of a contact with F_po = K = 1 from touch to the δ of its largest pull."""
    for row in result(lammps_adhesion)["rows"]:
        np.testing.assert_allclose(row["lammps"][-1], row.get("early", row["e"]), atol=STEPS)
    # z = a²/R = 1 there.
    depth = np.linspace(0, 1 - 4 / 3, 20001)
    law, contact = jc.JKR(pull_off=1.0), jc.Contact(mass=1.0, stiffness=1.0)
    force = np.asarray(law.force(depth, 0.0, contact, 1.0))
    np.testing.assert_allclose(np.trapezoid(force, depth), lammps_adhesion.EARLY, rtol=1e-8)


@pytest.mark.parametrize("name", plastic_speed.CASES)
def test_all_integrate_the_same_force(name):
    assert {row["law"] for row in result(plastic_speed)["rows"]} == set(plastic_speed.CASES)
    case = plastic_speed.CASES[name]()
    for depth, rate, most in ((0.3, 0.2, 0.0), (1.1, 0.4, 0.0), (1.1, -0.4, 1.2), (1.2, 0.0, 1.2)):
        most = most if case.law.remembers else 0.0
        found = float(case.force(np.float64(depth), np.float64(rate), np.float64(most)))
        assert found == pytest.approx(case.known(depth, rate, most), rel=FORCES)


def test_a_thousand_balls_are_as_fitted_alone():
    known = result(fit_many)
    assert known["balls"] == 1000 and known["away"] < NEAR
    # Of 95 % intervals of normal errors, for a curve: a thousand draws scatter by 0.7 %.
    assert all(0.92 < held < 0.97 for held in known["held"].values())


def test_no_touch_of_a_pendulum_deeper_than_a_nanometre_is_missed():
    (row,) = batch(np.random.default_rng(0), 1000, (1e-9,))
    assert row["touched"] > 600 and row["free"] > 300
    assert row["missed"] == 0 and row["invented"] == 0


def test_the_map_of_laws_with_a_memory_has_no_wrong_lane():
    rows = result(memory_map)
    assert {row["law"] for row in rows} == set(memory_map.LAWS)
    assert all(row["wrong"] == 0 for row in rows)


def test_the_engines_agree_up_to_the_margin_of_the_run():
    found = result(scene_agreement)
    rows = [(row["engine"], row["scene"]) for row in found["rows"]]
    assert rows == [(engine, make.__name__) for engine, make in scene_agreement.CASES]
    for row in found["rows"]:
        # An error of e in every impact, amplified as the run amplifies a change.
        bound = row["growth"] * row["expected_error"] * row["closing"]
        assert row["velocity"] < bound
        assert row["time"] < row["margin"]
        assert row["expected_error"] < found["tolerance"] * (1 + 1e-6)
    for row in found["missed"].values():
        assert 0.5 < np.abs(row["errors"]).max() / row["expected_error"] < 1.02


def test_hard_contacts_rebound_as_rigid_ones():
    found = result(scene_agreement)
    names = [(row["engine"], row["name"]) for row in found["oblique"]]
    laws, impacts = scene_agreement.LAWS, scene_agreement.OBLIQUE
    assert names == [(engine, name) for engine in laws for name in impacts]
    for row in found["oblique"]:
        for name in ("slip", "spin"):
            # Below the error of e, or smaller in the shorter contact in proportion to its duration.
            shorter = row["hard"]["duration"] / row["soft"]["duration"]
            assert row["hard"][name] < max(found["tolerance"], 1.5 * shorter * row["soft"][name])
        assert row["hard"]["normal"] < 1.1 * found["tolerance"]


@pytest.mark.skipif(
    np.finfo(np.longdouble).nmant < 63,
    reason="this processor's long double is no longer than double",
)
@pytest.mark.parametrize("job", [job for job in memory_map.jobs() if job[1] == "exact"])
def test_lanes_of_formulas(job, usual_promotion):
    row = memory_map.measure(*job, 100)
    assert row["right"] == row["lanes"] == 100


DRAWS = 200
LEAST = 0.904  # three standard deviations of a share of 200 draws below 95 %


@pytest.mark.slow(reason="a study of many fits by its benchmark")
@pytest.mark.parametrize("name", ["decay, 8 points, σ unknown", "1 - b v^p, 5 points, σ known"])
def test_intervals_and_bands_hold_the_truth(name):
    cell = fit_coverage.run(name, fit_coverage.cells()[name], DRAWS, seed=3)
    assert cell["converged"] == 1
    assert all(share >= LEAST for share in cell["shares"].values()), cell["shares"]


FEW, LEAST_OF_FEW = 30, 0.83


@pytest.mark.parametrize("noise", ["triggers", "scatter"])
def test_one_trial_tells_two_noises(noise):
    name = f"triggers, 1 trial of 10 bounces, {noise}"
    cell = fit_coverage.run(name, fit_coverage.cells()[name], FEW, seed=3)
    assert cell["converged"] == 1 and cell["shares"]["law.e"] >= LEAST_OF_FEW


def test_a_cell_of_each_kind_runs(tmp_path):
    # Of bounces a quarter of the draws is taken.
    draws = {"record, force, noise unknown": "1", "bounces, constant e, 10": "4", "heights, ": "1"}
    for name, few in draws.items():
        fit_coverage.STUDY.command(["--draws", few, "--only", name, "--into", str(tmp_path)])
    found = json.loads((tmp_path / "fit_coverage.json").read_text())["cells"]
    assert len(found) == 4 and all(cell["converged"] > 0 for cell in found.values())
    assert set(fit_coverage.STUDY.result()["cells"]) <= set(fit_coverage.cells())


def test_a_plan_is_simulated(tmp_path, monkeypatch):
    monkeypatch.setattr(fit_design, "PLANS", dict([*fit_design.PLANS.items()][:1]))
    fit_design.STUDY.command(["--draws", "3", "--into", str(tmp_path)])
    (plan,) = json.loads((tmp_path / "fit_design.json").read_text())["plans"].values()
    assert plan["converged"] == 1 and set(plan["seen"]) == set(plan["expected"])


def test_every_cell_is_there(tmp_path):
    fit_adequacy.STUDY.command(["--draws", "1", "--into", str(tmp_path)])
    found = json.loads((tmp_path / "fit_adequacy.json").read_text())
    assert set(found["levels"]["unknown"]) == {"8", "25", "200", "2000"}
    assert len(found["power"]) == 7 and len(found["curves"]) == 4
    assert all(share in (0, 1) for row in found["power"] for share in row["shares"].values())


def test_the_example_prints_what_the_page_says():
    _, code, _, said, _ = (DOCS / "trust.md").read_text().split("```")
    got = fit_adequacy.printed(code.removeprefix("python\n")).splitlines()
    want = said.removeprefix("text\n").rstrip().splitlines()
    assert got[0] == want[0]
    assert [line.split()[0] for line in got] == [line.split()[0] for line in want]
