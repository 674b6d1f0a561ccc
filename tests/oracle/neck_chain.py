"""Balls in a line with necks of Johnson, Kendall and Roberts, by SciPy from event to event.

A contact k acts between balls k and k+1, with δ = -(gap + x_{k+1} - x_k). Its force is that of the
contact radius a, as published: it forms at δ = 0 and snaps where dδ/da = 0.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

RTOL = 1e-12
LOSS = 7.09219597186
"""The energy lost by a neck, in units of (w⁵ R⁴/E*²)^(1/3)."""


class Neck(NamedTuple):
    """A contact with the work of adhesion w, the radius R and the modulus E*."""

    work: float
    radius: float
    modulus: float

    @property
    def pull_off(self) -> float:
        return 1.5 * np.pi * self.work * self.radius

    @property
    def stiffness(self) -> float:
        return 4 / 3 * self.modulus * np.sqrt(self.radius)

    @property
    def lost(self) -> float:
        return LOSS * np.cbrt(self.work**5 * self.radius**4 / self.modulus**2)

    @property
    def snap(self) -> float:
        """The δ at which the neck snaps."""
        return -0.75 * np.cbrt(np.pi**2 * self.work**2 * self.radius / self.modulus**2)

    def force(self, depth: float) -> float:
        # δ = a²/R - √(2πw a/E*) is a quartic in √a.
        pull = np.sqrt(2 * np.pi * self.work / self.modulus)
        roots = np.roots([1 / self.radius, 0, 0, -pull, -max(depth, self.snap * (1 - 1e-14))])
        a = max(roots[np.abs(roots.imag) < 1e-9 * np.abs(roots)].real) ** 2
        adhesion = np.sqrt(8 * np.pi * self.work * self.modulus * a**3)
        return 4 * self.modulus * a**3 / (3 * self.radius) - adhesion


class Followed(NamedTuple):
    """The state at the end, and the moments at which each contact begins and ends."""

    position: np.ndarray
    velocity: np.ndarray
    moments: list[list[float]]


def follow(
    necks: Sequence[Neck],
    mass: Sequence[float],
    gaps: Sequence[float],
    velocity: Sequence[float],
    duration: float,
    push: Callable[[float], Any] = lambda t: 0.0,
) -> Followed:
    """Follow balls from positions 0 relative to their start; `push` are accelerations in m/s²."""
    masses, space, n = np.asarray(mass, float), np.asarray(gaps, float), len(mass)
    y, t = np.concatenate([np.zeros(n), np.asarray(velocity, float)]), 0.0
    closed, moments = [False] * (n - 1), [[] for _ in necks]

    def depth(y: np.ndarray, k: int) -> float:
        return y[k] - y[k + 1] - space[k]

    def motion(t: float, y: np.ndarray) -> np.ndarray:
        force = [necks[k].force(depth(y, k)) if closed[k] else 0.0 for k in range(n - 1)]
        pushed = np.append(0, force) - np.append(force, 0)
        return np.concatenate([y[n:], pushed / masses + push(t)])

    def event(k: int) -> Any:
        end = necks[k].snap if closed[k] else 0.0

        def at(t: float, y: np.ndarray) -> float:
            return depth(y, k) - end

        at.terminal, at.direction = True, -1 if closed[k] else 1
        return at

    while True:
        found = solve_ivp(
            motion, (t, duration), y, method="DOP853", rtol=RTOL, atol=1e-15,
            events=[event(k) for k in range(n - 1)], max_step=duration / 100,
        )  # fmt: skip
        t, y = found.t[-1], found.y[:, -1]
        if found.status == 0:
            return Followed(y[:n], y[n:], moments)
        for k, times in enumerate(found.t_events):
            if len(times):
                closed[k] = not closed[k]
                moments[k].append(t)
