"""Balls in a line with Luding's contacts, by SciPy from event to event.

A contact k acts between balls k and k+1, with δ = -(gap + x_{k+1} - x_k). It loads along K δ. From
its largest indentation m it follows κK (δ - m + m/κ), and -ηK δ from where the two meet. A contact
that closes again from there has a smaller m, of which that place is the meeting point.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

RTOL = 1e-12
LOADS, UNLOADS, ADHERES = range(3)


class Powder(NamedTuple):
    """K, κ = `ratio` + `slope` m, and η."""

    stiffness: float
    ratio: float
    slope: float
    adhesion: float

    def factor(self, memory: float) -> float:
        return self.ratio + self.slope * memory

    def meeting(self, memory: float) -> float:
        factor = self.factor(memory)
        return memory * (factor - 1) / (factor + self.adhesion)

    def shrunk(self, depth: float, memory: float) -> float:
        return brentq(lambda m: self.meeting(m) - depth, depth, memory, xtol=1e-18, rtol=1e-14)

    def force(self, depth: float, memory: float, phase: int) -> float:
        if phase == LOADS:
            return self.stiffness * depth
        if phase == ADHERES:
            return -self.stiffness * self.adhesion * depth
        return self.stiffness * (memory - self.factor(memory) * (memory - depth))


class Followed(NamedTuple):
    """Positions and velocities at the end, and the numbers of openings and of shrunk memories."""

    position: np.ndarray
    velocity: np.ndarray
    openings: int
    shrunk: int


def follow(
    powders: Sequence[Powder],
    mass: Sequence[float],
    gaps: Sequence[float],
    velocity: Sequence[float],
    duration: float,
    push: Callable[[float], Any] = lambda t: 0.0,
) -> Followed:
    """Follow balls from positions 0 relative to their start; `push` are accelerations in m/s²."""
    masses, space, n = np.asarray(mass, float), np.asarray(gaps, float), len(mass)
    y, t = np.concatenate([np.zeros(n), np.asarray(velocity, float)]), 0.0
    closed, phase, memory = [False] * (n - 1), [LOADS] * (n - 1), [0.0] * (n - 1)
    openings = shrunk = 0

    def depth(y: np.ndarray, k: int) -> float:
        return y[k] - y[k + 1] - space[k]

    def rate(y: np.ndarray, k: int) -> float:
        return y[n + k] - y[n + k + 1]

    def motion(t: float, y: np.ndarray) -> np.ndarray:
        force = [
            powders[k].force(depth(y, k), memory[k], phase[k]) if closed[k] else 0.0
            for k in range(n - 1)
        ]
        pushed = np.append(0, force) - np.append(force, 0)
        return np.concatenate([y[n:], pushed / masses + push(t)])

    def gap(y: np.ndarray, k: int, kind: int) -> float:
        """Kind 0 opens or closes; kind 1 turns, reloads or turns back; kind 2 begins to adhere."""
        if kind == 0:
            return depth(y, k) if closed[k] else -depth(y, k)
        if not closed[k] or (kind == 2 and phase[k] != UNLOADS):
            return 1.0
        if kind == 2:
            return depth(y, k) - powders[k].meeting(memory[k])
        if phase[k] == UNLOADS:
            return memory[k] - depth(y, k)
        return rate(y, k) if phase[k] == LOADS else -rate(y, k)

    while True:
        events = []
        for k in range(n - 1):
            for kind in range(3):

                def at(t: float, y: np.ndarray, k: int = k, kind: int = kind) -> float:
                    return gap(y, k, kind)

                at.terminal, at.direction = True, -1
                events.append(at)
        found = solve_ivp(
            motion, (t, duration), y, method="DOP853", rtol=RTOL, atol=1e-18, events=events,
            max_step=duration / 200,
        )  # fmt: skip
        t, y = found.t[-1], found.y[:, -1]
        if found.status == 0:
            return Followed(y[:n], y[n:], openings, shrunk)
        for number, times in enumerate(found.t_events):
            k, kind = divmod(number, 3)
            if not len(times):
                continue
            if kind == 0:
                openings += closed[k]
                closed[k], phase[k], memory[k] = not closed[k], LOADS, 0.0
            elif kind == 2:
                phase[k] = ADHERES
            elif phase[k] == LOADS:
                phase[k], memory[k] = UNLOADS, depth(y, k)
            elif phase[k] == UNLOADS:
                phase[k], memory[k] = LOADS, 0.0
            else:
                phase[k], memory[k] = UNLOADS, powders[k].shrunk(depth(y, k), memory[k])
                shrunk += 1
