"""The energy balance of an integrated impact: loss, remainder and imbalance."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp

from ..._forms import Flag
from .motion import Motion, Number, State

# Energies with a weight below 1e-12 are left out.
_HOPELESS = 1e3
# The factor by which energies are trusted less than the speed. Under a pull their error is that of
# a position, measured to be ten times larger.
_CAUTION = 4


class Balance(NamedTuple):
    """The `restitution` e and the `energy_loss`, in units of the initial energy. `error` is the
    energy imbalance relative to the largest energy of the motion.
    """

    restitution: Number
    energy_loss: Number
    error: Number


def balance_of(motion: Motion, end: State, max_indentation: Number) -> Balance:
    """Return the energies at the end: e² = 1 + 2Γx - 2 (work of damping + ∫ f(x, 0) dx).

    The energy loss is the work of damping plus the elastic energy left in a contact without tension
    at its end. The restitution is a weighted mean of the values from velocity and from energy, with
    most weight on the energy if little is lost. That keeps the digits of 1 - e. It also keeps the
    digits of e under a force that makes the bodies much faster than they came.
    """
    speed, push = -motion.velocity(end), motion.push
    # Rounding may put the root for x = 0 below it.
    at = end._replace(w=jnp.maximum(end.w, 0))
    taken = motion.lost(end)
    lost = 2 * (taken if motion.one_way else taken + motion.stored(at))
    left, changed, largest = 1 - lost, lost, jnp.ones_like(lost)
    if (well := motion.form.well()) is not None:
        largest = largest + 2 * well
    gained = jnp.zeros_like(lost)
    if push is not None:
        gained = 2 * push * motion.indentation(at.w)
        left, changed = left + gained, changed + jnp.abs(gained)
        largest = largest + 2 * jnp.maximum(push, 0) * max_indentation
    # The energy route has the error of its energies in e², the velocity route 2 e times that of the
    # speed. The weights are smooth, because a fit would stop at a switch.
    scale = 2 * speed * jnp.sqrt(largest)
    trust = _trust(changed, scale, left > 0)
    by_energy = jnp.sqrt(jnp.where(trust > 0, left, 1))
    weighed = speed + trust * (by_energy - speed)
    # If nearly everything is lost, the remainder gives a better loss. A sum of non-negative terms
    # keeps its digits, but a difference from the work of the push does not.
    rest = 1 + gained - jnp.square(speed)
    loss = rest + _trust(lost, scale + jnp.abs(gained)) * (lost - rest)
    error = jnp.abs(left - jnp.square(speed)) / largest
    return Balance(weighed, loss, error)


def _trust(energies: Number, other: Number, possible: Flag | bool = True) -> Number:
    """Return the weight of the value from `energies` if its alternative has the error `other`."""
    known = possible & (energies < _HOPELESS * other)
    doubt = _CAUTION * energies / jnp.where(known, other, 1)
    return jnp.where(known, 1 / (1 + jnp.square(jnp.square(doubt))), 0)
