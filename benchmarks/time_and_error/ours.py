"""The package's methods for one impact."""

from __future__ import annotations

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import jaxcontact as jc

from .problems import Problem
from .way import Solve, Way


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
