"""A rod that bounces on a plane."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._entry import refuses_unknown
from .._friction import AbstractFriction
from .._laws import AbstractLaw, HuGuo
from .._system import System
from ._numbers import Drawing, SystemStart, circle, diagonal, positive, real, start, vector


class Rod(eqx.Module):
    """The numbers of a rod with spheres at its ends."""

    mass: Float[Array, ""]
    length: Float[Array, ""]
    radius: Float[Array, ""]
    gravity: Float[Array, ""]

    def levers(self, q: Array) -> Array:
        """Return the levers (2, 2) in m from the middle of the rod to its ends."""
        end = self.length / 2 * vector(jnp.cos(q[2]), jnp.sin(q[2]))
        return vector(-end, end)


class RodMass(Rod):
    def __call__(self, t: Array, q: Array, args: Any) -> Array:
        return diagonal(self.mass, self.mass, self.mass * self.length**2 / 12)


class RodForce(Rod):
    def __call__(self, t: Array, q: Array, v: Array, args: Any) -> Array:
        zero = jnp.zeros_like(self.mass)
        return vector(zero, -self.mass * self.gravity, zero)


class RodGap(Rod):
    def draw(self, t: Any, q: Any, args: Any) -> Drawing:
        """Return the picture at a time and place, as `jc.plot.animate` takes it."""
        ends, floor = q[:2] + np.asarray(self.levers(q)), 1.5 * float(self.length)
        ground = np.array([[-floor, 0], [floor, 0]])
        return ends - [0, self.radius], [ends, *(circle(x, self.radius) for x in ends), ground]

    def __call__(self, t: Array, q: Array, args: Any) -> Array:
        return q[1] + self.levers(q)[:, 1] - self.radius


class RodSlip(Rod):
    def __call__(self, t: Array, q: Array, v: Array, args: Any) -> Array:
        return v[0] - v[2] * (self.levers(q)[:, 1] - self.radius)


@refuses_unknown
def bouncing_rod(
    mass: ArrayLike = 0.1,
    length: ArrayLike = 0.2,
    *,
    radius: ArrayLike = 0.01,
    gravity: ArrayLike = 9.81,
    height: ArrayLike = 0.3,
    angle: ArrayLike = 0.5,
    law: AbstractLaw | None = None,
    stiffness: ArrayLike = 1e7,
    friction: AbstractFriction | None = None,
) -> tuple[System, SystemStart]:
    """Return a uniform rod with spheres at its ends above a plane, and its start at rest.

    M = diag(m, m, m l²/12), with the coordinates q = (x, y, angle) in m and rad. The gaps are y ± l
    sin(angle)/2 - R, of the left end first.

    `mass` m in kg, `length` l between the centres of the spheres and their `radius` R in m are
    positive, `gravity` is in m/s². The start has the middle at the `height` in m, at the `angle` in
    rad. `law` is `HuGuo(e=0.7)` by default, `stiffness` is in N/m^1.5. Raises ValueError for
    numbers out of range. Source: Stronge (2018), Impact Mechanics, ch. 3, doi
    10.1017/9781139050227.
    """
    numbers = {
        "mass": positive("mass", mass),
        "length": positive("length", length),
        "radius": positive("radius", radius),
        "gravity": real("gravity", gravity),
    }
    place = [0.0, real("height", height), real("angle", angle)]
    system = System(
        RodMass(**numbers),
        RodForce(**numbers),
        RodGap(**numbers),
        law=HuGuo(e=jnp.asarray(0.7)) if law is None else law,
        stiffness=stiffness,
        friction=friction,
        slip=None if friction is None else RodSlip(**numbers),
    )
    return system, start(place, [0.0, 0.0, 0.0])
