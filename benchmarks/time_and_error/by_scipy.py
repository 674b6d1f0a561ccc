"""scipy.integrate.solve_ivp with an event, one impact after another."""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from .measure import LADDER, Solve, Way
from .problems import CHECKED, Problem, function_of

LONGEST = 1e3


def apart(t: float, y: Any) -> float:
    return y[0]


apart.terminal, apart.direction = True, -1


def impact(
    acceleration: Any, numbers: tuple[float, ...], rtol: float, method: str, atol: float = 1.0
) -> tuple[float, float]:
    """e and duration of one lane; NaN where no end was found. `atol` in units of `rtol`."""

    def rate(t, y):
        x, v = y.tolist()
        x = max(x, 0.0)
        return v, acceleration(x, math.sqrt(x), v, *numbers)

    end = solve_ivp(
        rate, (0, LONGEST), (0, 1), method, events=apart, rtol=rtol, atol=atol * rtol,
        first_step=0.01,
    )  # fmt: skip
    if end.status != 1:
        return math.nan, math.nan
    return -end.y_events[0][0, 1], end.t_events[0][0]


def loop(problem: Problem, lanes: np.ndarray, *, method: str, **how: Any) -> Solve:
    acceleration = function_of(problem.acceleration)

    def run(rtol: float) -> tuple[np.ndarray, np.ndarray]:
        return tuple(np.array([impact(acceleration, (p,), rtol, method, **how) for p in lanes]).T)

    return run


SCIPY = tuple(
    Way(
        f"scipy {method}",
        "scipy",
        functools.partial(loop, method=method),
        variants={"atol = rtol": {}, "atol = rtol/1000": {"atol": 1e-3}},
        # Implicit steps in Python take a tenth of a second per impact.
        most=5 if method == "Radau" else CHECKED,
        settings=LADDER[:-1] if method == "Radau" else LADDER,
        compiled=False,
    )
    for method in ("DOP853", "LSODA", "Radau")
)
