"""The stability map in a reduced form, and its oracles compared with the one of forty digits."""

import dataclasses
import itertools
import pickle

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import jaxcontact as jc
from benchmarks import memory_map
from benchmarks.stability_map.code import without_words
from benchmarks.stability_map.free_table import free
from benchmarks.stability_map.grid import AT_ONCE, Job, answers, blocks, lanes_of, scaled
from benchmarks.stability_map.kinds import KINDS, QUANTITIES, SETTLED
from benchmarks.stability_map.motion_oracle import solve
from benchmarks.stability_map.public_laws import law_jobs, run_law
from benchmarks.stability_map.verdict import CLASSES, FLAGGED_WITHOUT_NEED, RIGHT, WRONG, judge
from tests.oracle import cases

pytestmark = pytest.mark.skipif(
    np.finfo(np.longdouble).nmant < 63,
    reason="this processor's long double is no longer than double",
)

# The oracles of the map against forty digits stored as float64: measured 2e-16; 6.4e-12 for the
# largest force, which is interpolated between nodes.
ORACLE, FORCE = 1e-15, 2e-11
# Chebyshev table: measured 2e-15, and 3e-14 for the largest force.
TABLE, TABLE_FORCE = 1e-14, 1e-12


def _kind(function: str, args: dict) -> tuple[str, str]:
    """The kind of a stored case, and the name of its damping."""
    if function == "kuwabara_kono":
        return ("kuwabara_kono" if args["tension"] else "kuwabara_kono_clamped"), "a"
    if function == "oscillator":
        endings = {"tension": "", "clamped": "_clamped", "approach": "_approach"}
        return "oscillator" + endings[args["ending"]], "zeta"
    return "hunt_crossley", "alpha"


FUNCTIONS = ("hunt_crossley", "kuwabara_kono", "oscillator", "with_gravity")


@pytest.mark.parametrize("kind", [k for k in KINDS if k != "hunt_crossley_tension"])
def test_the_oracle_by_motion(kind):
    some = [c for f in FUNCTIONS for c in cases(f) if _kind(f, c.args)[0] == kind]
    name = _kind(some[0].function, some[0].args)[1]
    columns = ([c.args.get(k, 0.0) for c in some] for k in (name, "n", "gamma"))
    truth = solve(KINDS[kind].problem(*map(np.array, columns)))
    settled = np.array([c.settled for c in some])
    assert ((truth.status == SETTLED) == settled).all()
    for q in QUANTITIES:
        want, got = np.array([c.value[q] for c in some]), getattr(truth, q).astype(float)
        # For settling contacts the other oracle gives the time of the second turn, and no e.
        kept = ~settled | (q not in ("e", "duration"))
        tolerance = FORCE if q == "max_force" else ORACLE
        np.testing.assert_allclose(got[kept], want[kept], rtol=tolerance, err_msg=q)


def test_the_oracle_of_a_force_that_nearly_jumps():
    """Near n = 1 the largest force lies where x is 3e-4, in a step from touch to where x is .01."""
    n, a = 1.0023572007772532, 7.771579570708425

    def rate(logarithm, y):
        x = np.exp(logarithm)
        return [-x * (x**n + n * a * x ** (n - 1) * y[0]) / y[0]]

    found = solve_ivp(rate, [-60, -4], [1.0], "DOP853", rtol=1e-13, max_step=0.1, dense_output=True)
    grid = np.linspace(-9, -7, 20_001)
    x, v = np.exp(grid), found.sol(grid)[0]
    truth = solve(KINDS["kuwabara_kono_clamped"].problem(np.array([a]), n, 0.0))
    want = np.max(x**n + n * a * x ** (n - 1) * v)
    np.testing.assert_allclose(truth.max_force.astype(float), [want], rtol=FORCE)


def test_the_table_of_free_impacts():
    some = [c for c in cases("oscillator") if c.args["n"] == 1.5 and 0 < c.args["zeta"] < 1]
    for ending in ("tension", "clamped"):
        these = [c for c in some if c.args["ending"] == ending]
        kind, _ = _kind("oscillator", these[0].args)
        found = free(kind, np.array([c.args["zeta"] for c in these]), 1.5)
        for q in QUANTITIES:
            want = np.array([c.value[q] for c in these])
            tolerance = TABLE_FORCE if q == "max_force" else TABLE
            np.testing.assert_allclose(found.value[q].astype(float), want, rtol=tolerance)


# A push of 1e4 without damping leaves float32 no digit of the final speed: four corners, and
# similar lanes.
UNRESOLVED = 12
# Lanes, and how many of them may be flagged unnecessarily. None may be wrong.
JOBS = [
    (Job("hunt_crossley", 1.5, False, "exact", "float64", 256), 0),
    (Job("oscillator_clamped", 1.5, False, "exact", "float64", 256), 0),
    (Job("hunt_crossley", 1.5, False, "phase", "float64", 256), 0),
    (Job("hunt_crossley", 1.5, True, "event", "float64", 256), 0),
    (Job("kuwabara_kono", 1.5, True, "event", "float64", 256), 0),
    (Job("kuwabara_kono_clamped", 1.5, True, "event", "float32", 256), UNRESOLVED),
]


def test_the_table_of_weak_damping_has_its_derivatives():
    """Of e = exp(-πζ/√(1-ζ²)), where all but one part in 1e12 of it does not depend on ζ."""
    zeta = np.array([1e-12, 1e-8, 1e-4, 9e-3], np.longdouble)
    found, free_of = free("oscillator", zeta, 1.5), (1 - zeta) * (1 + zeta)
    rate = -np.pi * zeta / free_of**1.5
    assert np.allclose(found.by_damping["e"] / found.value["e"], rate, rtol=TABLE, atol=0)


@pytest.mark.slow(
    "kuwabara_kono/n=1.5/pushed/event/float64",
    reason="an event solve once more, between that with a clamp and that of another law",
)
@pytest.mark.parametrize(("job", "flagged"), JOBS, ids=[job.name for job, _ in JOBS])
def test_lanes(job, flagged):
    lanes = lanes_of(job)
    numbers = scaled(job, lanes)
    judged = judge(job, numbers, *answers(job, lanes))
    counts = np.bincount(judged.klass, minlength=len(CLASSES))
    assert counts[WRONG] == 0
    assert counts[FLAGGED_WITHOUT_NEED] <= flagged


def test_laws_by_their_own_classes():
    questions = law_jobs(32)
    # The force of `step_damping` is not a power of the indentation: its truth is that of its tests.
    # Laws with a memory and adhesive ones have another map.
    others = {"step_damping", *memory_map.LAWS}
    assert {question.title for question in questions} | others == {
        name
        for name in jc.list_laws()
        if jc._laws.describe(name).cls.__module__.startswith("jaxcontact.")
    }
    names = ("hu_guo, free", "energy_loss, free", "power_damping, free", "tsuji, free")
    for question in questions:
        # To another process and back, as in the benchmark.
        question = pickle.loads(pickle.dumps(question))
        if question.name in names:
            counts = run_law(question)["counts"]
            assert counts[CLASSES[RIGHT]] == sum(counts.values()) == 32


def test_blocks_hold_every_lane_once_and_alike():
    job = Job("hunt_crossley", 1.5, False, "event", "float64", 1100)
    damping = np.arange(1100.0)[::-1]
    taken = list(blocks(job, damping))
    assert {index.size for index in taken} == {AT_ONCE}
    assert np.unique(np.concatenate(taken)).size == job.lanes
    assert all(damping[a].max() <= damping[b].min() for a, b in itertools.pairwise(taken))


def test_another_seed_draws_other_lanes():
    job = Job("hunt_crossley", 1.5, True, "event", "float64", 256)
    one, other = lanes_of(job), lanes_of(dataclasses.replace(job, seed=1))
    assert (one.push[:150] == other.push[:150]).any() and (one.push != other.push).any()


def test_the_code_that_answered_does_not_change_with_words_about_it():
    source = '"""Of it."""\n\ndef f(x):\n    """Twice."""\n    # Why.\n    return 2 * x\n'
    same = "def f(x):\n\n    return (2*x)  # Because.\n"
    assert without_words(source) == without_words(same) != without_words(same.replace("2", "3"))
    assert without_words("a = None") != without_words("a = ''") != without_words("a = 0")
