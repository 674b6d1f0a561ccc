"""Mechanisms with contacts, run time against error: `python -m benchmarks systems`.

A double pendulum beside a wall, up to its fifth touch, and a slider-crank with clearance in a
joint, up to its fifth. Each method runs at several tolerances. The error is that of the time of the
last touch, relative to the duration; the reference is this package at its finest tolerance, whose
digits `tests/test_system/test_agreement.py` compares with published ones. Compile time is left out.
SciPy and plain diffrax are restarted at every event, as a user would; numba is a Dormand-Prince
method of order 5 by hand, with the Illinois method at events. Then follow the time of a lane among
1,000 slider-cranks, and the price of derivatives 3 and 20 contacts deep. Ratios of times in one run
are what counts.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.integrate import RK45, solve_ivp

import jaxcontact as jc
from benchmarks.study import Study, lines
from benchmarks.time_and_error.measure import timed
from benchmarks.until_event import ending, until


class Problem(NamedTuple):
    """A mechanism of the package, the time it runs, and its equations in NumPy.

    `equations(t, q, v)` returns M, Q, gaps, their gradients and their rates ∂g/∂t.
    """

    system: jc.System
    start: dict[str, Any]
    duration: float
    stiffness: float
    alpha: float
    equations: Callable[..., tuple[np.ndarray, ...]]


def pendulum(t, q, v):
    cos, sin = math.cos(q[0] - q[1]), math.sin(q[0] - q[1])
    mass = np.array([[2.0, cos], [cos, 1.0]])
    force = np.array(
        [-sin * v[1] ** 2 - 19.62 * math.sin(q[0]), sin * v[0] ** 2 - 9.81 * math.sin(q[1])]
    )
    x = math.sin(q[0])
    gap = np.array([x + 0.3, x + math.sin(q[1]) + 0.3])
    gradient = np.array([[math.cos(q[0]), 0.0], [math.cos(q[0]), math.cos(q[1])]])
    return mass, force, gap, gradient, np.zeros(2)


SPEED = 523.5987755982989


def crank(t, q, v):
    turn = SPEED * t
    mass = np.array([[2.5e-4 + 0.21 * 0.12**2 / 4, 0.0], [0.0, 0.14]])
    force = np.array([0.21 * 0.05 * 0.12 / 2 * SPEED**2 * math.sin(turn - q[0]), 0.0])
    x = q[1] - 0.05 * math.cos(turn) - 0.12 * math.cos(q[0])
    y = -0.05 * math.sin(turn) - 0.12 * math.sin(q[0])
    r = math.hypot(x, y) or 1e-300
    gradient = -np.array([[(x * 0.12 * math.sin(q[0]) - y * 0.12 * math.cos(q[0])) / r, x / r]])
    rate = -np.array([(x * 0.05 * SPEED * math.sin(turn) - y * 0.05 * SPEED * math.cos(turn)) / r])
    return mass, force, np.array([0.5e-3 - r]), gradient, rate


def problems() -> dict[str, Problem]:
    system, start = jc.systems.double_pendulum()
    joint, stretched = jc.systems.slider_crank()
    alpha = [1.5 * (1 - e) / e for e in (0.7, 0.9)]
    return {
        "double pendulum": Problem(system, start, 5.6, 1e7, alpha[0], pendulum),
        "slider-crank": Problem(joint, stretched, 1.25e-3, 6.6101984e10, alpha[1], crank),
    }


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


TOLERANCES = (1e-5, 1e-7, 1e-9, 1e-11)
PEERS_TOO = (1e-13,)
"""A finer tolerance for peers, whose errors are larger at the same one."""


def ours(problem: Problem, rtol: float) -> Callable[[], jax.Array]:
    how = {"rtol": rtol, "v0": "touch"}
    return lambda: (
        jc.simulate(problem.system, problem.duration, **problem.start, **how).contacts.time
    )


def ours_in_jit(problem: Problem, rtol: float) -> Callable[[], jax.Array]:
    @jax.jit
    def touches(start):
        how = {"rtol": rtol, "v0": "touch", "max_impacts": 12, "throw": False}
        return jc.simulate(problem.system, problem.duration, **start, **how).contacts.time

    return lambda: touches(problem.start)


METHODS = {
    "jaxcontact": ours,
    "jaxcontact, in jit": ours_in_jit,
    "SciPy DOP853, restarted": by_scipy,
    "diffrax Dopri8, restarted": by_diffrax,
    "numba, by hand": by_numba,
}


def seconds_of(call: Callable[[], Any]) -> float:
    return timed(call, compiled=True)[0]["seconds"]


def lanes() -> dict[str, float]:
    """Return the times in ms of one slider-crank of 1.6 ms, and of a lane among 1,000."""

    def touches(clearance):
        system, start = jc.systems.slider_crank(clearance)
        run = jc.simulate(system, 1.6e-3, **start, v0="touch", max_impacts=16, throw=False)
        return run.contacts.time

    single, batch = jax.jit(touches), jax.jit(jax.vmap(touches))
    clearances = jnp.linspace(0.4e-3, 0.6e-3, 1000)
    together = batch(clearances)
    alone = single(clearances[500])
    worst = float(jnp.nanmax(jnp.abs(together[500] - alone)))
    return {
        "alone": 1e3 * seconds_of(lambda: single(clearances[500])),
        "lane": seconds_of(lambda: batch(clearances)),
        "difference_s": worst,
    }


def prices() -> list[dict[str, float]]:
    """Return the times of derivatives by e relative to that of the value, by depth in contacts."""
    rows = []
    for duration, depth in ((2.5, 3), (24.0, 20)):

        def last(e, duration=duration, depth=depth):
            system, start = jc.systems.double_pendulum(law=jc.HuGuo(e=e))
            how = {"v0": "touch", "max_impacts": 32, "throw": False}
            return jc.simulate(system, duration, **start, **how).contacts.time[depth - 1]

        def along(e, last=last):
            return jax.jvp(last, (e,), (1.0,))

        calls = [jax.jit(call) for call in (last, along, jax.grad(last))]
        value, forward, reverse = (seconds_of(lambda call=call: call(0.9)) for call in calls)
        rows.append({"depth": depth, "forward": forward / value, "reverse": reverse / value})
    return rows


def measure_rows(only: str) -> list[dict[str, Any]]:
    rows = []
    for name, problem in problems().items():
        exact = np.asarray(ours(problem, 1e-12)())[4]
        for method, solver in METHODS.items():
            finer = () if method.startswith("jaxcontact") else PEERS_TOO
            for rtol in (*TOLERANCES, *finer) if only in method else ():
                row = {"problem": name, "method": method, "rtol": rtol}
                try:
                    took, touches = timed(solver(problem, rtol), compiled=True)
                except (ImportError, RuntimeError, ValueError) as error:
                    rows.append(row | {"failed": str(error)[:80]})
                    continue
                touches = np.asarray(touches)
                touches = touches[np.isfinite(touches)]
                error = (
                    abs(touches[4] - exact) / problem.duration if len(touches) >= 5 else math.inf
                )
                rows.append(row | {"ms": 1e3 * took["seconds"], "error": float(error)})
                print(rows[-1], flush=True)
    return rows


def table(result: dict[str, Any]) -> str:
    cells = []
    for row in result["rows"]:
        numbers = [f"failed: {row.get('failed')}", ""]
        if "failed" not in row:
            numbers = [f"{row['ms']:.3g}", f"{row['error']:.1e}"]
        cells.append([row["problem"], row["method"], f"{row['rtol']:.0e}", *numbers])
    batch = result["lanes"]
    words = [
        f"\nA slider-crank of 1.6 ms alone: {batch['alone']:.3g} ms; one of 1,000 in a batch: "
        f"{batch['lane']:.3g} ms, with touches within {batch['difference_s']:.0e} s of those alone."
    ]
    words += [
        f"The derivative by e, {row['depth']} contacts deep, takes {row['forward']:.2g} times the "
        f"value forward and {row['reverse']:.2g} times in reverse."
        for row in result["prices"]
    ]
    heads = ["mechanism", "method", "rtol", "ms", "error of the fifth touch"]
    return "\n".join([lines(heads, cells, "---"), *words])


def measure(known: dict | None, only: str) -> dict[str, Any]:
    return {"rows": measure_rows(only), "lanes": lanes(), "prices": prices()}


OPTIONS = {"--only": {"default": "", "help": "methods whose name contains this"}}
STUDY = Study(__file__, __doc__, measure, table, options=OPTIONS)
