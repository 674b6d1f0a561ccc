"""The indentations at which contacts end: 0, or less for contacts with a neck."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._contact import Contact
from .._laws import AbstractLaw, end_of
from .scalars import Number

Depths = Float[Array, " contacts"]


def ends_of(law: AbstractLaw, contact: Contact, length: Number, count: int) -> Depths | None:
    """Return the indentations ≤ 0 in units of `length` at which contacts end; None if at 0."""
    return jnp.broadcast_to(end_of(law, contact) / length, (count,)) if law.ends_apart else None


def attracts(law: AbstractLaw) -> bool:
    """Return whether contacts of a law may store a negative energy."""
    return law.ends_apart or law.forgets or (law.tension and not law.damped)


def in_contact(depth: Depths, ends: Depths | None) -> Depths:
    """Return indentations for the forces of closed contacts, which rounding puts beyond 0, with the
    derivative of a contact. Those that end below 0 have a force there.
    """
    pressed = depth - jax.lax.stop_gradient(jnp.minimum(depth, 0))
    return pressed if ends is None else jnp.where(ends < 0, depth, pressed)
