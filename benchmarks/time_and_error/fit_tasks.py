"""The data of the fits: tables e(v), and the record of one impact, without noise; and the truth."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from mpmath import mp, mpf
from scipy.integrate import solve_ivp

from tests.oracle._impacts import _log_at_separation

MASS, STIFFNESS, DAMPING = 1.0, 1.4e8, 2e7
SPEEDS = (0.1, 5.0)
DIGITS = 100
"""What the oracle's root carries, so that forty are left."""


def restitution(alpha: float) -> float:
    """e of the law of Hunt and Crossley, from 40 digits."""
    with mp.workdps(DIGITS):
        return float(-mp.expm1(_log_at_separation(mpf(alpha))) / mpf(alpha))


@dataclass(frozen=True)
class Table:
    """c from restitutions at speeds between `SPEEDS`: e depends on α = c v/K alone."""

    name: str = "table"
    title: str = "c from a table e(v)"
    whole: bool = True
    """Whether a row's cost is that of the whole, in ms."""

    def lanes(self, count: int) -> np.ndarray:
        return np.linspace(*SPEEDS, count)

    def data(self, speeds: np.ndarray) -> np.ndarray:
        return _restitutions(tuple((DAMPING * speeds / STIFFNESS).tolist()))

    def errors(self, lanes: np.ndarray, answer: Any) -> dict[str, float]:
        return {"error_c": abs(float(answer) / DAMPING - 1)}


@functools.cache
def _restitutions(alphas: tuple[float, ...]) -> np.ndarray:
    return np.array([restitution(alpha) for alpha in alphas])


class Found(NamedTuple):
    """The numbers of a record: c, K, and the moment of touch; the zero error is found with them."""

    c: float
    stiffness: float
    touch: float


SPEED = 2.0
# X = (m v²/K)^(2/5) and X/v: the units in which the peers solve.
LENGTH = (MASS * SPEED**2 / STIFFNESS) ** 0.4
UNIT = LENGTH / SPEED
TOUCH, OFFSET = 0.9 * UNIT, 0.01
"""The moment of touch, and the zero error of the force in parts of K X^(3/2)."""


@dataclass(frozen=True)
class Record:
    """c, K, touch and zero error from a force F(t) read at even times before, in and after."""

    name: str = "record"
    title: str = "c, K, touch and zero of a record F(t)"
    whole: bool = True

    def lanes(self, count: int) -> np.ndarray:
        """Times in s."""
        return np.linspace(0, 5 * UNIT, count)

    def data(self, times: np.ndarray) -> np.ndarray:
        """The force in N."""
        return _force(times.tobytes())

    def errors(self, lanes: np.ndarray, answer: Found) -> dict[str, float]:
        return {
            "error_c": abs(answer.c / DAMPING - 1),
            "error_stiffness": abs(answer.stiffness / STIFFNESS - 1),
            "error_touch": abs(answer.touch / UNIT - TOUCH / UNIT),
        }


@functools.cache
def _force(times: bytes) -> np.ndarray:
    """The true force, by SciPy from sample to sample at its least tolerance: no interpolant."""
    since = (np.frombuffer(times) - TOUCH) / UNIT
    alpha = DAMPING * SPEED / STIFFNESS

    def rate(t, y):
        x = max(y[0], 0.0)
        return y[1], -(x**1.5) * (1 + alpha * y[1])

    # Shortly after touch a series is more accurate than steps, which the power 3/2 shortens there.
    t = 1e-5
    x, v = _first(t, alpha)
    state = np.array([x, v])
    force = np.zeros(since.size)
    for k, moment in enumerate(since):
        if moment <= t:
            if moment > 0:
                x, v = _first(moment, alpha)
                force[k] = x**1.5 * (1 + alpha * v)
            continue
        found = solve_ivp(rate, (t, moment), state, "DOP853", rtol=2.3e-14, atol=1e-16)
        t, state = moment, found.y[:, -1]
        if state[0] <= 0:
            break
        force[k] = state[0] ** 1.5 * (1 + alpha * state[1])
    return STIFFNESS * LENGTH**1.5 * (force + OFFSET)


def _first(t: float, alpha: float) -> tuple[float, float]:
    """x and v soon after touch: v = 1 - (1 + α) (2/5) t^(5/2), an error of t^5."""
    speed = 0.4 * (1 + alpha) * t**2.5
    return t - speed * t / 3.5, 1 - speed
