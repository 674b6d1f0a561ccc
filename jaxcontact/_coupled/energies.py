"""The indentations at which contacts end, 0 or less with a neck, and their elastic energies."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from .._contact import Contact
from .._functions import contraction
from .._laws import AbstractLaw, end_of, energies_of
from .modes import Number, PerContact


def ends_of(law: AbstractLaw, contact: Contact, length: Number, count: int) -> PerContact | None:
    """Return the indentations ≤ 0 in units of `length` at which contacts end; None if at 0."""
    return jnp.broadcast_to(end_of(law, contact) / length, (count,)) if law.ends_apart else None


def attracts(law: AbstractLaw) -> bool:
    """Return whether contacts of a law may store a negative energy."""
    return law.ends_apart or law.forgets or (law.tension and not law.damped)


def loses(law: AbstractLaw) -> bool:
    """Return whether contacts of a law may lose energy."""
    return law.damped or law.remembers or law.ends_apart


def in_contact(depth: PerContact, ends: PerContact | None) -> PerContact:
    """Return indentations for the forces of closed contacts, which rounding puts beyond 0, with the
    derivative of a contact. Those that end below 0 have a force there.
    """
    pressed = depth - jax.lax.stop_gradient(jnp.minimum(depth, 0))
    return pressed if ends is None else jnp.where(ends < 0, depth, pressed)


def stored_energy(
    law: AbstractLaw,
    contact: Contact,
    depth: Number,
    speed: Number,
    deepest: Number | None = None,
) -> Number:
    """Return ∫ F(δ, 0) dδ from 0 to `depth` in J; `speed` is the v0 of the law. The energy of an
    open contact, whose `depth` is 0 here, is 0. Gauss's rule is applied in u = √(δ/depth), in which
    forces with powers of δ^½ are polynomials. A law with a memory returns what unloading returns
    and, while it loads, what it will have kept; `deepest` is the largest indentation of a contact
    that unloads, else 0.
    """
    if law.remembers or law.ends_apart:
        loads = jnp.asarray(True) if deepest is None else deepest <= 0
        largest = depth if deepest is None else jnp.where(loads, depth, deepest)
        returned, kept = energies_of(law, depth, contact, speed, largest)
        return returned + jnp.where(loads, kept, 0)
    nodes, weights = np.polynomial.legendre.leggauss(16)
    depth = jnp.maximum(depth, 0)
    still = jnp.zeros_like(depth)

    def integrand(node: Number) -> Number:
        return node * law.force(depth * jnp.square(node), still, contact, speed)

    forces = jax.vmap(integrand)(jnp.asarray((1 + nodes) / 2, depth.dtype))
    return depth * contraction(jnp.asarray(weights, depth.dtype), forces)
