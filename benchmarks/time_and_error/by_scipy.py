"""scipy.integrate.solve_ivp with an event, one impact after another."""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np

from ..until_event import contact
from .measure import LADDER, Solve, Way
from .problems import CHECKED, Problem, function_of


def impact(
    acceleration: Any, numbers: tuple[float, ...], rtol: float, method: str, atol: float = 1.0
) -> tuple[float, float]:
    """e and duration of one lane; NaN where no end was found. `atol` in units of `rtol`."""
    end = contact(
        lambda x, v: acceleration(x, math.sqrt(x), v, *numbers), rtol, method=method, atol=atol
    )
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
