"""The end of a contact, without the rounding error of the gap that ended it."""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from ..._functions import power
from .balance import balance_of
from .motion import Motion, Number, State

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
    _, p = softness
    if motion.push is not None and not (isinstance(p, float) and p == 0):
        end = _where_force_vanishes(motion, end, parted, max_indentation)
    rate = motion.rate(end, jnp.asarray(False))
    sooner = jnp.abs(end.u * rate.w) < jnp.abs(end.w * rate.u)
    vanished = (softness[0] > 0) & sooner & ~motion.settled(end)
    return end._replace(u=jnp.where(vanished, 0, end.u))


def _at_touch(motion: Motion, end: State, parted: Bool[Array, ""]) -> State:
    touching = end._replace(w=jnp.zeros_like(end.w))
    if motion.momentum is None:
        touching = touching._replace(u=motion.velocity(end) + motion.creep(touching.w))
    return jax.tree.map(functools.partial(jnp.where, parted), touching, end)


def _where_force_vanishes(
    motion: Motion, end: State, parted: Bool[Array, ""], max_indentation: Number
) -> State:
    """Return the end of a weakly damped contact at x^p = -c v, with the speed from the energies.
    After a strong push the speed has the rounding of a much larger one. The place inherits it, and
    the work of the push over that place is a part of e.
    """
    assert motion.softness is not None
    softness, p = motion.softness
    weak = parted & (softness == 0)
    for _ in range(_ROUNDS):
        speed = balance_of(motion, end, max_indentation).restitution
        place = power(motion.damping_back()[0] * speed, 1 / (motion.order * p))
        end = end._replace(w=jnp.where(weak, place, end.w))
    return end
