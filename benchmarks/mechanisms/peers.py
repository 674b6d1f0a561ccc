"""Mechanisms by what a user would write for them: solvers that are restarted at every event."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from scipy.integrate import RK45, solve_ivp

from ..until_event import ending, until
from .problems import Problem


def by_scipy(problem: Problem, rtol: float) -> Callable[[], list[float]]:
    """SciPy's DOP853, restarted at every event."""
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


def by_diffrax(problem: Problem, rtol: float) -> Callable[[], jax.Array]:
    """Plain diffrax: a scan over phases, each one solve that ends where a gap changes its sign."""
    system, n = problem.system, problem.start["position"].shape[0]
    m = system.gap(0.0, problem.start["position"], None).shape[0]

    def gaps(t, y):
        return jax.jvp(lambda t, q: system.gap(t, q, None), (t, y[:n]), (jnp.ones_like(t), y[n:]))

    def right(t, y, args):
        closed, speed = args
        rate, pull, gap = jax.vjp(
            lambda v: gaps(t, jnp.concatenate([y[:n], v]))[::-1], y[n:], has_aux=True
        )
        push = problem.stiffness * jnp.maximum(-gap, 0) ** 1.5
        push = jnp.where(closed, push * (1 - problem.alpha * rate / speed), 0)
        force = system.force(t, y[:n], y[n:], None) + pull(push)[0]
        return jnp.concatenate([y[n:], jnp.linalg.solve(system.mass(t, y[:n], None), force)])

    def condition(k):
        def of(t, y, args, **_):
            return jnp.where(args[0][k], -1, 1) * system.gap(t, y[:n], None)[k]

        return of

    ends = [condition(k) for k in range(m)]

    def phase(carry, _):
        t, y, closed, speed = carry
        # A small step off the event that has just been met.
        end = until(
            right, y, ends, rtol, args=(closed, speed), start=t, stop=problem.duration,
            first=1e-9 * problem.duration, newton=1e-12, most=10_000,
        )  # fmt: skip
        t, y = end.ts[-1], end.ys[-1]
        met = jnp.stack(end.event_mask) & (t < problem.duration)
        touches = met & ~closed
        speed = jnp.where(touches, -gaps(t, y)[1], speed)
        return (t, y, closed ^ met, speed), jnp.where(jnp.any(touches), t, jnp.inf)

    @jax.jit
    def run(q, v):
        start = jnp.zeros(()), jnp.concatenate([q, v]), jnp.zeros(m, bool), jnp.ones(m)
        return jax.lax.scan(phase, start, length=12)[1]

    q, v = problem.start["position"], problem.start["velocity"]
    return lambda: run(q, v)


def by_numba(problem: Problem, rtol: float) -> Callable[[], list[float]]:
    """A Dormand-Prince method of order 5 in numba, with the Illinois method at events."""
    import numba

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
