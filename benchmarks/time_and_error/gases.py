"""Gases of 32 discs of unit diameter and mass, in a periodic cell or in a box with four walls."""

from __future__ import annotations

import functools
import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import jaxcontact as jc

from .engines import needs

GAS, CELL, DURATION = 32, 8.0, 3.0


@functools.cache
def discs(periodic: bool) -> tuple[np.ndarray, np.ndarray]:
    """Places and velocities."""
    discs = jc.random_spheres(
        GAS, low=[0.0, 0.0], high=[CELL, CELL], radius=0.5, mass=1.0, speed=1.0, seed=0,
        periodic=[CELL, CELL] if periodic else None,
    )  # fmt: skip
    return tuple(np.array([np.asarray(getattr(d, k)) for d in discs]) for k in _STATE)


_STATE = ("position", "velocity")


@functools.cache
def _jitted(periodic: bool) -> Any:
    place, _ = discs(periodic)
    box = [] if periodic else [jc.Box([0.0, 0.0], [CELL, CELL])]
    cell = {"periodic": [CELL, CELL]} if periodic else {}

    def run(velocity):
        made = [jc.Sphere(0.5, 1.0, x, v) for x, v in zip(place, velocity, strict=True)]
        scene = jc.Scene([*made, *box], jc.ExactRestitution(e=1.0), **cell)
        found = jc.simulate(scene, DURATION, instantaneous=True, max_impacts=256)
        return found.velocity[-1]

    return jax.jit(run)


def by_package(periodic: bool, rtol: float) -> jax.Array:
    return _jitted(periodic)(jnp.asarray(discs(periodic)[1]))


def by_billiards(rtol: float) -> np.ndarray:
    """The package of that name: from impact to impact, in Python, between walls."""
    needs("billiards")
    from billiards import Billiard
    from billiards.obstacles import InfiniteWall

    corners = [(0, 0), (CELL, 0), (CELL, CELL), (0, CELL)]
    walls = [InfiniteWall(a, b) for a, b in zip(corners, corners[1:] + corners[:1], strict=True)]
    table = Billiard(walls)
    for x, v in zip(*discs(False), strict=True):
        table.add_ball(x, v, 0.5, 1.0)
    table.evolve(DURATION)
    return table.balls_velocity


def _collide(x: Any, v: Any, duration: float, periodic: bool) -> Any:
    """From impact to impact, every pair and wall searched anew; numba compiles it."""
    count, t = len(x), 0.0
    cell, walls, images = (CELL, 0, 1) if periodic else (0.0, 2, 0)
    while True:
        soonest, first, second = duration - t, -1, -1
        for i in range(count):
            for k in range(walls):
                # The wall in the disc's direction: -1 and -2 stand for the two axes.
                to = CELL - 0.5 - x[i, k] if v[i, k] > 0 else 0.5 - x[i, k]
                wait = to / v[i, k] if v[i, k] != 0 else math.inf
                if wait < soonest:
                    soonest, first, second = wait, i, -1 - k
            for j in range(i):
                dx, dy = x[i, 0] - x[j, 0], x[i, 1] - x[j, 1]
                wx, wy = v[i, 0] - v[j, 0], v[i, 1] - v[j, 1]
                # The pair and its images in the neighbouring cells.
                for k in range(-images, images + 1):
                    for m in range(-images, images + 1):
                        px = dx - cell * (math.floor(dx / CELL + 0.5) + k)
                        py = dy - cell * (math.floor(dy / CELL + 0.5) + m)
                        b = px * wx + py * wy
                        if b < 0:
                            w = wx * wx + wy * wy
                            root = b * b - w * (px * px + py * py - 1)
                            if root > 0:
                                wait = (-b - root**0.5) / w
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
        px -= cell * math.floor(px / CELL + 0.5)
        py -= cell * math.floor(py / CELL + 0.5)
        size = px * px + py * py
        b = px * (v[first, 0] - v[second, 0]) + py * (v[first, 1] - v[second, 1])
        for k, sign in ((first, -1), (second, 1)):
            v[k, 0] += sign * b * px / size
            v[k, 1] += sign * b * py / size


@functools.cache
def _code() -> Any:
    import numba

    return numba.njit(_collide)


def by_numba(periodic: bool, rtol: float) -> np.ndarray:
    place, velocity = discs(periodic)
    return _code()(place.copy(), velocity.copy(), DURATION, periodic)


@functools.cache
def truth(periodic: bool) -> np.ndarray:
    """The same in Python, in extended precision, which leaves rounding no room to grow."""
    place, velocity = (rows.astype(np.longdouble) for rows in discs(periodic))
    return _collide(place, velocity, np.longdouble(DURATION), periodic).astype(float)
