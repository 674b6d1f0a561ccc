"""Contact time and largest force of elastic-plastic spheres, from their force over indentation.

Loading follows Hertz, F = K δ^(3/2), up to the indentation δ_y of yielding. Beyond it, it follows
the tangent there, since a contact of constant pressure grows with δ. Unloading is elastic again,
with the larger radius R* of the flattened contact: R* F_max = R F_e, where F_e is Hertz's force at
the largest indentation (Thornton 1997, doi 10.1115/1.2787319). All results follow from v_y.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import jax.numpy as jnp
from jax.scipy.special import betainc
from jaxtyping import Array, Float

from ..._contact import Contact

_BETA = math.gamma(0.4) * math.gamma(0.5) / math.gamma(0.9)
"""B(2/5, 1/2)."""

_HALF = 0.4 * _BETA
"""Duration of Hertz's compression in units of δ_max/v."""


class PlasticImpact(NamedTuple):
    """Contact time in s, largest force in N."""

    duration: Float[Array, "..."]
    max_force: Float[Array, "..."]


def plastic_impact(
    yield_speed: Float[Array, ""], contact: Contact, velocity: Float[Array, " n"]
) -> PlasticImpact:
    """Return the impacts at closing speeds (n,) in m/s of a contact with n = 3/2."""
    yields = velocity > yield_speed
    # Each branch gets numbers of its own side, so that derivatives stay finite. Speeds are
    # positive, so no root is taken of zero.
    slow = jnp.where(yields, yield_speed, velocity)
    deepest = _indentation(slow, contact)
    elastic = PlasticImpact(
        2 * _HALF * deepest / slow, contact.stiffness * deepest * jnp.sqrt(deepest)
    )
    fast = jnp.where(yields, velocity, 2 * yield_speed)
    beyond = _beyond(yield_speed, contact, fast)
    return PlasticImpact(*(jnp.where(yields, *both) for both in zip(beyond, elastic, strict=True)))


def _indentation(velocity: Float[Array, "..."], contact: Contact) -> Float[Array, "..."]:
    """Return Hertz's largest indentation, in m."""
    return (1.25 * contact.mass * jnp.square(velocity) / contact.stiffness) ** 0.4


def _beyond(
    yield_speed: Float[Array, ""], contact: Contact, velocity: Float[Array, " n"]
) -> PlasticImpact:
    """Return impacts faster than the yield speed; δ = x δ_y."""
    ratio = yield_speed / velocity
    square = 1 / jnp.square(ratio)
    depth = _indentation(yield_speed, contact)
    force = contact.stiffness * depth * jnp.sqrt(depth)
    # The energy ½ m v² = ½ m v_y² (1 + (5/2)(x-1) + (15/8)(x-1)²).
    more = (jnp.sqrt(6.25 + 7.5 * (square - 1)) - 2.5) / 3.75
    largest = force * (1 + 1.5 * more)
    wider = 1 + more
    stiffer = contact.stiffness * jnp.sqrt(wider * jnp.sqrt(wider) / (1 + 1.5 * more))
    recovered = (largest / stiffer) ** (2 / 3)
    rebound = jnp.sqrt(0.8 * largest * recovered / contact.mass)
    to_yield = 0.4 * _BETA * betainc(0.4, 0.5, jnp.square(ratio)) * ratio**-0.8 * depth / velocity
    frequency = jnp.sqrt(1.5 * contact.stiffness * jnp.sqrt(depth) / contact.mass)
    at_yield = jnp.sqrt(jnp.square(velocity) - jnp.square(yield_speed))
    to_turn = jnp.arctan(at_yield * frequency * contact.mass / force) / frequency
    return PlasticImpact(to_yield + to_turn + _HALF * recovered / rebound, largest)
