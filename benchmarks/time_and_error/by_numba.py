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
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import DOP853, RK45

from benchmarks.time_and_error.measure import Solve, Way
from benchmarks.time_and_error.problems import Problem


class Pair(NamedTuple):
    """Stages `a`, weights `b`, and rows of weights of the error, the last for f at the end."""

    a: np.ndarray
    b: np.ndarray
    errors: tuple[np.ndarray, ...]
    order: int


FIFTH = Pair(RK45.A, RK45.B, (RK45.E,), 5)
EIGHTH = Pair(DOP853.A, DOP853.B, (DOP853.E5, DOP853.E3), 8)


def _sum(weights: np.ndarray, name: str) -> str:
    return " + ".join(f"{w!r} * {name}{i}" for i, w in enumerate(weights.tolist()) if w)


def step_source(pair: Pair, states: str, numbers: str) -> str:
    """`step(states, rates, h, rtol, atol, numbers)` → new states, their rates, size of the error.

    The error counts as accepted up to 1. `rate(states, numbers)` is what the text expects to find.
    """
    names = states.split()
    olds = ", ".join(names)
    lines = [
        f"def step({olds}, {', '.join(f'{y}k0' for y in names)}, h, rtol, atol, {numbers}):",
    ]

    def put(weights: np.ndarray, stage: int, suffix: str) -> None:
        for y in names:
            lines.append(f"    {y}{suffix} = {y} + h * ({_sum(weights, f'{y}k')})")
        news = ", ".join(f"{y}{suffix}" for y in names)
        rates = ", ".join(f"{y}k{stage}" for y in names)
        lines.append(f"    {rates} = rate({news}, {numbers})")

    stages = len(pair.b)
    for i in range(1, stages):
        put(pair.a[i, :i], i, "s")
    put(pair.b, stages, "n")
    squares = []
    for row, weights in enumerate(pair.errors):
        for y in names:
            scale = f"(atol + rtol * max(abs({y}), abs({y}n)))"
            lines.append(f"    {y}e{row} = h * ({_sum(weights, f'{y}k')}) / {scale}")
        square = " + ".join(f"{y}e{row} * {y}e{row}" for y in names)
        lines.append(f"    size{row} = ({square}) / {len(names)}")
        squares.append(f"size{row}")
    if len(squares) == 1:
        lines.append("    size = sqrt(size0)")
    else:
        # Hairer's combination of the errors of orders five and three.
        lines.append("    whole = size0 + 0.01 * size1")
        lines.append("    size = size0 / sqrt(whole) if whole > 0 else 0.0")
    ends = ", ".join([f"{y}n" for y in names] + [f"{y}k{stages}" for y in names])
    lines.append(f"    return {ends}, size")
    return "\n".join(lines) + "\n"


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
