"""Soft spheres in a line and a passing pair: the scenes, and their solution by SciPy and diffrax.

Both are restarted where a pair touches or opens, since the damping depends on the speed at touch.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.integrate import DOP853, solve_ivp

import jaxcontact as jc

from ..until_event import ending, until


class Line(NamedTuple):
    """Soft spheres: (N, D) positions and velocities, radii, masses, α and K, and how long.

    Without damping there is nothing to restart for: all pairs count as closed.
    `longest`: the step of diffrax that does not miss a contact; by trial (twice that missed some).
    """

    position: np.ndarray
    velocity: np.ndarray
    radius: np.ndarray
    mass: np.ndarray
    alpha: float
    stiffness: float
    duration: float
    longest: float


def line(gap: float, stiffness: float, duration: float) -> Line:
    """Five unequal spheres in a line, of which the first one strikes."""
    radius = np.array([0.1, 0.12, 0.09, 0.11, 0.1])
    mass = np.array([0.2, 10.0, 1.0, 5.0, 10.0])
    ends = np.cumsum(2 * radius + gap)
    position = (ends - radius)[:, None]
    velocity = np.array([[2.0], [0.0], [0.0], [0.0], [0.0]])
    longest = duration if gap < 1e-3 else 2e-3
    return Line(position, velocity, radius, mass, 0.3, stiffness, duration, longest)


def chain(count: int) -> Line:
    """Equal spheres that touch, without damping, of which the first one strikes."""
    # Numbers that are binary fractions: the gaps are exactly zero.
    radius, mass = np.full(count, 0.125), np.full(count, 1.0)
    position = 0.25 * np.arange(count)[:, None]
    velocity = np.zeros((count, 1))
    velocity[0] = 1.0
    return Line(position, velocity, radius, mass, 0.0, 1e6, 0.1, 0.1)


def oblique(slowness: float) -> Line:
    """Two spheres that pass each other: v_t T/d is `slowness`."""
    radius, mass, speed = np.array([0.1, 0.1]), np.array([1.0, 1.0]), 1.0
    # T = 2.94 X/v for Hertz, approximately; X = (μ v²/K)^0.4.
    length = slowness * 0.2 / 2.94
    stiffness = 0.5 * speed**2 / length**2.5
    position = np.array([[-0.2, 0.12], [0.0, 0.0]])
    velocity = np.array([[1.4, 0.0], [0.0, 0.0]])
    # With a longer step diffrax misses the contact.
    longest = min(3e-3, 0.75 * slowness)
    return Line(position, velocity, radius, mass, 0.3, stiffness, 0.3, longest)


def pairs_of(line: Line) -> tuple[np.ndarray, np.ndarray]:
    """First and second sphere of the pairs that can meet: neighbours in a line."""
    first = np.arange(len(line.mass) - 1)
    return first, first + 1


def geometry(xp, line: Line, y):
    """Indentations, their rates, and the unit normals of all pairs."""
    first, second = pairs_of(line)
    count, dim = line.position.shape
    x, v = y[: count * dim].reshape(count, dim), y[count * dim :].reshape(count, dim)
    apart, relative = x[first] - x[second], v[first] - v[second]
    length = xp.sqrt(xp.sum(apart * apart, axis=1))
    normal = apart / length[:, None]
    depth = (line.radius[first] + line.radius[second]) - length
    return depth, -xp.sum(normal * relative, axis=1), normal, v


def accelerated(xp, line: Line, y, closed, speed):
    """Newton's equations of all spheres."""
    depth, rate, normal, v = geometry(xp, line, y)
    deep = xp.where(closed & (depth > 0), depth, 0.0)
    force = line.stiffness * deep * xp.sqrt(deep) * (1 + line.alpha * rate / speed)
    force = xp.where(closed, xp.maximum(force, 0.0), 0.0)[:, None] * normal
    none = xp.zeros((1, normal.shape[1]))
    # Neighbours in a line: sphere k is the first of pair k and the second of pair k - 1.
    push = xp.concatenate([force, none]) - xp.concatenate([none, force])
    return xp.concatenate([v.ravel(), (push / line.mass[:, None]).ravel()])


def ends(line: Line, k: int, sign: int) -> Callable:
    """The event at which a pair opens (1) or touches (-1)."""
    return ending(lambda t, y: sign * geometry(np, line, y)[0][k])


def _events(line: Line, closed: np.ndarray) -> list[Callable]:
    return [ends(line, k, 1 if closed[k] else -1) for k in range(len(closed))]


def by_scipy(line: Line, rtol: float) -> np.ndarray:
    """solve_ivp with DOP853, terminated by events and started again."""
    y = np.concatenate([line.position.ravel(), line.velocity.ravel()])
    count = len(line.mass) - 1
    closed, speed, t = np.full(count, line.alpha == 0), np.ones(count), 0.0
    while t < line.duration:
        found = solve_ivp(
            lambda t, y, c=closed, s=speed: accelerated(np, line, y, c, s),
            (t, line.duration),
            y,
            DOP853,
            events=None if line.alpha == 0 else _events(line, closed),
            rtol=rtol,
            atol=1e-3 * rtol,
        )
        t, y = found.t[-1], found.y[:, -1]
        if found.status == 1:
            happens = np.array([len(times) > 0 for times in found.t_events])
            rate = geometry(np, line, y)[1]
            speed = np.where(happens & ~closed, rate, speed)
            closed = closed ^ happens
    return y[len(y) // 2 :]


class Fixed:
    """A scene as a static argument."""

    def __init__(self, line: Line):
        self.line = line


@functools.partial(jax.jit, static_argnums=0)
def _segment(fixed: Fixed, rtol, longest, t, y, closed, speed):
    line = fixed.line

    def gap(k: int) -> Callable:
        def of(t, y, args, **_):
            closed, _ = args
            depth = geometry(jnp, line, y)[0][k]
            return jnp.where(closed[k], depth, -depth)

        return of

    count = len(line.mass) - 1
    # During a flight a longer step would go over the touch and the following opening.
    solution = until(
        lambda t, y, args: accelerated(jnp, line, y, *args), y,
        None if line.alpha == 0 else [gap(k) for k in range(count)], rtol,
        args=(closed, speed), start=t, stop=line.duration, first=None, longest=longest,
    )  # fmt: skip
    happens = closed & False if line.alpha == 0 else jnp.stack(solution.event_mask)
    y = solution.ys[-1]
    speed = jnp.where(happens & ~closed, geometry(jnp, line, y)[1], speed)
    return solution.ts[-1], y, closed ^ happens, speed


def by_diffrax(fixed: Fixed, longest: float, rtol: float) -> np.ndarray:
    """A jitted solve up to the next event, called again and again, with a longest step in s."""
    line = fixed.line
    y = jnp.concatenate([jnp.ravel(line.position), jnp.ravel(line.velocity)])
    count = len(line.mass) - 1
    closed, speed = jnp.full(count, line.alpha == 0), jnp.ones(count)
    t = jnp.asarray(0.0)
    for _ in range(1000):
        t, y, closed, speed = _segment(fixed, rtol, longest, t, y, closed, speed)
        if t >= line.duration:
            break
    return np.asarray(y[len(y) // 2 :])


def _law(alpha: float) -> jc.AbstractLaw:
    return jc.Damped(alpha=alpha) if alpha else jc.Hertz()


def scene_of(line: Line, velocity: jax.Array | None = None) -> jc.Scene:
    """The same for the package."""
    velocity = jnp.asarray(line.velocity) if velocity is None else velocity
    spheres = [
        jc.Sphere(r, m, x, v)
        for r, m, x, v in zip(line.radius, line.mass, line.position, velocity, strict=True)
    ]
    return jc.Scene(spheres, _law(line.alpha), stiffness=line.stiffness)
