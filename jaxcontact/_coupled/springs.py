"""Tangential springs and sliders of contacts: one force (m, d) each, in the units of a solve.

In stick f' = -k u, with k = κ n K δ^(n-1). In slip |f| = μF, and f turns against the part of the
slip across it: f' = -k (u - e e·u) + μF' e, with e = f/|f|. The rate at which e turns has a limit,
a hundred times that at which the contact changes.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._contact import Contact
from .modes import Flags, PerContact

Vectors = Float[Array, "m d"]

SMALL = 1e-6
"""The depth, in units of length, by which a contact with a tangential spring begins."""

_FAST = 10.0
"""The slip, relative to `reach`, from which the derivative of its direction is that of the slip."""

_FASTEST = 100.0
"""The rate at which the direction of friction turns, in units of that of the contact."""


class SpringMotion(NamedTuple):
    """The rates f' of spring forces, and `hold`: what is left of the limit in stick, and in slip
    k times the speed of the slider against the force.
    """

    rate: Vectors
    hold: PerContact


def tangential_stiffness(ratio: Array, contact: Contact, depth: PerContact) -> PerContact:
    """Return k = κ n K δ^(n-1) in N/m of depths in m."""
    n, presses = contact.exponent, depth > 0
    power = jnp.where(presses, depth, 1) ** (n - 1)
    return ratio * n * contact.stiffness * jnp.where(presses, power, 0)


def lengths(vectors: Vectors) -> PerContact:
    """Return the lengths of vectors, with a derivative at zero."""
    square = jnp.sum(jnp.square(vectors), axis=1)
    return jnp.where(square > 0, jnp.sqrt(jnp.where(square > 0, square, 1)), 0)


def directions(force: Vectors, slip: Vectors, reach: PerContact) -> Vectors:
    """Return the unit vectors of spring forces; those against the slip where there is no force. See
    `spring_motion` for `reach`.

    In fast slip the derivative is that of the direction against the slip. The derivative of the
    spring force would need shorter steps than its value.
    """
    strength, pace = lengths(force), lengths(slip)
    along = force / jnp.where(strength > 0, strength, 1)[:, None]
    against = -slip / jnp.where(pace > 0, pace, 1)[:, None]
    along = jnp.where((strength > 0)[:, None], along, against)
    steered = against + jax.lax.stop_gradient(along - against)
    return jnp.where((pace > _FAST * reach)[:, None], steered, along)


def friction_of(
    force: Vectors, slip: Vectors, limit: PerContact, slides: Flags, reach: PerContact
) -> Vectors:
    """Return the friction: the spring force, or in slip that of the limit in its direction."""
    steered = limit[:, None] * directions(force, slip, reach)
    return jnp.where(slides[:, None], steered, force)


def changing(depth: PerContact, rate: PerContact) -> PerContact:
    """Return δ + |δ'| in units of the solve."""
    return jnp.maximum(depth, 0) + jnp.abs(rate)


def spring_motion(
    force: Vectors,
    slip: Vectors,
    stiffness: PerContact,
    limit: tuple[PerContact, PerContact],
    slides: Flags,
    reach: PerContact,
) -> SpringMotion:
    """Return the motion of springs; `limit` holds μF and its rate. `reach` is μ/(n κ) (δ + |δ'|) in
    units of the solve, the slip speed at which a spring turns as fast as its contact changes.
    """
    e = directions(force, slip, reach)
    along = jnp.sum(e * slip, axis=1)
    stick = -stiffness[:, None] * slip
    pace, fastest = lengths(slip), _FASTEST * reach
    turns = stiffness * jnp.where(pace > fastest, fastest / jnp.where(pace > 0, pace, 1), 1)
    turning = -turns[:, None] * (slip - along[:, None] * e) + limit[1][:, None] * e
    hold = jnp.where(slides, -stiffness * along - limit[1], limit[0] - lengths(force))
    return SpringMotion(jnp.where(slides[:, None], turning, stick), hold)


def slides_at_touch(
    ratio: Array, slip: Vectors, closing: PerContact, mu: Array, hardening: PerContact
) -> Flags:
    """Return which contacts slip from their touch. `hardening` is F/(K δⁿ) at a small depth.

    The force grows as δⁿ and the spring force as κ u δⁿ/δ'.
    """
    return ratio * lengths(slip) > mu * hardening * closing


def settled_springs(
    force: Vectors,
    slip: Vectors,
    limit: PerContact,
    slide: PerContact,
    events: tuple[Flags, Flags, Flags],
    reach: PerContact,
) -> tuple[Vectors, PerContact]:
    """Return springs, and 1 for contacts that slip, 0 for others, after events: the contacts that
    touch, those that change between stick and slip, and those that slip from their touch.
    """
    touches, changes, slips = events
    # A contact that comes to stick has the force at the limit.
    stops = changes & (slide == 1)
    held = friction_of(force, slip, limit, stops, reach)
    force = jnp.where((stops & ~touches)[:, None], held, force)
    force = jnp.where(touches[:, None], 0, force)
    slide = jnp.where(changes, 1 - slide, slide)
    return force, jnp.where(touches, slips.astype(slide.dtype), slide)
