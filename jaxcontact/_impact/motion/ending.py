"""The end of a contact without the rounding error of the gap that ended it. The motions of necks,
and of elastic-plastic contacts, which unload to their plastic indentation x_p; and energy balances.
"""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from ..._entry import static_value
from ..._forms import AbstractPlasticForm, Flag, JKRForm
from ..._functions import power
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


# The number of rounds in which place and speed of an end are computed from each other. With x^p = c
# v and v² = E + 2Γx an error of v shrinks by the factor Γx/(p v²) < 1/(2p), p ≥ 1.
_ROUNDS = 3


def at_end(motion: Motion, end: State, arrived: Bool[Array, ""], max_indentation: Number) -> State:
    """Return the end of a way out, computed from its own formulas. The search locates a moment
    within the rounding of a whole step. Place and speed may change within it by much more than
    their values at the end.
    """
    parted = arrived & (motion.velocity(end) < 0) & ~motion.settled(end)
    end = _at_touch(motion, end, parted & motion.parts_at_touch())
    softness = motion.softness
    if motion.form.tension or motion.one_way or softness is None:
        return end
    strength, p = softness
    if motion.push is not None and static_value(p) != 0:
        # A weakly damped contact ends at x^p = -c v, with the speed from the energies. After a
        # strong push the speed has the rounding of a much larger one. The place inherits it, and
        # the work of the push over that place is a part of e.
        for _ in range(_ROUNDS):
            speed = balance_of(motion, end, max_indentation).restitution
            place = power(motion.damping_back()[0] * speed, 1 / (motion.order * p))
            end = end._replace(w=jnp.where(parted & (strength == 0), place, end.w))
    rate = motion.rate(end, jnp.asarray(False))
    sooner = jnp.abs(end.u * rate.w) < jnp.abs(end.w * rate.u)
    vanished = (strength > 0) & sooner & ~motion.settled(end)
    return end._replace(u=jnp.where(vanished, 0, end.u))


def _at_touch(motion: Motion, end: State, parted: Bool[Array, ""]) -> State:
    touching = end._replace(w=jnp.zeros_like(end.w))
    if motion.momentum is None:
        touching = touching._replace(u=motion.velocity(end) + motion.creep(touching.w))
    return jax.tree.map(functools.partial(jnp.where, parted), touching, end)


class NeckMotion(Motion):
    """One lane of a JKR contact, in the coordinate w of its form: dt = (dx/dw) dτ, so that w' = v.

    It starts at w > 0, where x = 0, and ends at w = 0, the snap.
    """

    form: JKRForm

    @property
    def order(self) -> int:
        """One: w is a coordinate of its own."""
        return 1

    def indentation(self, w: Number) -> Number:
        return self.form.indentation_at(w)

    def start(self) -> State:
        touch = super().start()
        return touch._replace(w=touch.w + self.form.touch_at())

    def force(self, state: State, compressing: Flag) -> Number:
        del compressing
        return self.form.force_at(state.w)

    def rate(self, state: State, compressing: Flag) -> State:
        clock, force = self.form.pace_at(state.w), self.force(state, compressing)
        if self.push is not None:
            force = force - self.push
        loss = None if state.loss is None else jnp.zeros_like(state.loss)
        return State(state.u, -force * clock, clock, loss)

    def stored(self, state: State) -> Number:
        return self.form.energy_at(state.w)

    def smallness(self) -> tuple[Number | float, Number | float]:
        return 1.0, 1.0

    def spare_energy(self, state: State) -> Number:
        """Return the energy of a state above that of the snap."""
        end = state._replace(w=jnp.zeros_like(state.w))
        return self.energy(state) - self.energy(end._replace(u=end.w))


class PlasticMotion(Motion):
    """One lane of a contact without adhesion: x = w^k up to the turn, and x = x_p + w^k after it.

    So the way back is κ w^(kn), and w = 0 ends the contact.
    """

    form: AbstractPlasticForm

    def indentation(self, w: Number) -> Number:
        return self.form.plastic(w) + w**self.order

    def after_turn(self, turn: State) -> tuple[Motion, State]:
        unloads, begun = super().after_turn(turn)
        left = self.indentation(turn.w) - unloads.indentation(jnp.zeros_like(turn.w))
        return unloads, begun._replace(w=power(left, 1 / self.order))

    def force(self, state: State, compressing: Flag) -> Number:
        still = self.form.force_at(state.w, self.order, compressing)
        return still * self.form.damped(self.velocity(state))

    def pull(self, state: State, compressing: Flag) -> Number:
        return state.w ** (self.order - 1) * self.force(state, compressing)

    def dissipation(self, state: State, velocity: Number, compressing: Flag) -> Number:
        if self.form.alpha is None:
            return jnp.zeros_like(state.w)
        still = self.form.force_at(state.w, self.order, compressing) * state.w ** (self.order - 1)
        return self.form.alpha * jnp.square(velocity) * still

    def stored(self, state: State) -> Number:
        return self.form.stored(self.indentation(state.w), self.n, 1)

    def smallness(self) -> tuple[Number | float, Number | float]:
        if self.push is None or self.form.alpha is None:
            return 1.0, 1.0
        # The speed differs little from 1/α where a pull ends the contact.
        slow = jnp.where(self.push < 0, 1 / jnp.maximum(self.form.alpha, 1), 1)
        return slow, slow

    def force_is_sharp(self, end: State, allowed: float) -> Bool[Array, ""]:
        """Return whether rounding moves an end before x_p by less than the `allowed` share of the
        duration. The speed there is 1/α, and a pull Γ changes it by its rounding in eps/(αΓ).
        """
        if self.push is None or self.form.alpha is None:
            return jnp.asarray(True)
        velocity, eps = self.velocity(end), jnp.finfo(end.w.dtype).eps
        whole = (self.push >= 0) | (self.form.damped(velocity) > math.sqrt(eps))
        late = eps * jnp.abs(velocity)
        return whole | (late <= allowed * end.t * jnp.abs(self.push))

    @property
    def ends_smoothly(self) -> bool:
        return True

    def parts_at_touch(self) -> Bool[Array, ""]:
        return jnp.asarray(True) if self.push is None else self.push >= 0

    def gap_of_force(self, state: State) -> Number:
        pulled = False if self.push is None else self.push < 0
        return self.form.gap(state.w, self.velocity(state), pulled)
