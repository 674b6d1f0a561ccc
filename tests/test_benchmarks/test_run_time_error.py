"""The short form of the benchmark of run time against error: it runs, resumes, writes a page."""

import functools
import json

import numpy as np
import pytest

import jaxcontact as jc
from benchmarks.run_time_error import STUDY
from benchmarks.time_and_error.engines import _thrown
from benchmarks.time_and_error.measure import Way
from benchmarks.time_and_error.problems import PROBLEMS, truth, worst
from benchmarks.time_and_error.rebounds import ASKED, MASS, RADIUS, SPEED, Rebound, jaxsim_law
from benchmarks.time_and_error.running import Store, measure
from benchmarks.time_and_error.sections import law_and_step
from benchmarks.until_event import contact

# Accuracy that every method must reach with the finest setting of the short form, engines with ten
# steps per contact.
REACHED = {"ours": 1e-12, "numba": 1e-4, "diffrax": 1e-3, "scipy": 1e-4, "engines": 1e-1}


# Peers are run as their users run them.
pytestmark = pytest.mark.usefixtures("usual_promotion")


def measured(into, *asked):
    """The result of the short form, as text."""
    STUDY.command([*asked, "--small", "--into", str(into)])
    return (into / "run_time_error.json").read_text()


@pytest.mark.slow(reason="the benchmark's own programs, a dozen of them")
def test_every_way_answers_or_says_why(tmp_path):
    rows = json.loads(measured(tmp_path))["rows"]
    best = {}
    for row in rows.values():
        if "reason" in row:
            # The short form may lack only rows of libraries that are not installed.
            assert row["reason"].endswith("is not installed"), row
            continue
        assert row["seconds"] > 0 and row["compile_s"] >= 0 and row["calls"] > 0
        key = row["group"], row["way"]
        best[key] = min(best.get(key, (1, "")), (row["error"], row["family"]))
    groups = set("impacts derivatives engines scenes fits".split())
    assert {group for group, _ in best} == groups
    for way, (error, family) in best.items():
        assert error <= REACHED[family], way


def test_the_page_comes_from_the_rows_and_a_run_goes_on(tmp_path, capsys):
    # One way of one group: the others make rows of the same kind.
    one = "impacts", "--only", "exact"
    before = measured(tmp_path, *one)
    page = (tmp_path / "run_time_error.md").read_text()
    assert "| exact |" in page and "## When to use what" in page
    assert (tmp_path / "run_time_error_impacts.png").stat().st_size > 10_000
    capsys.readouterr()
    assert measured(tmp_path, *one) == before and capsys.readouterr().out == ""


def by_hand(drops):
    """An engine of a few lines: semi-implicit Euler of JaxSim's law, one ball after another."""

    def thrown(drop, steps):
        force = jaxsim_law(drop.numbers, MASS, RADIUS)
        (step, count), x, v = drop.ladder(steps), -drop.gap(steps), SPEED
        for _ in range(count):
            v += step * (force(x, v, SPEED) if x > 0 else 0.0)
            x += step * v
        return -v / SPEED

    return lambda steps: np.array([thrown(drop, steps) for drop in drops])


def test_an_engine_misses_by_its_law_and_by_its_steps(tmp_path):
    """Hunt and Crossley's damping is not that of e, however fine the steps."""
    store, task = Store(tmp_path / "rows.json"), Rebound(exported=False)
    build = functools.partial(_thrown, engine="jaxsim", build=by_hand, library="numpy")
    way = Way("by hand", "engines", build, settings=(100, 1000), compiled=False)
    measure(store, "engines", task, way, "", len(ASKED), "")
    coarse, fine = store.rows.values()
    laws = [float(jc.restitution(jc.HuntCrossley(e=e))) for e in ASKED]
    assert coarse["error_law"] == fine["error_law"]
    assert fine["error_law"] == pytest.approx(worst(laws, np.array(ASKED)), rel=1e-2)
    assert 1e-4 > coarse["error_step"] > 10 * fine["error_step"]
    assert fine["error"] == max(fine["error_law"], fine["error_step"], fine["error_asked"])


def test_the_page_tells_the_error_of_the_law_and_that_of_the_step():
    row = {"family": "engines", "way": "JaxSim", "problem": "exported", "error": 1e-2}
    rows = [
        row | {"setting": setting, "error_law": 1e-11, "error_step": step}
        for setting, step in ((10, 1e-2), (100, 2e-4), (10, 3e-3))
    ]
    *_, line, _ = law_and_step(rows)
    cells = [cell.strip() for cell in line.strip("|").split("|")]
    assert cells[2:] == ["below 1e-9", "10: 1e-02, 100: 2e-04"]


def test_what_is_not_installed_and_what_raises_stay_in_the_table(tmp_path):
    store, task = Store(tmp_path / "rows.json"), PROBLEMS["hunt_crossley"]

    def raises(setting):
        raise ArithmeticError("no number")

    ways = (
        Way("absent", "scipy", lambda task, lanes: raises, (1.0,), needs="no_such_library"),
        Way("refused", "scipy", lambda task, lanes: raises, (1.0,)),
    )
    for way in ways:
        measure(store, "impacts", task, way, "", 1, "")
    reasons = [row["reason"] for row in Store(tmp_path / "rows.json").rows.values()]
    assert reasons == ["no_such_library is not installed", "ArithmeticError: no number"]


def test_which_rows_count_as_missing(tmp_path):
    """Those of other code, and of a busy machine where that is asked."""
    store = Store(tmp_path / "rows.json")
    store.keep("a", {"group": "impacts", "code": "1", "load": 5.0})
    again, quiet = Store(tmp_path / "rows.json"), Store(tmp_path / "rows.json", busiest=3.0)
    assert again.lacks("a", "2") and again.lacks("b", "1") and not again.lacks("a", "1")
    assert quiet.lacks("a", "1")


@pytest.mark.parametrize("name", ["own", "pushed"])
def test_truth_of_the_laws_that_the_oracle_does_not_store(name):
    """Beside SciPy's solve of the package's force, or of what is typed here again."""
    p = float(PROBLEMS[name].number(0.5))
    force = {"own": lambda x, v: -(x**1.5 + x**2.5 + p * x * v), "pushed": lambda x, v: p - x**1.5}
    end = contact(force[name], 1e-12, atol=0.1)
    want = truth(name, (p,))
    assert worst([-end.y_events[0][0, 1]], want[0]) < 1e-9
    assert worst([end.t_events[0][0]], want[1]) < 1e-9
