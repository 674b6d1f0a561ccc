"""The units in which mass, stiffness and closing speed drop out of an impact."""

from __future__ import annotations

from typing import TYPE_CHECKING

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

if TYPE_CHECKING:
    from .._contact import Contact


class Scale(eqx.Module):
    """The units X = (m v0²/K)^(1/(n+1)) of length, v0 of speed, X/v0 of time, m v0²/X of force."""

    length: Float[Array, "..."]
    speed: Float[Array, "..."]
    time: Float[Array, "..."]
    force: Float[Array, "..."]
    energy: Float[Array, "..."]


def scale_of(contact: Contact, velocity: Float[Array, "..."]) -> Scale:
    """The scale of an impact; finite in float32 for any SI values that float32 can hold."""
    # m v0²/K leaves float32 where its fractional power does not: add logarithms instead.
    logarithm = jnp.log(contact.mass) + 2 * jnp.log(velocity) - jnp.log(contact.stiffness)
    length = jnp.exp(logarithm / (contact.exponent + 1))
    return Scale(
        length=length,
        speed=velocity,
        time=length / velocity,
        force=contact.mass * velocity * (velocity / length),
        energy=0.5 * contact.mass * velocity * velocity,
    )
