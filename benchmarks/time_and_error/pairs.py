"""Generated code for one step of an embedded Runge-Kutta pair, with its stages written out.

Compiled languages are faster without a loop over a tableau. The code that a programmer would type
for Dormand and Prince's pair of fifth order is generated from SciPy's tables, as is the one of
eighth order.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.integrate import DOP853, RK45


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
