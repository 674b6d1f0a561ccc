"""Rotation of bodies: spins, and the numbers that only friction needs.

A spin is one number in two dimensions, (1,), and a vector in three, (3,). With the unit normal n
from the second body to the first and the radii R1 and R2 (negative for a shell) the contact point
slides at u = v1 - v2 - (R1 ω1 + R2 ω2) × n. R1 + R2 is the distance of the centres at touch, so
that an impulse J at the contact point keeps the angular momentum: Δω_i = -R_i n × J / I_i.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..._functions import ratio
from .movers import Movers

Lane = Float[Array, "..."]


class Turning(NamedTuple):
    """The rotation of bodies, and their friction on the walls on which they rest.

    `spin` (M, S) is in rad/s at the time of the state. `drag` (M, D) in m/s² and `twist` (M, S) in
    rad/s² are the accelerations by friction. A body slides `until` (M,) that time in s; infinite
    for one that does not.
    """

    spin: Lane
    drag: Lane
    twist: Lane
    until: Lane


def spin_energy(
    inverse: Float[Array, " N"], spin: Float[Array, "... N S"]
) -> Float[Array, "... N"]:
    """Return ½ I ω² in J of bodies with these 1/I; 0 for those that do not turn."""
    inertia = ratio(1.0, inverse).reshape(*(1,) * (spin.ndim - 2), -1)
    return jnp.sum(jnp.square(spin), axis=-1) * inertia / 2


class Rotation(eqx.Module):
    """The numbers of a scene that only friction needs.

    `spin` (N, S) is in rad/s. `inverse_inertia` (B,) is 0 for bodies that do not turn.
    `shear_compliance` (B,) of the materials is None if not known. `drift` is the motion of the
    walls in space, None if all are at rest.
    """

    spin: Float[Array, "N S"]
    inverse_inertia: Float[Array, " B"]
    shear_compliance: Float[Array, " B"] | None
    drift: Movers | None
    laws: tuple[Any, ...]

    def energy(self, spin: Float[Array, "... N S"]) -> Float[Array, "... N"]:
        """Return ½ I ω² of the spheres in J."""
        return spin_energy(self.inverse_inertia[: spin.shape[-2]], spin)


def free_turning(spin: Lane, dimensions: int) -> Turning:
    """Return spins (M, S) of bodies in flight."""
    count = spin.shape[0]
    none = jnp.zeros((count, dimensions), spin.dtype)
    return Turning(spin, none, jnp.zeros_like(spin), jnp.full(count, jnp.inf, spin.dtype))
