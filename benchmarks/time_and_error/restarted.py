"""Hard scenes by solvers of differential equations that are restarted at every event.

SciPy solves the two gases, diffrax all scenes: a ball that comes to rest, one on a shaking table.
Flights are straight or parabolic; locating their ends is expensive. Both solvers have a longest
step, without which they miss a touch.
"""

from __future__ import annotations

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy.integrate import solve_ivp

from ..until_event import ending, until
from . import gases, hard_scenes
from .gases import CELL, DURATION, GAS
from .hard_scenes import AMPLITUDE, DAMPING, DROP, FREQUENCY, GRAVITY, LENGTH, PHASE, RATE, E

LONGEST = 0.01
"""s; of the gases' steps."""
_FIRST, _SECOND = np.triu_indices(GAS, 1)


@jax.jit
def _bounce(push, rtol):
    """e and duration, scaled; 0 for e of a ball that stays."""

    def rate(t, y, _):
        x = jnp.where(y[0] > 0, y[0], 1.0)
        force = jnp.where(y[0] > 0, x * jnp.sqrt(x), 0.0)
        return jnp.stack([y[1], push - force * jnp.maximum(1 + DAMPING * y[1], 0.0)])

    ends = [lambda t, y, args, **_: y[0], lambda t, y, args, **_: y[1]]
    found = until(rate, jnp.array([0.0, 1.0]), ends, rtol, direction=[False, True])
    return jnp.where(found.event_mask[0], -found.ys[-1, 1], 0.0), found.ts[-1]


def rest_by_diffrax(rtol: float) -> float:
    return hard_scenes.rest(lambda push: map(float, _bounce(push, rtol)))


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


def _apart(xp: Any, x: Any, periodic: bool) -> Any:
    """Squared distances of all pairs, of the nearest images."""
    apart = x[_FIRST] - x[_SECOND]
    if periodic:
        apart = apart - CELL * xp.round(apart / CELL)
    return apart


def _gaps(xp: Any, x: Any, v: Any, periodic: bool) -> Any:
    """What is left before each pair that closes touches, then each wall."""
    apart = _apart(xp, x, periodic)
    closing = xp.sum(apart * (v[_FIRST] - v[_SECOND]), axis=1) < 0
    pairs = xp.where(closing, xp.sum(apart * apart, axis=1) - 1, xp.inf)
    if periodic:
        return pairs
    walls = xp.where(v > 0, CELL - 0.5 - x, x - 0.5)
    return xp.concatenate([pairs, walls.ravel()])


def _struck(x: np.ndarray, v: np.ndarray, periodic: bool) -> np.ndarray:
    """Velocities after the impact of what is nearest."""
    nearest = int(np.argmin(_gaps(np, x, v, periodic)))
    v = v.copy()
    if nearest >= len(_FIRST):
        side = np.unravel_index(nearest - len(_FIRST), v.shape)
        v[side] *= -1
        return v
    i, j = _FIRST[nearest], _SECOND[nearest]
    apart = _apart(np, x, periodic)[nearest]
    change = apart * (apart @ (v[i] - v[j])) / (apart @ apart)
    v[i], v[j] = v[i] - change, v[j] + change
    return v


def _flight_by_scipy(t: float, x: np.ndarray, v: np.ndarray, rtol: float, periodic: bool) -> Any:
    speed = v.ravel()

    ends = ending(lambda t, y: np.min(_gaps(np, y.reshape(x.shape), v, periodic)))
    found = solve_ivp(
        lambda t, y: speed, (t, DURATION), x.ravel(), "DOP853", events=ends, rtol=rtol,
        atol=1e-3 * rtol, max_step=LONGEST,
    )  # fmt: skip
    return found.t[-1], found.y[:, -1].reshape(x.shape), found.status == 1


@functools.partial(jax.jit, static_argnums=4)
def _flight_by_diffrax(t, x, v, rtol, periodic):
    found = until(
        lambda t, y, _: v, x, lambda t, y, args, **_: jnp.min(_gaps(jnp, y, v, periodic)), rtol,
        start=t, stop=DURATION, first=None, longest=LONGEST,
    )  # fmt: skip
    return found.ts[-1], found.ys[-1], found.event_mask


_FLIGHTS = {"scipy": _flight_by_scipy, "diffrax": _flight_by_diffrax}


def gas(by: str, periodic: bool, rtol: float) -> np.ndarray:
    """Final velocities of a gas, flight after flight."""
    t, (x, v), fly = 0.0, gases.discs(periodic), _FLIGHTS[by]
    while t < DURATION:
        t, x, struck = fly(t, x, v, rtol, periodic)
        if struck:
            v = _struck(np.asarray(x), np.asarray(v), periodic)
    return np.asarray(v)
