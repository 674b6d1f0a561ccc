"""Mechanisms with contacts, run time against error: `python benchmarks/systems.py`.

A double pendulum beside a wall, up to its fifth touch, and a slider-crank with clearance in a
joint, up to its fifth. Each method runs at several tolerances. The error is that of the time of the
last touch, relative to the duration; the reference is this package at its finest tolerance, whose
digits `tests/test_system/test_published.py` compares with published ones. Compile time is left out.
SciPy and plain diffrax are restarted at every event, as a user would; numba is a Dormand-Prince
method of order 5 by hand, with the Illinois method at events. Then follow the time of a lane among
1,000 slider-cranks, and the price of derivatives 3 and 20 contacts deep. Ratios of times in one run
are what counts. `--page` prints the tables of the last run.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp
import numpy as np

import jaxcontact as jc

RESULT = Path(__file__).with_suffix(".json")
REPEATS = 5


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


def best(call: Callable[[], Any]) -> float:
    """Return the shortest time of some calls in s."""
    times = []
    for _ in range(REPEATS):
        begun = time.perf_counter()
        call()
        times.append(time.perf_counter() - begun)
    return min(times)


def ours(problem: Problem, rtol: float) -> tuple[float, list[float]]:
    def run():
        return jc.simulate(problem.system, problem.duration, **problem.start, rtol=rtol, v0="touch")

    result = run()
    return best(lambda: jax.block_until_ready(run().contacts.time)), list(result.contacts.time)


def ours_in_jit(problem: Problem, rtol: float) -> tuple[float, list[float]]:
    def touches(start):
        how = {"rtol": rtol, "v0": "touch", "max_impacts": 12, "throw": False}
        return jc.simulate(problem.system, problem.duration, **start, **how).contacts.time

    call = jax.jit(touches)
    times = np.asarray(call(problem.start))
    seconds = best(lambda: jax.block_until_ready(call(problem.start)))
    return seconds, list(times[np.isfinite(times)])


def by_scipy(problem: Problem, rtol: float) -> tuple[float, list[float]]:
    from scipy.integrate import solve_ivp

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
            def event(t, y):
                return problem.equations(t, y[:n], y[n:])[2][k]

            event.terminal, event.direction = True, 1 if closed[k] else -1
            return event

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

    touches = run()
    return best(run), touches


def by_diffrax(problem: Problem, rtol: float) -> tuple[float, list[float]]:
    """A scan over phases, each one solve that ends where any gap changes its sign."""
    import diffrax
    import optimistix

    system, n = problem.system, problem.start["position"].shape[0]
    solver, root = diffrax.Dopri8(), optimistix.Newton(1e-12, 1e-12)
    control = diffrax.PIDController(rtol=rtol, atol=rtol * 1e-3)
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

    event = diffrax.Event([condition(k) for k in range(m)], root, direction=False)

    def phase(carry, _):
        t, y, closed, speed = carry
        # A small step off the event that has just been met.
        first = 1e-9 * problem.duration
        end = diffrax.diffeqsolve(
            diffrax.ODETerm(right),
            solver,
            t,
            problem.duration,
            first,
            y,
            args=(closed, speed),
            event=event,
            stepsize_controller=control,
            max_steps=10_000,
            throw=False,
        )
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
    touches = np.asarray(run(q, v))
    return best(lambda: jax.block_until_ready(run(q, v))), list(touches[np.isfinite(touches)])


def by_numba(problem: Problem, rtol: float) -> tuple[float, list[float]]:
    import numba

    equations = numba.njit(problem.equations)
    stiffness, alpha = problem.stiffness, problem.alpha
    nodes = np.array([0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1, 1])
    weights = np.zeros((7, 6))
    weights[1, :1] = [1 / 5]
    weights[2, :2] = [3 / 40, 9 / 40]
    weights[3, :3] = [44 / 45, -56 / 15, 32 / 9]
    weights[4, :4] = [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729]
    weights[5, :5] = [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656]
    weights[6] = [35 / 384, 0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84]
    lower = [5179 / 57600, 0, 7571 / 16695, 393 / 640, -92097 / 339200, 187 / 2100, 1 / 40]
    differs = np.append(weights[6], 0) - np.array(lower)

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
    touches = run(q, v, problem.duration, rtol)
    return best(lambda: run(q, v, problem.duration, rtol)), list(touches)


METHODS: dict[str, tuple[Callable[..., tuple[float, list[float]]], tuple[float, ...]]] = {
    "jaxcontact": (ours, (1e-5, 1e-7, 1e-9, 1e-11)),
    "jaxcontact, in jit": (ours_in_jit, (1e-5, 1e-7, 1e-9, 1e-11)),
    "SciPy DOP853, restarted": (by_scipy, (1e-5, 1e-7, 1e-9, 1e-11)),
    "diffrax Dopri8, restarted": (by_diffrax, (1e-5, 1e-7, 1e-9, 1e-11)),
    "numba, by hand": (by_numba, (1e-5, 1e-7, 1e-9, 1e-11)),
}


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
        "alone": 1e3 * best(lambda: jax.block_until_ready(single(clearances[500]))),
        "lane": best(lambda: jax.block_until_ready(batch(clearances))),
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
        for call in calls:
            call(0.9)
        value, forward, reverse = (
            best(lambda call=call: jax.block_until_ready(call(0.9))) for call in calls
        )
        rows.append({"depth": depth, "forward": forward / value, "reverse": reverse / value})
    return rows


def measure(only: str) -> list[dict[str, Any]]:
    rows = []
    for name, problem in problems().items():
        _, exact = ours(problem, 1e-12)
        for method, (solve, tolerances) in METHODS.items():
            if only not in method:
                continue
            for rtol in tolerances:
                try:
                    seconds, touches = solve(problem, rtol)
                except Exception as error:  # a peer may fail; the table says so
                    rows.append(
                        {"problem": name, "method": method, "rtol": rtol, "failed": str(error)[:80]}
                    )
                    continue
                same = len(touches) >= 5
                error = float(abs(touches[4] - exact[4]) / problem.duration) if same else math.inf
                rows.append(
                    {
                        "problem": name,
                        "method": method,
                        "rtol": rtol,
                        "ms": 1e3 * seconds,
                        "error": error,
                    }
                )
                print(rows[-1], flush=True)
    return rows


def table(result: dict[str, Any]) -> str:
    lines = [
        "| mechanism | method | rtol | ms | error of the fifth touch |",
        "|---|---|---|---|---|",
    ]
    for row in result["rows"]:
        if "failed" in row:
            numbers = f"failed: {row['failed']} |"
        else:
            numbers = f"{row['ms']:.3g} | {row['error']:.1e}"
        lines.append(f"| {row['problem']} | {row['method']} | {row['rtol']:.0e} | {numbers} |")
    batch = result["lanes"]
    lines.append(
        f"\nA slider-crank of 1.6 ms alone: {batch['alone']:.3g} ms; one of 1,000 in a batch: "
        f"{batch['lane']:.3g} ms, with touches within {batch['difference_s']:.0e} s of those alone."
    )
    lines += [
        f"The derivative by e, {row['depth']} contacts deep, takes {row['forward']:.2g} times the "
        f"value forward and {row['reverse']:.2g} times in reverse."
        for row in result["prices"]
    ]
    return "\n".join(lines)


def main(words: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="methods whose name contains this")
    parser.add_argument("--page", action="store_true", help="print the table of the last run")
    parser.add_argument("--out", type=Path, default=RESULT, help="the JSON file")
    arguments = parser.parse_args(words)
    if not arguments.page:
        result = {"rows": measure(arguments.only), "lanes": lanes(), "prices": prices()}
        arguments.out.write_text(json.dumps(result, indent=1) + "\n")
    print(table(json.loads(arguments.out.read_text())))


if __name__ == "__main__":
    main()
