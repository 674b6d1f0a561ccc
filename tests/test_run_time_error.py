"""The benchmark of run time against error in its small form: it runs, goes on, makes a page."""

import json

import pytest

from benchmarks.run_time_error import main
from benchmarks.time_and_error.problems import PROBLEMS, truth, worst
from benchmarks.time_and_error.running import measure
from benchmarks.time_and_error.store import Store
from benchmarks.time_and_error.way import Way

# What every way must reach by the finest setting of the small form.
REACHED = {"ours": 1e-12, "numba": 1e-4, "diffrax": 1e-3, "scipy": 1e-4, "stepping": 1e-1}


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    import jax

    into = tmp_path_factory.mktemp("run_time_error")
    # Peers are run as their users run them.
    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        main(["--small", "--into", str(into)])
    return into


def test_every_way_answers_or_says_why(results):
    rows = json.loads((results / "run_time_error.json").read_text())["rows"]
    best = {}
    for row in rows.values():
        if "reason" in row:
            # Of the small form only what is not installed.
            assert row["reason"].endswith("is not installed"), row
            continue
        assert row["seconds"] > 0 and row["compile_s"] >= 0 and row["calls"] > 0
        key = row["group"], row["way"]
        best[key] = min(best.get(key, (1, "")), (row["error"], row["family"]))
    assert {group for group, _ in best} == {"impacts", "derivatives", "scenes", "fits"}
    for way, (error, family) in best.items():
        assert error <= REACHED[family], way


def test_page_and_figures_come_from_the_rows(results):
    page = (results / "run_time_error.md").read_text()
    assert "| exact |" in page and "## When to use what" in page
    assert (results / "run_time_error_impacts.png").stat().st_size > 10_000


def test_a_run_goes_on_where_it_was(results, capsys):
    before = (results / "run_time_error.json").read_text()
    main(["--small", "--into", str(results)])
    assert capsys.readouterr().out == ""
    assert (results / "run_time_error.json").read_text() == before


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


def test_a_row_of_other_code_counts_as_missing(tmp_path):
    store = Store(tmp_path / "rows.json")
    store.keep("a", {"group": "impacts", "code": "1"})
    again = Store(tmp_path / "rows.json")
    assert again.lacks("a", "2") and again.lacks("b", "1") and not again.lacks("a", "1")


@pytest.mark.parametrize("name", ["own", "pushed"])
def test_truth_of_the_laws_that_the_oracle_does_not_store(name):
    """Beside SciPy's solve of the package's force, or of what is typed here again."""
    from scipy.integrate import solve_ivp

    p = float(PROBLEMS[name].number(0.5))
    force = {
        "own": lambda x, v: -(x**1.5 + x**2.5 + p * x * v),
        "pushed": lambda x, v: p - x**1.5,
    }[name]

    def apart(t, y):
        return y[0]

    apart.terminal, apart.direction = True, -1
    end = solve_ivp(
        lambda t, y: (y[1], force(max(y[0], 0), y[1])),
        (0, 20), (0, 1), "DOP853", events=apart, rtol=1e-12, atol=1e-13,
    )  # fmt: skip
    want = truth(name, (p,))
    assert worst([-end.y_events[0][0, 1]], want[0]) < 1e-9
    assert worst([end.t_events[0][0]], want[1]) < 1e-9
