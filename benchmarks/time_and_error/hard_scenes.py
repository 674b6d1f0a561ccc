"""Scenes by other means: a ball that bounces to rest, and one on a shaking table.

Each has its truth, the package's solution, and a physicist's code with SciPy, numba or diffrax.
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
from benchmarks.time_and_error.by_numba import kernel
from benchmarks.until_event import apart, contact, ending, until
from tests.oracle import with_gravity
from tests.oracle.moving_table import FREQUENCY, GRAVITY, RATE, bounces, over, sine

# A ball that falls and comes to rest: seven or eight bounces, with increasing effect of its weight.
HEIGHT, DAMPING, STIFFNESS = 0.05, 0.6, 1e4
MOST = 20
AMPLITUDE, PHASE, DROP, E, LENGTH = 1e-4, 0.3, 0.02, 0.8, 0.5


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
    turns = ending(lambda t, y: y[1], 1)

    def one(push):
        end = contact(
            lambda x, v: push - x * math.sqrt(x) * max(1 + DAMPING * v, 0.0),
            rtol,
            ends=(apart, turns),
        )
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

    gap = ending(lambda t, y: y[0] - place(t))
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


@jax.jit
def _impact_by_diffrax(push, rtol):
    """e and duration, scaled; 0 for e of a ball that stays."""

    def rate(t, y, _):
        x = jnp.where(y[0] > 0, y[0], 1.0)
        force = jnp.where(y[0] > 0, x * jnp.sqrt(x), 0.0)
        return jnp.stack([y[1], push - force * jnp.maximum(1 + DAMPING * y[1], 0.0)])

    ends = [lambda t, y, args, **_: y[0], lambda t, y, args, **_: y[1]]
    found = until(rate, jnp.array([0.0, 1.0]), ends, rtol, direction=[False, True])
    return jnp.where(found.event_mask[0], -found.ys[-1, 1], 0.0), found.ts[-1]


def rest_by_diffrax(rtol: float) -> float:
    return rest(lambda push: map(float, _impact_by_diffrax(push, rtol)))


@jax.jit
def _flight(t, y, rtol):
    def gap(t, y, args, **_):
        return y[0] - AMPLITUDE * jnp.sin(RATE * t + PHASE)

    found = until(
        lambda t, y, _: jnp.stack([y[1], -GRAVITY + 0 * y[1]]), y, gap, rtol,
        start=t, stop=LENGTH, first=None, longest=0.1 / FREQUENCY,
    )  # fmt: skip
    t, y = found.ts[-1], found.ys[-1]
    moves = AMPLITUDE * RATE * jnp.cos(RATE * t + PHASE)
    after = moves + E * (moves - y[1])
    return t, y.at[1].set(jnp.where(found.event_mask, after, y[1]))


def table_by_diffrax(rtol: float) -> float:
    t, y = 0.0, jnp.array([DROP, 0.0])
    while t < LENGTH:
        t, y = _flight(t, y, rtol)
    return float(y[1])
