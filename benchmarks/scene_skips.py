"""Scenes twice: unchanged, and with a null addition that prevents skipping.

`python -m benchmarks scenes --only skips` measures both; tests check that the results agree.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

import jaxcontact as jc
from jaxcontact import AbstractLaw

ELASTIC = jc.ExactRestitution(e=1.0)


class Skip(NamedTuple):
    """A scene with and without something null, as functions of a factor of its speeds.

    Both return the final velocities that are to be the same; `soft`: impacts take time.
    """

    lean: Callable[[Array], Array]
    whole: Callable[[Array], Array]
    soft: bool = False


class PlainHertz(AbstractLaw):
    """Hertz's force, of which nothing is known but the force."""

    tension = False

    def force(self, indentation, velocity, contact, impact_velocity):
        depth = jnp.maximum(indentation, 0)
        safe = jnp.where(depth > 0, depth, 1)
        return contact.stiffness * jnp.where(depth > 0, safe**contact.exponent, 0)


def velocity(bodies, law, duration, count=None, *, instantaneous=True, room=64, **scene) -> Array:
    """At the end, of the first `count` spheres."""
    times = scene.pop("times", None)
    made = jc.Scene(bodies, law, **scene)
    run = jc.simulate(made, duration, times=times, instantaneous=instantaneous, max_impacts=room)
    return jnp.where(run.status == jc.Ending.COMPLETED, run.velocity[-1, :count], jnp.nan)


PLACES = np.array([[0.7, 0.8], [1.6, 2.9], [2.8, 1.1], [3.2, 3.1], [0.8, 2.0]])
SPEEDS = np.array([[1.0, 0.3], [-0.4, -0.9], [0.5, 0.8], [-0.7, 0.2], [0.2, -0.6]])
BOX = jc.Box([0.0, 0.0], [4.0, 4.0])


def box(factor, *, pins="fixed", **scene):
    """Five discs in a box, among four that stand."""
    corners = np.array([[1.2, 1.5], [2.2, 2.2], [3.4, 2.0], [2.0, 0.4]])
    balls = [jc.Sphere(0.2, 1.0, x, factor * v) for x, v in zip(PLACES, SPEEDS, strict=True)]
    how = {"mass": None, "fixed": True} if pins == "fixed" else {"mass": 1e30}
    stand = [jc.Sphere(0.2, position=x, **how) for x in corners]
    return velocity([*balls, *stand, BOX], ELASTIC, 1.5, 5, **scene)


def line(factor, dimensions=1, law=ELASTIC, gap=0.3, duration=6.0, **how):
    """Five unequal balls between two walls."""

    def vector(x):
        return jnp.stack([x, *[jnp.zeros_like(x)] * (dimensions - 1)])

    step = 0.2 + gap
    speeds = np.array([1.0, -0.4, 0.7, -1.1, 0.3])
    balls = [
        jc.Sphere(
            0.1, 1.0 + 0.3 * k, vector(jnp.asarray(step * k)), vector(factor * v),
            name=f"ball {k % 2}",
        )
        for k, v in enumerate(speeds)
    ]  # fmt: skip
    one = np.eye(dimensions)[0]
    walls = [jc.Plane(-0.5 * one, one), jc.Plane((4 * step + 0.5) * one, -one)]
    return velocity([*balls, *walls], law, duration, **how)[:, 0]


def alike(law):
    """The same law for all pairs, as a table."""
    return {("ball 0", "ball 1"): law(), ("ball 0", "ball 0"): law(), "default": law()}


def touching(factor, law):
    """A ball that hits four others in a row: all impacts are coupled."""
    balls = [jc.Sphere(0.1, 1.0, [0.2 * k], (factor * float(k == 0))[None]) for k in range(5)]
    return velocity(balls, law, 0.1, instantaneous=False, room=16, stiffness=1e6)


def sleepers(factor, hop):
    """A ball that bounces, and four that rest, or hop."""
    bouncing = jc.Sphere(0.1, 1.0, [0.0, 0.9], jnp.stack([0.0 * factor, factor]))
    low = [jc.Sphere(0.1, 1.0, [1.0 + k, 0.1 + (hop > 0) * 1e-3], [0.0, hop]) for k in range(4)]
    floor = jc.Plane([0.0, 0.0], [0.0, 1.0])
    law = jc.ExactRestitution(e=0.9)
    return velocity([bouncing, *low, floor], law, 1.5, 1, room=512, gravity=[0.0, -9.81])


SKIPS = {
    "no gravity: none, or zeros": Skip(box, lambda s: box(s, gravity=[0.0, 0.0])),
    "one dimension, or two": Skip(line, lambda s: line(s, 2)),
    "one shared law, or a table of equal ones": Skip(
        lambda s: line(s, law=jc.MarhefkaOrin(a=0.05), stiffness=1e6),
        lambda s: line(s, law=alike(lambda: jc.MarhefkaOrin(a=0.05)), stiffness=1e6),
    ),
    "no path, or 512 times": Skip(line, lambda s: line(s, times=np.linspace(0, 6, 512))),
    "pairs that stand: fixed, or of 1e30 kg": Skip(box, lambda s: box(s, pins="heavy")),
    "four balls at rest, or hopping": Skip(lambda s: sleepers(s, 0.0), lambda s: sleepers(s, 0.3)),
    "Hertz by its closed form, or by its force": Skip(
        lambda s: line(s, law=jc.Hertz(), stiffness=1e9, instantaneous=False),
        lambda s: line(s, law=PlainHertz(), stiffness=1e9, instantaneous=False),
        soft=True,
    ),
    "Hertz, or a damping of 0": Skip(
        lambda s: touching(s, jc.Hertz()),
        lambda s: touching(s, jc.Damped(alpha=0.0)),
        soft=True,
    ),
}


def rows(calls: int = 40) -> list[dict]:
    """Seconds of both of every pair, jitted and called in turn, the least of so many calls."""
    found = []
    for name, (lean, whole, _) in SKIPS.items():
        ways, least = [jax.jit(lean), jax.jit(whole)], [np.inf, np.inf]
        ends = [np.asarray(way(jnp.asarray(1.0))) for way in ways]
        for _ in range(calls):
            for k, way in enumerate(ways):
                start = time.perf_counter()
                jax.block_until_ready(way(jnp.asarray(1.0)))
                least[k] = min(least[k], time.perf_counter() - start)
        row = {"skip": name, "seconds": least[0], "seconds_whole": least[1]}
        row |= {
            "ratio": least[1] / least[0],
            "difference": float(np.max(np.abs(np.subtract(*ends)))),
        }
        print(f"{name:45} {1e6 * least[0]:9.1f} us, else {row['ratio']:6.2f} times", flush=True)
        found.append(row)
    return found
