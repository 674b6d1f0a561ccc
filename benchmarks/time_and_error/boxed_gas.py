"""A gas of 32 discs in a box with four walls, which a billiard simulator also supports."""

from __future__ import annotations

import functools
import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import jaxcontact as jc

from .engines import needs
from .hard_scenes import CELL, DURATION, GAS


@functools.cache
def discs() -> tuple[np.ndarray, np.ndarray]:
    """Places and velocities of discs of unit diameter and mass."""
    made = jc.random_spheres(
        GAS, low=[0.0, 0.0], high=[CELL, CELL], radius=0.5, mass=1.0, speed=1.0, seed=0
    )
    return tuple(np.array([np.asarray(getattr(d, k)) for d in made]) for k in _STATE)


_STATE = ("position", "velocity")


@functools.cache
def _jitted() -> Any:
    place, _ = discs()

    def run(velocity):
        made = [jc.Sphere(0.5, 1.0, x, v) for x, v in zip(place, velocity, strict=True)]
        box = jc.Box([0.0, 0.0], [CELL, CELL])
        scene = jc.Scene([*made, box], jc.ExactRestitution(e=1.0))
        found = jc.simulate(scene, DURATION, instantaneous=True, max_impacts=256)
        return found.velocity[-1]

    return jax.jit(run)


def by_package(rtol: float) -> jax.Array:
    return _jitted()(jnp.asarray(discs()[1]))


def by_billiards(rtol: float) -> np.ndarray:
    """The package of that name: from impact to impact, in Python."""
    needs("billiards")
    from billiards import Billiard
    from billiards.obstacles import InfiniteWall

    corners = [(0, 0), (CELL, 0), (CELL, CELL), (0, CELL)]
    walls = [InfiniteWall(a, b) for a, b in zip(corners, corners[1:] + corners[:1], strict=True)]
    table = Billiard(walls)
    for x, v in zip(*discs(), strict=True):
        table.add_ball(x, v, 0.5, 1.0)
    table.evolve(DURATION)
    return table.balls_velocity


def _collide(x: Any, v: Any, duration: float) -> Any:
    """From impact to impact, every pair and wall searched anew; numba compiles it."""
    count, t = len(x), 0.0
    while True:
        soonest, first, second = duration - t, -1, -1
        for i in range(count):
            for k in range(2):
                # The wall in the disc's direction: -1 and -2 stand for the two axes.
                to = CELL - 0.5 - x[i, k] if v[i, k] > 0 else 0.5 - x[i, k]
                wait = to / v[i, k] if v[i, k] != 0 else math.inf
                if wait < soonest:
                    soonest, first, second = wait, i, -1 - k
            for j in range(i):
                px, py = x[i, 0] - x[j, 0], x[i, 1] - x[j, 1]
                wx, wy = v[i, 0] - v[j, 0], v[i, 1] - v[j, 1]
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
        if second < 0:
            v[first, -1 - second] *= -1
            continue
        px, py = x[first, 0] - x[second, 0], x[first, 1] - x[second, 1]
        size = px * px + py * py
        b = px * (v[first, 0] - v[second, 0]) + py * (v[first, 1] - v[second, 1])
        for k, sign in ((first, -1), (second, 1)):
            v[k, 0] += sign * b * px / size
            v[k, 1] += sign * b * py / size


@functools.cache
def _code() -> Any:
    import numba

    return numba.njit(_collide)


def by_numba(rtol: float) -> np.ndarray:
    place, velocity = discs()
    return _code()(place.copy(), velocity.copy(), DURATION)


@functools.cache
def truth() -> np.ndarray:
    """All pairs and walls at once in extended precision, which leaves rounding no room to grow."""
    x, v = (rows.astype(np.longdouble) for rows in discs())
    first, second = np.triu_indices(GAS, 1)
    left, half = np.longdouble(DURATION), np.longdouble(0.5)
    while True:
        apart, closing = x[first] - x[second], v[first] - v[second]
        b, w = np.sum(apart * closing, -1), np.sum(closing * closing, -1)
        square = b * b - w * (np.sum(apart * apart, -1) - 1)
        meets = (b < 0) & (square > 0)
        waits = np.where(meets, (-b - np.sqrt(np.where(meets, square, 0))) / w, np.inf)
        walls = (np.where(v > 0, CELL - half, half) - x) / v
        pair, side = np.argmin(waits), np.unravel_index(np.argmin(walls), walls.shape)
        wait = min(waits[pair], walls[side], left)
        x, left = x + v * wait, left - wait
        if left <= 0:
            return v.astype(float)
        if walls[side] < waits[pair]:
            v[side] *= -1
            continue
        i, j = first[pair], second[pair]
        apart = x[i] - x[j]
        change = apart * np.sum(apart * (v[i] - v[j])) / np.sum(apart * apart)
        v[i], v[j] = v[i] - change, v[j] + change
