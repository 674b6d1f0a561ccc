"""The energy of an integrated impact: what is lost, what is left, and whether it adds up."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp

from ..._forms import Flag
from .motion import Motion, Number, State

# Where the energies have a weight of 1e-12, they are left out.
_HOPELESS = 1e3
# How much more the energies are doubted than the speed: under a pull their errors are those of a
# place, measured ten times larger.
_CAUTION = 4


class Balance(NamedTuple):
    """The `restitution` e and the `energy_loss`, in units of the initial energy.

    `error`: by how much the energies do not add up, relative to the largest energy of the motion.
    """

    restitution: Number
    energy_loss: Number
    error: Number


def balance_of(motion: Motion, end: State, max_indentation: Number) -> Balance:
    """The energies at the end: e² = 1 + 2Γx - 2 (damping's work + ∫ f(x, 0) dx).

    The energy lost is what damping took and the elastic energy that a contact without tension
    abandons at its end. e is a mean of what the velocity and the energies say, which trusts the
    energies where little is lost: that keeps the digits of 1 - e, and those of e under a force that
    moves the bodies much faster than they came.
    """
    speed, push = -motion.velocity(end), motion.push
    # The root for x = 0 may lie below it, by rounding.
    at = end._replace(w=jnp.maximum(end.w, 0))
    taken = motion.lost(end)
    lost = 2 * (taken if motion.one_way else taken + motion.stored(at))
    left, changed, largest = 1 - lost, lost, jnp.ones_like(lost)
    gained = jnp.zeros_like(lost)
    if push is not None:
        gained = 2 * push * at.w**motion.order
        left, changed = left + gained, changed + jnp.abs(gained)
        largest = largest + 2 * jnp.maximum(push, 0) * max_indentation
    # The error of e² is that of its energies on one way, 2 e times that of the speed on the other.
    # They are weighed, not switched: a fit would stop at the seam.
    scale = 2 * speed * jnp.sqrt(largest)
    trust = _trust(changed, scale, left > 0)
    by_energy = jnp.sqrt(jnp.where(trust > 0, left, 1))
    weighed = speed + trust * (by_energy - speed)
    # Where nearly all is lost, what is left tells better how much; but a sum of what cannot be
    # negative keeps its digits, which a difference from the work of the push does not.
    rest = 1 + gained - jnp.square(speed)
    loss = rest + _trust(lost, scale + jnp.abs(gained)) * (lost - rest)
    error = jnp.abs(left - jnp.square(speed)) / largest
    return Balance(weighed, loss, error)


def _trust(energies: Number, other: Number, possible: Flag | bool = True) -> Number:
    """The weight of what is known by `energies`, where its alternative has the error of `other`."""
    known = possible & (energies < _HOPELESS * other)
    doubt = _CAUTION * energies / jnp.where(known, other, 1)
    return jnp.where(known, 1 / (1 + jnp.square(jnp.square(doubt))), 0)
