"""One impact, in batches of 1, 100 and 100,000: five problems by all methods."""

from __future__ import annotations

import functools
import itertools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import jaxcontact as jc
from benchmarks.time_and_error.by_diffrax import DIFFRAX
from benchmarks.time_and_error.by_numba import NUMBA
from benchmarks.time_and_error.by_scipy import SCIPY
from benchmarks.time_and_error.measure import Solve, Way
from benchmarks.time_and_error.problems import PROBLEMS, Problem
from benchmarks.time_and_error.running import Store, named, run_cases, sweep


def _jitted(problem: Problem, lanes: np.ndarray, how: Any, checked: Any) -> Solve:
    """Every setting is a program of its own: options of a method are not traced."""
    p = jnp.asarray(lanes)

    def run(p: jax.Array, setting: float) -> tuple[jax.Array, jax.Array]:
        hit = problem.impact(p, method=how(setting))
        return hit.restitution, hit.duration

    jax.eval_shape(functools.partial(run, setting=checked), p)
    jitted = jax.jit(run, static_argnums=1)
    return lambda setting: jitted(p, setting)


def exact(problem: Problem, lanes: np.ndarray) -> Solve:
    return _jitted(problem, lanes, lambda setting: "exact", 0.0)


def phase(problem: Problem, lanes: np.ndarray) -> Solve:
    # At the default tolerance few steps would be flagged, which is not visible here.
    return _jitted(problem, lanes, lambda steps: jc.Phase(int(steps), tolerance=0.1), 32)


def event(problem: Problem, lanes: np.ndarray) -> Solve:
    return _jitted(problem, lanes, lambda rtol: jc.Event(rtol=rtol), 1e-9)


def restitution(problem: Problem, lanes: np.ndarray) -> Solve:
    """e without its times."""
    if problem.pushed:
        raise ValueError("a push has a place in `jc.impact` alone")
    contact = jc.Contact(mass=1.0, stiffness=1.0, exponent=problem.exponent)
    run = jax.jit(lambda p: jc.restitution(problem.law(p), contact, 1.0))
    p = jnp.asarray(lanes)
    return lambda setting: (run(p), None)


def called(problem: Problem, lanes: np.ndarray) -> Solve:
    """`jc.impact` as a user types it, without a jit of the user's."""
    p = float(lanes[0]) if lanes.size == 1 else lanes

    def run(setting: float) -> tuple[Any, Any]:
        hit = problem.impact(p)
        return np.atleast_1d(hit.restitution), np.atleast_1d(hit.duration)

    return run


OURS = (
    Way("exact", "ours", exact, settings=(0.0,), word=""),
    Way("phase", "ours", phase, settings=(16, 32, 64), word="steps"),
    Way("event", "ours", event, settings=(1e-6, 1e-9, 1e-12)),
    # It returns less than the others, and is not compared with them.
    Way("jc.restitution, e alone", "alone", restitution, settings=(0.0,), word=""),
    Way("jc.impact, not jitted", "ours", called, settings=(0.0,), word="", batches=(1,)),
)


WAYS = (*OURS, *DIFFRAX, *SCIPY, *NUMBA)
BATCHES = (1, 100, 100_000)
SWEPT = "hunt_crossley"
"""The problem on which a way's options are chosen, in the largest batch."""
SMALL = ("exact", "diffrax Tsit5", "scipy DOP853", "numba 8(5,3), regularised")
SMALL_BATCH = 20


def run(store: Store, only: str = "", small: bool = False) -> None:
    """Measure what the store lacks: the sweep over options first, then every row."""
    if small:
        ways = named(WAYS, "", SMALL, slice(2))
        cases = [(PROBLEMS[SWEPT], way, (SMALL_BATCH,)) for way in ways]
    else:
        cases = [(p, way, BATCHES) for p, way in itertools.product(PROBLEMS.values(), WAYS)]
    cases = [
        (problem, way, batches)
        for problem, way, batches in cases
        if only.lower() in f"{way.name}, {problem.title}".lower()
    ]
    if not small:
        ways = [way for way in WAYS if any(way is each for _, each, _ in cases)]
        sweep(store, "options", PROBLEMS[SWEPT], ways, BATCHES[-1])
    run_cases(store, "impacts", cases, "options")
