"""A block on an incline that is shaken along itself."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._entry import refuses_unknown
from .._friction import AbstractFriction, RigidCoulomb
from .._laws import AbstractLaw, HuGuo
from .._system import System
from ._numbers import Drawing, SystemStart, diagonal, positive, real, rectangle, start, vector


class Incline(eqx.Module):
    """The numbers of a block on a shaken incline."""

    tilt: Float[Array, ""]
    shaking: Float[Array, "2"]
    mass: Float[Array, ""]
    gravity: Float[Array, ""]


class InclineMass(Incline):
    def __call__(self, t: Array, q: Array, args: Any) -> Array:
        return diagonal(self.mass, self.mass)


class InclineForce(Incline):
    def __call__(self, t: Array, q: Array, v: Array, args: Any) -> Array:
        return self.mass * self.gravity * vector(jnp.sin(self.tilt), -jnp.cos(self.tilt))


class InclineGap(Incline):
    def draw(self, t: Any, q: Any, args: Any) -> Drawing:
        """Return the picture at a time and place, as `jc.plot.animate` takes it."""
        amplitude, rate = np.asarray(self.shaking)
        size = 4 * float(amplitude) or 0.02
        down = np.array([np.cos(self.tilt), -np.sin(self.tilt)])
        away = np.array([-down[1], down[0]])
        shift = amplitude * np.sin(rate * t)
        # Marks on the incline show how it moves.
        marks = shift + size * (np.round((q[0] - shift) / size) + np.arange(-3.0, 4.0))
        feet = marks[:, None] * down
        ticks = [np.stack([foot, foot - 0.3 * size * away]) for foot in feet]
        touch = q[0] * down + q[1] * away
        block = rectangle(touch + size / 2 * away, [size, size / 2], -float(self.tilt))
        return touch[None], [block, feet, *ticks]

    def __call__(self, t: Array, q: Array, args: Any) -> Array:
        return q[1:]


class InclineSlip(Incline):
    def __call__(self, t: Array, q: Array, v: Array, args: Any) -> Array:
        amplitude, rate = self.shaking
        return v[:1] - amplitude * rate * jnp.cos(rate * t)


@refuses_unknown
def shaken_incline(
    tilt: ArrayLike = 0.1,
    shaking: ArrayLike | Sequence[float] = (5e-3, 30.0),
    *,
    mass: ArrayLike = 1.0,
    gravity: ArrayLike = 9.81,
    law: AbstractLaw | None = None,
    stiffness: ArrayLike = 1e6,
    friction: AbstractFriction | None = None,
) -> tuple[System, SystemStart]:
    """Return a block on an incline that is shaken along itself, and its start at rest.

    m x'' = m g sin(tilt) + f and m y'' = F - m g cos(tilt). The coordinates q = (x, y) in m are
    those along the incline, downwards, and away from it, in a frame at rest. The gap is y, and the
    slip speed x' - A ω cos(ω t).

    `tilt` is in rad. `shaking` holds the amplitude A in m and ω in rad/s. `mass` m is in kg,
    `gravity` g in m/s². `law` is `HuGuo(e=0.7)` by default, `stiffness` is in N/m^1.5. `friction`
    is `RigidCoulomb(mu=0.3)` by default. The block starts at its static depth, so that `simulate`
    needs a number for `v0`. Raises ValueError for numbers out of range. Source: Blekhman (2000),
    Vibrational Mechanics.
    """
    numbers = {
        "tilt": real("tilt", tilt),
        "shaking": real("shaking", shaking, (2,)),
        "mass": positive("mass", mass),
        "gravity": real("gravity", gravity),
    }
    system = System(
        InclineMass(**numbers),
        InclineForce(**numbers),
        InclineGap(**numbers),
        law=HuGuo(e=jnp.asarray(0.7)) if law is None else law,
        stiffness=stiffness,
        friction=RigidCoulomb(jnp.asarray(0.3)) if friction is None else friction,
        slip=InclineSlip(**numbers),
    )
    weight = numbers["mass"] * numbers["gravity"] * jnp.cos(numbers["tilt"])
    depth = (weight / system.stiffness) ** (2 / 3)
    return system, start([jnp.zeros_like(depth), -depth], [0.0, 0.0])
