"""A physicist's code with numba: adaptive Dormand-Prince steps and a Newton iteration at the end.

It is compiled for each law, with lanes in parallel over the threads. The end is found by repeating
the last step with a length corrected by Newton's method, as accurate as the step itself; an
interpolant is less accurate. "Regularised" is an expert's code: the same in w = √x and dτ = dt/w,
where touch and separation are smooth.
"""

from __future__ import annotations

import functools
import math
import os
from typing import Any

import numpy as np

from .measure import Solve, Way
from .pairs import EIGHTH, FIFTH, Pair, step_source
from .problems import Problem

THREADS = 2
FAST = {"reassoc", "contract", "arcp", "nsz", "afn"}
"""Everything but the promise that nothing is NaN, which says here that a solve failed."""

_PLAIN = """
def rate(x, v, {numbers}):
    x = max(x, 0.0)
    s = sqrt(x)
    return v, {acceleration}
"""
_REGULARISED = """
def rate(w, v, t, {numbers}):
    x = w * w
    s = w
    return 0.5 * v, w * ({acceleration}), w
"""
_LANE = """
def lane(rtol, {numbers}):
    atol = rtol
    {start}
    {rates} = rate({states}, {numbers})
    time = 0.0
    h = 0.01
    for _ in range(100_000):
        {news}, {ends}, size = step({states}, {rates}, h, rtol, atol, {numbers})
        if size <= 1:
            if {first}n <= 0:
                for _ in range(20):
                    change = {first}n / {first}ke
                    h -= change
                    {news}, {ends}, size = step({states}, {rates}, h, rtol, atol, {numbers})
                    if abs(change) <= 1e-15 * h + 1e-16:
                        break
                return -vn, {duration}
            if v < 0 < vn:
                # It turned a second time, and stays.
                return 0.0, inf
            {states} = {news}
            {rates} = {ends}
            time += h
        h *= min(5.0, max(0.2, 0.9 * size ** (-1.0 / {order}))) if size > 0 else 5.0
    return nan, nan
"""
_BATCH = """
def batch(table, rtol):
    e, duration = empty(len(table)), empty(len(table))
    for i in {loop}(len(table)):
        e[i], duration[i] = lane(rtol, {row})
    return e, duration
"""


@functools.cache
def kernel(
    acceleration: str,
    numbers: str,
    pair: Pair | str,
    regularised: bool,
    parallel: bool,
    fastmath: bool,
) -> Any:
    """`batch(table, rtol)` for a (lanes, numbers) table, compiled at its first call."""
    import numba

    numba.set_num_threads(min(THREADS, numba.config.NUMBA_NUM_THREADS))
    order = FAST if fastmath else False
    pair = {"fifth": FIFTH, "eighth": EIGHTH}[pair] if isinstance(pair, str) else pair
    states = "w v t" if regularised else "x v"
    names = states.split()
    count = len(numbers.split(", "))
    words = {
        "numbers": numbers,
        "acceleration": acceleration,
        "states": ", ".join(names),
        "rates": ", ".join(f"{y}k0" for y in names),
        "news": ", ".join(f"{y}n" for y in names),
        "ends": ", ".join(f"{y}ke" for y in names),
        "first": names[0],
        "start": "w, v, t = 0.0, 1.0, 0.0" if regularised else "x, v = 0.0, 1.0",
        "duration": "tn" if regularised else "time + h",
        "order": pair.order,
        "loop": "prange" if parallel else "range",
        "row": ", ".join(f"table[i, {k}]" for k in range(count)),
    }
    scope: dict[str, Any] = {
        "sqrt": math.sqrt, "nan": math.nan, "inf": math.inf, "empty": np.empty,
        "prange": numba.prange,
    }  # fmt: skip
    sources = {
        "rate": (_REGULARISED if regularised else _PLAIN).format(**words),
        "step": step_source(pair, states, numbers),
        "lane": _LANE.format(**words),
        "batch": _BATCH.format(**words),
    }
    for name, source in sources.items():
        exec(source, scope)
        several = parallel and name == "batch"
        scope[name] = numba.njit(fastmath=order, parallel=several)(scope[name])
    return scope["batch"]


def in_parallel(lanes: np.ndarray) -> bool:
    """Whether threads pay: not for one lane."""
    return lanes.size > 1 and len(os.sched_getaffinity(0)) > 1


def solver(
    problem: Problem,
    lanes: np.ndarray,
    *,
    pair: str,
    regularised: bool = False,
    fastmath: bool = False,
) -> Solve:
    """One lane by one thread; a batch by all."""
    run = kernel(problem.acceleration, "p", pair, regularised, in_parallel(lanes), fastmath)
    table = np.ascontiguousarray(lanes[:, None])
    return lambda rtol: run(table, rtol)


_MATHS = {"sums in any order": {"fastmath": True}, "IEEE": {"fastmath": False}}
NUMBA = tuple(
    Way(
        name,
        "numba",
        functools.partial(solver, pair=pair, regularised=regularised),
        variants=_MATHS,
        needs="numba",
    )
    for name, pair, regularised in (
        ("numba Dormand-Prince 5(4)", "fifth", False),
        ("numba Dormand-Prince 8(5,3)", "eighth", False),
        ("numba 8(5,3), regularised", "eighth", True),
    )
)
