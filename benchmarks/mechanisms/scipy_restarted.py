"""SciPy's DOP853, restarted at every event."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp

from ..until_event import ending
from .problems import Problem


def call_of(problem: Problem, rtol: float) -> Callable[[], list[float]]:
    q0, v0 = (np.asarray(problem.start[name]) for name in ("position", "velocity"))
    n = len(q0)

    def run() -> list[float]:
        t, y, touches = 0.0, np.concatenate([q0, v0]), []
        m = len(problem.equations(0.0, q0, v0)[2])
        closed, speed = np.zeros(m, bool), np.ones(m)

        def right(t, y):
            mass, force, gap, gradient, rate = problem.equations(t, y[:n], y[n:])
            closing = -(gradient @ y[n:] + rate)
            push = problem.stiffness * np.maximum(-gap, 0) ** 1.5
            push = np.where(closed, push * (1 + problem.alpha * closing / speed), 0)
            return np.concatenate([y[n:], np.linalg.solve(mass, force + gradient.T @ push)])

        def event_of(k):
            side = 1 if closed[k] else -1
            return ending(lambda t, y: problem.equations(t, y[:n], y[n:])[2][k], side)

        while t < problem.duration:
            events = [event_of(k) for k in range(m)]
            end = solve_ivp(
                right,
                (t, problem.duration),
                y,
                "DOP853",
                rtol=rtol,
                atol=rtol * 1e-3,
                # Else the first step across a contact may overflow, and is accepted.
                first_step=min(1e-6 * problem.duration, problem.duration - t),
                events=events,
            )
            t, y = end.t[-1], end.y[:, -1]
            for k in range(m):
                if len(end.t_events[k]):
                    closed[k] = not closed[k]
                    if closed[k]:
                        _, _, _, gradient, rate = problem.equations(t, y[:n], y[n:])
                        speed[k] = -(gradient @ y[n:] + rate)[k]
                        touches.append(t)
        return touches

    return run
