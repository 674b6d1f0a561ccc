"""Steps of constant length as in engines, in numba: velocity Verlet and semi-implicit Euler."""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np

from .by_numba import FAST, in_parallel
from .problems import Problem
from .way import Solve, Way

CONTACT = 3.0
"""About the scaled duration of a contact, which the number of steps divides."""
STEPS = (10, 30, 100, 300, 1000, 10_000)

_STEP = {
    "euler": """
        vn = v + h * acceleration(x, v, p)
        xn = x + h * vn
    """,
    # The force at the new place with the speed half a step before, as in LAMMPS.
    "verlet": """
        half = v + 0.5 * h * a
        xn = x + h * half
        a = acceleration(xn, half, p)
        vn = half + 0.5 * h * a
    """,
}
_CODE = """
def acceleration(x, v, p):
    x = max(x, 0.0)
    s = sqrt(x)
    return {acceleration}

def lane(h, p):
    x, v, t = 0.0, 1.0, 0.0
    a = acceleration(x, v, p)
    for _ in range(10_000_000):
        {step}
        if xn <= 0:
            # Where a straight line crosses zero, or at the step that has.
            part = x / (x - xn) if {straight} else 1.0
            return -(v + part * (vn - v)), t + part * h
        x, v, t = xn, vn, t + h
    return nan, nan

def batch(lanes, h):
    e, duration = empty(len(lanes)), empty(len(lanes))
    for i in {loop}(len(lanes)):
        e[i], duration[i] = lane(h, lanes[i])
    return e, duration
"""


@functools.cache
def kernel(acceleration: str, rule: str, straight: bool, parallel: bool) -> Any:
    import numba

    step = _STEP[rule].strip()
    source = _CODE.format(
        acceleration=acceleration,
        step=step,
        straight=straight,
        loop="prange" if parallel else "range",
    )
    scope: dict[str, Any] = {
        "sqrt": math.sqrt, "nan": math.nan, "empty": np.empty, "prange": numba.prange
    }  # fmt: skip
    exec(source, scope)
    for name in ("acceleration", "lane", "batch"):
        several = parallel and name == "batch"
        scope[name] = numba.njit(fastmath=FAST, parallel=several)(scope[name])
    return scope["batch"]


def solver(problem: Problem, lanes: np.ndarray, *, rule: str, straight: bool) -> Solve:
    run = kernel(problem.acceleration, rule, straight, in_parallel(lanes))
    return lambda steps: run(lanes, CONTACT / steps)


STEPPING = tuple(
    Way(
        name,
        "stepping",
        functools.partial(solver, rule=rule),
        settings=STEPS,
        word="steps a contact",
        variants={
            "the end on a straight line": {"straight": True},
            "the end at a step": {"straight": False},
        },
        most=2_000,
        needs="numba",
    )
    for name, rule in (("velocity Verlet", "verlet"), ("semi-implicit Euler", "euler"))
)
