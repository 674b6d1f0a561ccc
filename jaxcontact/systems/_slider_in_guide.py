"""A slider-crank whose slider has clearance in its guide."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._entry import refuses_unknown
from .._friction import AbstractFriction
from .._laws import AbstractLaw, ExactRestitution
from .._system import System
from ._numbers import Drawing, SystemStart, positive, real, start, vector


class Guided(eqx.Module):
    """The numbers of a slider-crank with a free crank, and of the slider in its guide."""

    lengths: Float[Array, "2"]
    masses: Float[Array, "3"]
    inertias: Float[Array, "3"]
    half_sizes: Float[Array, "2"]
    clearance: Float[Array, ""]
    gravity: Float[Array, ""]

    def corners(self, q: Array) -> tuple[Array, Array]:
        """Return the levers (4,) in m of the corners in x and y from the middle of the slider."""
        along = self.half_sizes[0] * jnp.asarray([-1.0, 1.0, -1.0, 1.0], q.dtype)
        across = self.half_sizes[1] * jnp.asarray([1.0, 1.0, -1.0, -1.0], q.dtype)
        cos, sin = jnp.cos(q[2]), jnp.sin(q[2])
        return along * cos - across * sin, along * sin + across * cos


class GuidedMass(Guided):
    def __call__(self, t: Array, q: Array, args: Any) -> Array:
        (l1, l2), (m1, m2, m3), (j1, j2, j3) = self.lengths, self.masses, self.inertias
        both = (m2 / 2 + m3) * l1 * l2 * jnp.cos(q[0] - q[1])
        crank = j1 + (m1 / 4 + m2 + m3) * l1**2
        rod = j2 + (m2 / 4 + m3) * l2**2
        zero = jnp.zeros_like(both)
        return vector(crank, both, zero, both, rod, zero, zero, zero, j3).reshape(3, 3)


class GuidedForce(Guided):
    def __call__(self, t: Array, q: Array, v: Array, args: Any) -> Array:
        (l1, l2), (m1, m2, m3) = self.lengths, self.masses
        turn = (m2 / 2 + m3) * l1 * l2 * jnp.sin(q[0] - q[1])
        crank = -turn * v[1] ** 2 - (m1 / 2 + m2 + m3) * self.gravity * l1 * jnp.cos(q[0])
        rod = turn * v[0] ** 2 - (m2 / 2 + m3) * self.gravity * l2 * jnp.cos(q[1])
        return vector(crank, rod, jnp.zeros_like(rod))


class GuidedGap(Guided):
    def draw(self, t: Any, q: Any, args: Any) -> Drawing:
        """Return the picture at a time and place, as `jc.plot.animate` takes it."""
        links = np.asarray(self.lengths)[:, None] * np.stack([np.cos(q[:2]), np.sin(q[:2])], axis=1)
        joints = np.cumsum([[0, 0], *links], axis=0)
        corners = joints[2] + np.stack(self.corners(jnp.asarray(q)), axis=1)
        (crank, rod), half = np.asarray(self.lengths), np.asarray(self.half_sizes)
        height, ends = (
            half[1] + float(self.clearance),
            (rod - crank - half[0], rod + crank + half[0]),
        )
        guide = [[[x, y] for x in ends] for y in (height, -height)]
        return corners, [joints, corners[[0, 1, 3, 2, 0]], *np.asarray(guide)]

    def __call__(self, t: Array, q: Array, args: Any) -> Array:
        height = jnp.sum(self.lengths * jnp.sin(q[:2])) + self.corners(q)[1]
        side = jnp.asarray([1.0, 1.0, -1.0, -1.0], q.dtype)
        return self.half_sizes[1] + self.clearance - side * height


class GuidedSlip(Guided):
    def __call__(self, t: Array, q: Array, v: Array, args: Any) -> Array:
        return -jnp.sum(self.lengths * v[:2] * jnp.sin(q[:2])) - v[2] * self.corners(q)[1]


@refuses_unknown
def slider_in_guide(
    clearance: ArrayLike = 1e-3,
    *,
    lengths: ArrayLike | Sequence[float] = (0.153, 0.306),
    masses: ArrayLike | Sequence[float] = (0.038, 0.038, 0.076),
    inertias: ArrayLike | Sequence[float] = (7.4e-5, 5.9e-4, 2.7e-6),
    half_sizes: ArrayLike | Sequence[float] = (0.05, 0.025),
    gravity: ArrayLike = 9.81,
    speeds: ArrayLike | Sequence[float] = (150.0, -75.0, 0.0),
    law: AbstractLaw | None = None,
    stiffness: ArrayLike = 1e8,
    friction: AbstractFriction | None = None,
) -> tuple[System, SystemStart]:
    """Return a slider-crank whose slider touches its guide with four corners, and its start.

    The coordinates q are the angles of crank, rod and slider in rad, and the crank is free. The
    gaps are those of the corners upper left, upper right, lower left and lower right.

    `clearance` is in m on each side, `lengths` of crank and rod in m. `masses` in kg and
    `inertias` in kg m² about their middles are those of crank, rod and slider. `half_sizes` of
    the slider in m are along and across, `gravity` in m/s². The start is stretched, at the
    `speeds` of the three
    angles in rad/s. `law` is `ExactRestitution(e=0.4)` by default, `stiffness` in N/m^1.5. Raises
    ValueError for numbers out of range. Source: Flores, Leine & Glocker (2010), doi
    10.1007/s11044-009-9178-y.
    """
    numbers = {
        "lengths": positive("lengths", lengths, (2,)),
        "masses": positive("masses", masses, (3,)),
        "inertias": positive("inertias", inertias, (3,)),
        "half_sizes": positive("half_sizes", half_sizes, (2,)),
        "clearance": positive("clearance", clearance),
        "gravity": real("gravity", gravity),
    }
    turning = real("speeds", speeds, (3,))
    system = System(
        GuidedMass(**numbers),
        GuidedForce(**numbers),
        GuidedGap(**numbers),
        law=ExactRestitution(e=jnp.asarray(0.4)) if law is None else law,
        stiffness=stiffness,
        friction=friction,
        slip=None if friction is None else GuidedSlip(**numbers),
    )
    return system, start([0.0, 0.0, 0.0], turning)
