"""Scenes by other means: a ball that bounces to rest, one on a shaking table, a gas of 32 discs.

Each has its truth, the package's solution, and a physicist's code with SciPy or numba.
"""

from __future__ import annotations

import functools
import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from mpmath import mp, mpf
from scipy.integrate import solve_ivp

import jaxcontact as jc
from tests.oracle import with_gravity
from tests.oracle.moving_table import FREQUENCY, GRAVITY, RATE, bounces, over, sine

from .by_numba import kernel
from .by_scipy import apart

# A ball that falls and comes to rest: seven or eight bounces, with increasing effect of its weight.
HEIGHT, DAMPING, STIFFNESS = 0.05, 0.6, 1e4
MOST = 20
AMPLITUDE, PHASE, DROP, E, LENGTH = 1e-4, 0.3, 0.02, 0.8, 0.5
GAS, CELL, DURATION = 32, 8.0, 3.0


def rest_by_package(rtol: float) -> float:
    law, contact = jc.Damped(alpha=DAMPING), jc.Contact(mass=1.0, stiffness=STIFFNESS)
    how: dict[str, Any] = {"gravity_in_contact": True, "bounces": MOST}
    return _bounce()(law, contact, HEIGHT, method=jc.Event(rtol=rtol), **how)


@functools.cache
def _bounce() -> Any:
    def run(law, contact, height, *, method, gravity_in_contact, bounces):
        found = jc.bounce(
            law, contact, height, gravity=GRAVITY, method=method,
            gravity_in_contact=gravity_in_contact, bounces=bounces, v0="touch",
        )  # fmt: skip
        return found.rest_time

    return jax.jit(run, static_argnames=("method", "gravity_in_contact", "bounces"))


def rest(one: Any) -> float:
    """When the ball stays, by `one(push)` → e and duration, scaled; e is 0 for what stays."""
    v, t = math.sqrt(2 * GRAVITY * HEIGHT), math.sqrt(2 * HEIGHT / GRAVITY)
    for _ in range(MOST):
        length = (v * v / STIFFNESS) ** 0.4
        e, duration = one(GRAVITY * length / (v * v))
        if e == 0:
            return t
        t += duration * length / v + 2 * e * v / GRAVITY
        v *= e
    return math.inf


def rest_by_scipy(rtol: float) -> float:
    def one(push):
        def rate(t, y):
            x, v = y.tolist()
            x = max(x, 0.0)
            return v, push - x * math.sqrt(x) * max(1 + DAMPING * v, 0.0)

        def turns(t, y):
            return y[1]

        turns.terminal, turns.direction = True, 1
        end = solve_ivp(
            rate, (0, 1e3), (0, 1), "DOP853", events=(apart, turns), rtol=rtol, atol=rtol,
            first_step=0.01,
        )  # fmt: skip
        if end.t_events[0].size == 0:
            return 0.0, math.inf
        return -end.y_events[0][0, 1], end.t_events[0][0]

    return rest(one)


def rest_by_numba(rtol: float) -> float:
    text = f"g - x * s * max(1 + {DAMPING} * v, 0.0)"
    run = kernel(text, "g", "eighth", True, False, True)
    table = np.empty((1, 1))

    def one(push):
        table[0, 0] = push
        e, duration = run(table, rtol)
        return e[0], duration[0]

    return rest(one)


@functools.cache
def rest_truth() -> float:
    """In 40 digits, up to the numbers of the problem, which are floats."""
    with mp.workdps(40):
        g, height, stiffness = mpf(GRAVITY), mpf(HEIGHT), mpf(STIFFNESS)
        v, t = mp.sqrt(2 * g * height), mp.sqrt(2 * height / g)
        for _ in range(MOST):
            length = (v * v / stiffness) ** mpf("0.4")
            hit = with_gravity(DAMPING, 1.5, g * length / (v * v))
            if hit.settled:
                return float(t)
            t += hit.duration * length / v + 2 * hit.e * v / g
            v *= hit.e
    raise ArithmeticError(f"the ball still bounces after {MOST} bounces")


@functools.cache
def _table() -> Any:
    def run(height):
        shake = jc.Vibration(AMPLITUDE, FREQUENCY, PHASE)
        scene = over(shake, height, jc.ExactRestitution(e=E))
        return jc.simulate(scene, LENGTH, instantaneous=True, max_impacts=16).velocity[-1, 0, 0]

    return jax.jit(run)


def table_by_package(rtol: float) -> jax.Array:
    return _table()(jnp.asarray(DROP))


def table_by_scipy(rtol: float) -> float:
    """Flights by solve_ivp up to the event of a touch."""
    place, speed = sine(AMPLITUDE, PHASE)

    def gap(t, y):
        return y[0] - place(t)

    gap.terminal, gap.direction = True, -1
    t, y = 0.0, np.array([DROP, 0.0])
    while t < LENGTH:
        # A longer step would miss a touch of a shaking table.
        found = solve_ivp(
            lambda t, y: (y[1], -GRAVITY), (t, LENGTH), y, "DOP853", events=gap,
            rtol=rtol, atol=1e-3 * rtol, max_step=0.1 / FREQUENCY,
        )  # fmt: skip
        t, y = found.t[-1], found.y[:, -1]
        if found.status == 1:
            moves = speed(t)
            y[1] = moves + E * (moves - y[1])
    return y[1]


_TABLE_CODE = """
def gap(s, t, z, v):
    f = s - t
    return z + v * f - 0.5 * g * f * f - a * sin(rate * s + phase)

def table(drop, step):
    t, z, v = 0.0, drop, 0.0
    while True:
        s, before = t, 1.0
        while True:
            s = min(s + step, end)
            now = gap(s, t, z, v)
            if now <= 0 and before > 0 and s > t + step:
                break
            if s >= end:
                return v - g * (end - t)
            before = now
        low, high = s - step, s
        for _ in range(200):
            middle = 0.5 * (low + high)
            if gap(middle, t, z, v) > 0:
                low = middle
            else:
                high = middle
            if high - low <= 1e-16 * high:
                break
        wall = a * rate * cos(rate * high + phase)
        v = wall + e * (wall - (v - g * (high - t)))
        t, z = high, a * sin(rate * high + phase)
"""


@functools.cache
def _table_code() -> Any:
    import numba

    scope: dict[str, Any] = {
        "sin": math.sin, "cos": math.cos, "g": GRAVITY, "a": AMPLITUDE, "rate": RATE,
        "phase": PHASE, "e": E, "end": LENGTH,
    }  # fmt: skip
    exec(_TABLE_CODE, scope)
    scope["gap"] = numba.njit(scope["gap"])
    return numba.njit(scope["table"])


def table_by_numba(steps: float) -> float:
    return _table_code()(DROP, 1 / FREQUENCY / 50)


@functools.cache
def table_truth() -> float:
    return bounces(sine(AMPLITUDE, PHASE), DROP, E, LENGTH)[2]


@functools.cache
def gas() -> tuple[np.ndarray, np.ndarray]:
    """Places and velocities of discs of unit diameter and mass in a periodic cell."""
    discs = jc.random_spheres(
        GAS, low=[0.0, 0.0], high=[CELL, CELL], radius=0.5, mass=1.0, periodic=[CELL, CELL],
        speed=1.0, seed=0,
    )  # fmt: skip
    return tuple(np.array([np.asarray(getattr(d, k)) for d in discs]) for k in _STATE)


_STATE = ("position", "velocity")


@functools.cache
def _gas() -> Any:
    place, _ = gas()

    def run(velocity):
        discs = [jc.Sphere(0.5, 1.0, x, v) for x, v in zip(place, velocity, strict=True)]
        scene = jc.Scene(discs, jc.ExactRestitution(e=1.0), periodic=[CELL, CELL])
        found = jc.simulate(scene, DURATION, instantaneous=True, max_impacts=256)
        return found.velocity[-1]

    return jax.jit(run)


def gas_by_package(rtol: float) -> jax.Array:
    return _gas()(jnp.asarray(gas()[1]))


def _collide(x: Any, v: Any, duration: float) -> Any:
    """Elastic discs from impact to impact, every pair searched anew; numba compiles it."""
    count, t = len(x), 0.0
    while True:
        soonest, first, second = duration - t, -1, -1
        for i in range(count):
            for j in range(i):
                dx, dy = x[i, 0] - x[j, 0], x[i, 1] - x[j, 1]
                wx, wy = v[i, 0] - v[j, 0], v[i, 1] - v[j, 1]
                # The pair and its images in the neighbouring cells.
                for k in range(-1, 2):
                    for m in range(-1, 2):
                        px = dx - CELL * (math.floor(dx / CELL + 0.5) + k)
                        py = dy - CELL * (math.floor(dy / CELL + 0.5) + m)
                        b = px * wx + py * wy
                        if b < 0:
                            w = wx * wx + wy * wy
                            root = b * b - w * (px * px + py * py - 1)
                            if root > 0:
                                wait = (-b - math.sqrt(root)) / w
                                if wait < soonest:
                                    soonest, first, second = wait, i, j
        for i in range(count):
            x[i, 0] += v[i, 0] * soonest
            x[i, 1] += v[i, 1] * soonest
        t += soonest
        if first < 0:
            return v
        px, py = x[first, 0] - x[second, 0], x[first, 1] - x[second, 1]
        px -= CELL * math.floor(px / CELL + 0.5)
        py -= CELL * math.floor(py / CELL + 0.5)
        size = px * px + py * py
        b = px * (v[first, 0] - v[second, 0]) + py * (v[first, 1] - v[second, 1])
        for k, sign in ((first, -1), (second, 1)):
            v[k, 0] += sign * b * px / size
            v[k, 1] += sign * b * py / size


@functools.cache
def _gas_code() -> Any:
    import numba

    return numba.njit(_collide)


def gas_by_numba(rtol: float) -> np.ndarray:
    place, velocity = gas()
    return _gas_code()(place.copy(), velocity.copy(), DURATION)


@functools.cache
def gas_truth() -> np.ndarray:
    """All pairs and images at once in extended precision, which leaves rounding no room to grow."""
    x, v = (rows.astype(np.longdouble) for rows in gas())
    first, second = np.triu_indices(GAS, 1)
    images = CELL * np.stack(np.meshgrid(*[np.arange(-1, 2)] * 2), -1).reshape(1, 9, 2)
    left = np.longdouble(DURATION)
    while True:
        apart = x[first] - x[second]
        apart = (apart - CELL * np.round(apart / CELL))[:, None] - images
        closing = (v[first] - v[second])[:, None]
        b, w = np.sum(apart * closing, -1), np.sum(closing * closing, -1)
        square = b * b - w * (np.sum(apart * apart, -1) - 1)
        meets = (b < 0) & (square > 0)
        waits = np.where(meets, (-b - np.sqrt(np.where(meets, square, 0))) / w, np.inf)
        pair = np.argmin(waits.min(axis=1))
        wait = min(waits[pair].min(), left)
        x, left = x + v * wait, left - wait
        if left <= 0:
            return v.astype(float)
        i, j = first[pair], second[pair]
        apart = x[i] - x[j]
        apart -= CELL * np.round(apart / CELL)
        change = apart * np.sum(apart * (v[i] - v[j])) / np.sum(apart * apart)
        v[i], v[j] = v[i] - change, v[j] + change
