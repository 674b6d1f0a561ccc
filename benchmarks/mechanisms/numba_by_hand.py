"""A Dormand-Prince method of order 5 in numba, with the Illinois method at events."""

from __future__ import annotations

from collections.abc import Callable

import numba
import numpy as np
from scipy.integrate import RK45

from .problems import Problem


def call_of(problem: Problem, rtol: float) -> Callable[[], list[float]]:
    equations = numba.njit(problem.equations)
    stiffness, alpha = problem.stiffness, problem.alpha
    nodes, weights = np.append(RK45.C, 1.0), np.vstack([np.pad(RK45.A, ((0, 0), (0, 1))), RK45.B])
    differs = -RK45.E

    @numba.njit
    def right(t, y, closed, speed):
        mass, force, gap, gradient, rate = equations(t, y[:2], y[2:])
        for k in range(len(gap)):
            if closed[k] and gap[k] < 0:
                closing = -(gradient[k, 0] * y[2] + gradient[k, 1] * y[3] + rate[k])
                push = stiffness * (-gap[k]) ** 1.5 * (1 + alpha * closing / speed[k])
                force = force + gradient[k] * push
        a, b, c, d = mass[0, 0], mass[0, 1], mass[1, 0], mass[1, 1]
        det = a * d - b * c
        x = (d * force[0] - b * force[1]) / det
        return np.array([y[2], y[3], x, (a * force[1] - c * force[0]) / det])

    @numba.njit
    def step(t, y, h, closed, speed):
        slopes = np.zeros((7, 4))
        end = y
        for i in range(7):
            end = y.copy()
            for j in range(i):
                end += h * weights[i, j] * slopes[j]
            slopes[i] = right(t + nodes[i] * h, end, closed, speed)
        return end, h * (differs @ slopes)

    @numba.njit
    def run(q, v, duration, rtol):
        t, y = 0.0, np.concatenate((q, v))
        m = len(equations(t, q, v)[2])
        closed, speed = np.zeros(m, np.bool_), np.ones(m)
        size = np.maximum(np.abs(y), 1e-3)
        touches = [0.0]
        h = 1e-6 * duration
        while t < duration:
            h = min(h, duration - t)
            end, error = step(t, y, h, closed, speed)
            wrong = np.max(np.abs(error) / (rtol * size))
            if not wrong <= 1:
                # Also where a stage has overflowed.
                h *= max(0.2, 0.9 * wrong**-0.2) if wrong < 1e9 else 0.2
                continue
            size = np.maximum(size, np.abs(end))
            gap = equations(t + h, end[:2], end[2:])[2]
            first, which = h, -1
            for k in range(m):
                sign = 1.0 if closed[k] else -1.0
                if sign * gap[k] <= 0:
                    continue
                low, high = 0.0, h
                below = sign * equations(t, y[:2], y[2:])[2][k]
                above = sign * gap[k]
                # On the event up to rounding, after an event of its own.
                below = min(below, -1e-300)
                for _ in range(100):
                    part = high - above * (high - low) / (above - below)
                    trial, _ = step(t, y, part, closed, speed)
                    value = sign * equations(t + part, trial[:2], trial[2:])[2][k]
                    if value > 0:
                        high, above, below = part, value, below / 2
                    else:
                        low, below, above = part, value, above / 2
                    if high - low < 1e-15 * duration or value == 0:
                        break
                if high < first:
                    first, which = high, k
            if which >= 0:
                end, _ = step(t, y, first, closed, speed)
                closed[which] = not closed[which]
                if closed[which]:
                    _, _, _, gradient, rate = equations(t + first, end[:2], end[2:])
                    speed[which] = -(
                        gradient[which, 0] * end[2] + gradient[which, 1] * end[3] + rate[which]
                    )
                    touches.append(t + first)
            t, y = t + first, end
            h *= min(5.0, 0.9 * (wrong + 1e-12) ** -0.2)
        return touches[1:]

    q, v = (np.asarray(problem.start[name]) for name in ("position", "velocity"))
    return lambda: list(run(q, v, problem.duration, rtol))
