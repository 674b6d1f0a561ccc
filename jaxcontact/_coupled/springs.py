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
from .contacts import ScaledContacts
from .modes import Flags, Modes, PerContact

Vectors = Float[Array, "m d"]
Motion = tuple[PerContact, ...]
"""Indentations with their rates, and with the rates of these where they are needed."""

SMALL = 1e-6
"""The depth, in units of length, by which a contact with a tangential spring begins."""

_FAST = 10.0
"""The slip, relative to the reach of `Springs`, from which the direction has the derivative of that
of the slip.
"""

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
    `Springs` for `reach`.

    In fast slip the derivative is that of the direction against the slip. The derivative of the
    spring force would need shorter steps than its value.
    """
    strength, pace = lengths(force), lengths(slip)
    along = force / jnp.where(strength > 0, strength, 1)[:, None]
    against = -slip / jnp.where(pace > 0, pace, 1)[:, None]
    along = jnp.where((strength > 0)[:, None], along, against)
    steered = against + jax.lax.stop_gradient(along - against)
    return jnp.where((pace > _FAST * reach)[:, None], steered, along)


def slides_at_touch(
    ratio: Array, slip: Vectors, closing: PerContact, mu: Array, hardening: PerContact
) -> Flags:
    """Return which contacts slip from their touch. `hardening` is F/(K δⁿ) at a small depth.

    The force grows as δⁿ and the spring force as κ u δⁿ/δ'.
    """
    return ratio * lengths(slip) > mu * hardening * closing


class Springs(NamedTuple):
    """The springs of contacts with their coefficients μ and ratios κ. Contacts with a `ramp`, a
    speed v_d > 0, have the friction -μF min(|u|/v_d, 1) u/|u| instead; None if all have springs.
    """

    contacts: ScaledContacts
    mu: Array
    ratio: Array
    ramp: PerContact | None = None

    def _reach(self, depth: PerContact, rate: PerContact) -> PerContact:
        """Return μ/(n κ) (δ + |δ'|), the slip speed at which a spring turns as fast as its contact
        changes.
        """
        changes = jnp.maximum(depth, 0) + jnp.abs(rate)
        return self.mu / (self.contacts.contact.exponent * self.ratio) * changes

    def friction(
        self, force: Vectors, slip: Vectors, normal: PerContact, at: Motion, modes: Modes
    ) -> Vectors:
        """Return the friction of the closed contacts with the `normal` forces: the spring force, or
        in slip that of the limit in its direction.
        """
        limit, slides, ramp = self.mu * normal, modes.slide == 1, self.ramp
        force = _limited(force, slip, limit, slides, self._reach(*at[:2]))
        if ramp is not None:
            pace, on_ramp = lengths(slip), jnp.where(ramp > 0, ramp, 1)
            pace = jnp.where(slides & (pace > 0), pace, on_ramp)
            force = jnp.where((ramp > 0)[:, None], -(limit / pace)[:, None] * slip, force)
        return jnp.where(modes.closed[:, None], force, 0)

    def motion(
        self, force: Vectors, slip: Vectors, normal: PerContact, at: Motion, modes: Modes
    ) -> SpringMotion:
        """Return the motion of springs; `at` holds δ, δ' and δ''."""
        (depth, rate, second), units = at, self.contacts.units
        stiffness = tangential_stiffness(self.ratio, self.contacts.contact, units.length * depth)
        stiffness = jnp.where(modes.closed, stiffness * (units.length / units.force), 0)
        grows = self.mu * self.contacts.force_slope(modes, (depth, rate), (rate, second))
        slides, reach = modes.slide == 1, self._reach(depth, rate)
        e = directions(force, slip, reach)
        along = jnp.sum(e * slip, axis=1)
        stick = -stiffness[:, None] * slip
        pace, fastest = lengths(slip), _FASTEST * reach
        turns = stiffness * jnp.where(pace > fastest, fastest / jnp.where(pace > 0, pace, 1), 1)
        turning = -turns[:, None] * (slip - along[:, None] * e) + grows[:, None] * e
        left = self.mu * normal - lengths(force)
        rates = jnp.where(slides[:, None], turning, stick)
        hold = jnp.where(slides, -stiffness * along - grows, left)
        if self.ramp is None:
            return SpringMotion(rates, hold)
        # Beyond the ramp the contact slips; on it no spring acts.
        ramps, beyond = self.ramp > 0, pace - self.ramp
        rates = jnp.where(ramps[:, None], 0, rates)
        return SpringMotion(rates, jnp.where(ramps, jnp.where(slides, beyond, -beyond), hold))

    def settled(
        self,
        force: Vectors,
        slip: Vectors,
        at: Motion,
        modes: Modes,
        touches: Flags,
        changes: Flags,
    ) -> tuple[Vectors, Modes]:
        """Return springs and modes after events: the contacts that touch, and those that change
        between stick and slip.
        """
        depth, rate, *_ = at
        contacts, slide, small = self.contacts, modes.slide, jnp.full_like(depth, SMALL)
        assert slide is not None
        contact, units = contacts.contact, contacts.units
        limit = self.mu * contacts.force(depth, rate, modes)
        stiff = contact.stiffness * (units.length * small) ** contact.exponent
        hardening = units.force * contacts.force(small, rate, modes) / stiff
        slips = slides_at_touch(self.ratio, slip, rate, self.mu, hardening)
        if self.ramp is not None:
            slips = jnp.where(self.ramp > 0, lengths(slip) > self.ramp, slips)
        # A contact that comes to stick has the force at the limit.
        stops = changes & (slide == 1)
        held = _limited(force, slip, limit, stops, self._reach(depth, rate))
        force = jnp.where((stops & ~touches)[:, None], held, force)
        force = jnp.where(touches[:, None], 0, force)
        slide = jnp.where(changes, 1 - slide, slide)
        slide = jnp.where(touches, slips.astype(slide.dtype), slide)
        return force, modes._replace(slide=slide)


def _limited(
    force: Vectors, slip: Vectors, limit: PerContact, slides: Flags, reach: PerContact
) -> Vectors:
    """Return spring forces, in slip those of the limit in their directions."""
    steered = limit[:, None] * directions(force, slip, reach)
    return jnp.where(slides[:, None], steered, force)
