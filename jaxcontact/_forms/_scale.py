"""The units in which mass, stiffness and closing speed drop out of an impact."""

from __future__ import annotations

from typing import Any, Protocol, cast

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float


class ContactLike(Protocol):
    """What a form needs of a contact: `mass` in kg, `stiffness` in N/mⁿ and the `exponent` n."""

    mass: Float[Array, "..."]
    stiffness: Float[Array, "..."]

    @property
    def exponent(self) -> Any:
        """The exponent n, a float where it is concrete."""


class Scale(eqx.Module):
    """The units X = (m v0²/K)^(1/(n+1)) of length, v0 of speed, X/v0 of time, m v0²/X of force.

    The unit of `energy` is ½ m v0². Without a contact only the unit of speed is known, the others
    are None.
    """

    length: Float[Array, "..."]
    speed: Float[Array, "..."]
    time: Float[Array, "..."]
    force: Float[Array, "..."]
    energy: Float[Array, "..."]


def scale_of(contact: ContactLike | None, velocity: Float[Array, "..."]) -> Scale:
    """The scale of an impact; finite in float32 for any SI values that float32 can hold."""
    if contact is None:
        unknown = cast(Array, None)
        return Scale(unknown, velocity, unknown, unknown, unknown)
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
