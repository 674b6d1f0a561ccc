"""Short forms of the studies of intervals, of plans, and of how often a model is inadequate."""

import json

import pytest

from benchmarks import fit_coverage, fit_design
from benchmarks.fit_adequacy import STUDY, printed
from benchmarks.study import DOCS

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
    STUDY.command(["--draws", "1", "--into", str(tmp_path)])
    found = json.loads((tmp_path / "fit_adequacy.json").read_text())
    assert set(found["levels"]["unknown"]) == {"8", "25", "200", "2000"}
    assert len(found["power"]) == 7 and len(found["curves"]) == 4
    assert all(share in (0, 1) for row in found["power"] for share in row["shares"].values())


def test_the_example_prints_what_the_page_says():
    _, code, _, said, _ = (DOCS / "trust.md").read_text().split("```")
    got = printed(code.removeprefix("python\n")).splitlines()
    want = said.removeprefix("text\n").rstrip().splitlines()
    assert got[0] == want[0]
    assert [line.split()[0] for line in got] == [line.split()[0] for line in want]
