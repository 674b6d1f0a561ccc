"""The errors of a solved impact: tolerances of its steps, the balance of its energies, and whether
rounding decides its end.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from ..._forms import Flag
from ..._laws import AbstractPlasticForm
from .coordinates import Number, State
from .equation import Motion

# The controller bounds the error of a step. The measured error of the outcome is up to twenty times
# larger.
_SAFETY = 0.02
# In units of the impact's energy: a contact whose damping takes more certainly stays, with a safety
# margin.
_STAYS = 100.0
# Energies with a weight below 1e-12 are left out.
_HOPELESS = 1e3
# The factor by which energies are trusted less than the speed. Under a pull their error is that of
# a position, measured to be ten times larger.
_CAUTION = 4
# A larger energy imbalance, in units of rtol, means that the solve missed something. The largest
# one measured is 12.
_IMBALANCE = 100
# The measured error of the final energy, in rounding errors of the largest energy.
_ROUNDING = 50
# Tolerances in units of rtol: for the share of the initial energy left when an impact settles, and
# for the relative error of its duration.
_SPENT, _LATE = 100, 10
# The least overshoot beyond rest for a turn. The first number is in step tolerances, for a velocity
# that is zero within them. In float32 turns nearer to rest had up to 1.9 times the allowed error of
# their time, and those up to 1.7 times as far from rest at most 0.5 (3,300 lanes). The second is in
# the same over rtol, for an accurate time. Its relative error was up to 1.3e-3 of a tolerance over
# the overshoot (400 lanes).
_BEYOND, _BEYOND_IN_TIME = 40, 5e-6


def finest(tolerance: float, dtype: Any) -> float:
    """Return the tolerance of a step for a tolerance of the outcome, not below rounding."""
    return max(_SAFETY * tolerance, 10 * float(jnp.finfo(dtype).eps))


def smallness(motion: Motion) -> tuple[Number | float, Number | float]:
    """Return the relative size of the terms that end the motion, in the forces and the speed.
    Both are 1 unless damping is strong. A creeping contact without tension ends where forces
    cancel that differ little all the way. Before the turn little speed is left.
    """
    form, push = motion.form, motion.push
    if form.ends_apart:
        return 1.0, 1.0
    if form.remembers and not form.tension:
        alpha = cast(AbstractPlasticForm, form).alpha
        if push is None or alpha is None:
            return 1.0, 1.0
        # The speed differs little from 1/α where a pull ends the contact.
        slow = jnp.where(push < 0, 1 / jnp.maximum(alpha, 1), 1)
        return slow, slow
    pulls = form.tension or form.never_pulls
    ending = 1.0 if pulls else form.creeping_excess(motion.n)
    return _fastest(motion) * ending, _least_speed(motion)


def _least_speed(motion: Motion) -> Number | float:
    """Return the speed left before the turn or, where it is less, at the end."""
    form, push, momentum = motion.form, motion.push, motion.momentum
    # With strong damping the coordinate is small at touch and on all of the way.
    speed = form.creeping_speed(motion.n) if momentum is None else motion.momentum_at_touch()
    if form.tension and motion.order == 1 and momentum is None:
        # For k = 1 a slow way out ends at a speed as small as e.
        tiny = math.sqrt(jnp.finfo(jax.tree.leaves(motion)[0].dtype).tiny)
        if motion.always_parts:
            return tiny
        return speed if push is None else jnp.where(push < 0, tiny, speed)
    if push is not None and form.never_pulls and not form.tension:
        # Under a weak pull the force falls to the size of the pull before it vanishes.
        speed = speed * jnp.where(push < 0, jnp.clip(-push, 1e-12, 1), 1)
    return speed


def _fastest(motion: Motion) -> Number | float:
    """Return the speed of the impact over the largest speed, which a strong push causes. Without
    it, the errors of the fast motion would be large compared with the slow end of a contact.
    """
    static, damping = motion.static_indentation(), motion.form.damping(motion.n, jnp.asarray(True))
    if motion.push is None or static is None or damping is None:
        return 1.0
    fastest = jnp.sqrt(1 + jnp.maximum(motion.push, 0) * static)
    c, p = damping
    parts = c * static ** (motion.n - p + 1) * fastest < _STAYS
    return jnp.where(parts, 1 / fastest, 1)


class Balance(NamedTuple):
    """The `restitution` e and the `energy_loss`, in units of the initial energy. `error` is the
    energy imbalance relative to the largest energy of the motion.
    """

    restitution: Number
    energy_loss: Number
    error: Number

    def closes(self, rtol: float) -> Bool[Array, ""]:
        """Return whether the energies balance as a solve with this tolerance allows."""
        return self.error <= _IMBALANCE * rtol


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


def end_is_sharp(motion: Motion, turn: State, end: State, rtol: float) -> Bool[Array, ""]:
    """Return whether rounding changes the end time of a pushed contact by less than 10 rtol. The
    error of the speed v at the end is dv = eps Γ x/v, with the x of the turn. The error of the
    duration T is at most dv/Γ, and at most T dv/v.
    """
    if motion.push is None:
        return jnp.asarray(True)
    push = jnp.maximum(motion.push, 0)
    rounding = _ROUNDING * jnp.finfo(end.w.dtype).eps * push * motion.indentation(turn.w)
    speed = jnp.abs(motion.velocity(end))
    return rounding <= _LATE * rtol * speed * jnp.maximum(push * end.t, speed)


def force_is_sharp(motion: Motion, end: State, rtol: float) -> Bool[Array, ""]:
    """Return whether rounding moves the end of a plastic contact, before x_p, by less than 10 rtol
    of its duration; True for other contacts. The speed there is 1/α, and a pull Γ changes it by its
    rounding in eps/(αΓ).
    """
    plastic = motion.form.remembers and not motion.form.tension
    form = cast(AbstractPlasticForm, motion.form)
    if not plastic or motion.push is None or form.alpha is None:
        return jnp.asarray(True)
    velocity, eps = motion.velocity(end), jnp.finfo(end.w.dtype).eps
    whole = (motion.push >= 0) | (form.damped(velocity) > math.sqrt(eps))
    late = eps * jnp.abs(velocity)
    return whole | (late <= _LATE * rtol * end.t * jnp.abs(motion.push))


def turn_is_sharp(motion: Motion, turn: State, rtol: float) -> Bool[Array, ""]:
    """Return whether bodies overshoot their rest position far enough to determine the turn time.
    Near critical damping the overshoot is almost zero, and the bodies stay there for long.
    """
    static = motion.static_indentation()
    if motion.push is None or static is None:
        return jnp.asarray(True)
    beyond = jnp.abs(turn.w**motion.order - static)
    least = finest(rtol, turn.w.dtype) * max(_BEYOND, _BEYOND_IN_TIME / rtol)
    return (motion.push <= 0) | (beyond >= least * static)


def is_spent(motion: Motion, end: State, rtol: float) -> Bool[Array, ""]:
    """Return whether damping has taken the energy of the impact, as in a settled contact. A contact
    that turned inwards without this loss turned because of rounding.
    """
    return 2 * motion.lost(end) >= 1 - _SPENT * rtol
