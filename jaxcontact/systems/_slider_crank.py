"""A slider-crank with clearance in the joint between rod and slider."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._entry import refuses_unknown
from .._friction import AbstractFriction
from .._laws import AbstractLaw, HuGuo
from .._program import traced
from .._system import System
from ._numbers import (
    Drawing,
    SystemStart,
    circle,
    diagonal,
    positive,
    real,
    rectangle,
    start,
    vector,
)


class Crank(eqx.Module):
    """The numbers of a slider-crank whose crank turns at a constant speed."""

    lengths: Float[Array, "2"]
    masses: Float[Array, "2"]
    inertia: Float[Array, ""]
    speed: Float[Array, ""]
    bearing: Float[Array, ""]
    clearance: Float[Array, ""]

    def journal(self, t: Array, q: Array) -> tuple[Array, Array]:
        """Return x and y in m from the centre of the bearing to that of the journal."""
        (crank, rod), (angle, place), turn = self.lengths, q, self.speed * t
        x = place - crank * jnp.cos(turn) - rod * jnp.cos(angle)
        return x, -crank * jnp.sin(turn) - rod * jnp.sin(angle)


class CrankMass(Crank):
    def __call__(self, t: Array, q: Array, args: Any) -> Array:
        rod = self.inertia + self.masses[0] * self.lengths[1] ** 2 / 4
        return diagonal(rod, self.masses[1])


class CrankForce(Crank):
    def __call__(self, t: Array, q: Array, v: Array, args: Any) -> Array:
        # The inertia of the rod, as its end follows the crank.
        lever = self.masses[0] * self.lengths[0] * self.lengths[1] / 2
        turning = lever * self.speed**2 * jnp.sin(self.speed * t - q[0])
        return vector(turning, jnp.zeros_like(turning))


class CrankGap(Crank):
    def draw(self, t: Any, q: Any, args: Any) -> Drawing:
        """Return the picture at a time and place, as `jc.plot.animate` takes it."""
        (crank, rod), turn = np.asarray(self.lengths), float(self.speed) * t
        pin = crank * np.array([np.cos(turn), np.sin(turn)])
        bearing = pin + rod * np.array([np.cos(q[0]), np.sin(q[0])])
        slider, radius = np.array([q[1], 0]), float(self.bearing)
        apart = slider - bearing
        touch = bearing + radius * apart / max(np.hypot(*apart), 1e-30)
        circles = [circle(bearing, radius), circle(slider, radius - float(self.clearance))]
        guide = [
            [x, y * 2.2 * radius]
            for y in (1, -1)
            for x in (rod - crank - 3 * radius, rod + crank + 3 * radius)
        ]
        links = [np.stack([np.zeros(2), pin]), np.stack([pin, bearing])]
        block = rectangle(slider, [3 * radius, 2 * radius])
        return touch[None], [*links, *circles, block, *np.reshape(guide, (2, 2, 2))]

    def __call__(self, t: Array, q: Array, args: Any) -> Array:
        x, y = self.journal(t, q)
        square = jnp.square(x) + jnp.square(y)
        # The distance has no gradient in the middle, where nothing touches.
        away = square > 0
        distance = jnp.where(away, jnp.sqrt(jnp.where(away, square, 1)), 0)
        return (self.clearance - distance)[None]


class CrankSlip(Crank):
    def __call__(self, t: Array, q: Array, v: Array, args: Any) -> Array:
        between = vector(*self.journal(t, q))
        square = jnp.sum(jnp.square(between))
        away = square > 0
        along = between / jnp.sqrt(jnp.where(away, square, 1))
        across = vector(-along[1], along[0])
        turn, crank = self.speed * t, self.lengths[0] * self.speed
        end = crank * vector(-jnp.sin(turn), jnp.cos(turn))
        end = end + self.lengths[1] * v[0] * vector(-jnp.sin(q[0]), jnp.cos(q[0]))
        slider = vector(v[1], jnp.zeros_like(v[1]))
        return (jnp.sum((slider - end) * across) - v[0] * self.bearing)[None]


@refuses_unknown
def slider_crank(
    clearance: ArrayLike = 0.5e-3,
    *,
    lengths: ArrayLike | Sequence[float] = (0.05, 0.12),
    masses: ArrayLike | Sequence[float] = (0.21, 0.14),
    inertia: ArrayLike = 2.5e-4,
    speed: ArrayLike = 523.5987755982989,
    bearing: ArrayLike = 10e-3,
    law: AbstractLaw | None = None,
    stiffness: ArrayLike = 6.6101984e10,
    friction: AbstractFriction | None = None,
) -> tuple[System, SystemStart]:
    """Return a slider-crank with a dry revolute joint between rod and slider, and its start.

    The coordinates q are the angle of the rod in rad and the place of the slider in m. The gap is c
    - |r| with the vector r from the centre of the bearing, which is part of the rod, to that of the
    journal, which is part of the slider. The crank turns at a constant speed. There is no gravity.

    `clearance` c is in m, `lengths` of crank and rod in m, `masses` of rod and slider in kg.
    `inertia` is that of the rod about its middle in kg m², `speed` that of the crank in rad/s,
    5000 rpm by default. The radius of the `bearing` is in m. `law` is `HuGuo(e=0.9)` by
    default. `stiffness` in N/m^1.5 is that
    of steel with radii of 10 and 9.5 mm; another clearance has another. The start is stretched and
    concentric, at the speeds of the ideal joint. Raises ValueError for numbers out of range.
    Source: Tian, Flores & Lankarani (2018), doi 10.1016/j.mechmachtheory.2017.12.002.
    """
    numbers = {
        "lengths": positive("lengths", lengths, (2,)),
        "masses": positive("masses", masses, (2,)),
        "inertia": positive("inertia", inertia),
        "speed": real("speed", speed),
        "bearing": positive("bearing", bearing),
        "clearance": positive("clearance", clearance),
    }
    system = System(
        CrankMass(**numbers),
        CrankForce(**numbers),
        CrankGap(**numbers),
        law=HuGuo(e=jnp.asarray(0.9)) if law is None else law,
        stiffness=stiffness,
        friction=friction,
        slip=None if friction is None else CrankSlip(**numbers),
    )
    stretched, turning = _stretched(numbers["lengths"], numbers["speed"])
    return system, start([0.0, stretched], [turning, 0.0])


def _stretched(lengths: Any, speed: Any) -> tuple[Any, Any]:
    """Return the place of the slider and the speed of the rod where the crank is at 0."""
    if not traced((lengths, speed)):
        # Concrete numbers need no compilation.
        lengths, speed = np.asarray(lengths), np.asarray(speed)
    return lengths[0] + lengths[1], -speed * lengths[0] / lengths[1]
