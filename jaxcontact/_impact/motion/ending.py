"""The end of a contact, without what rounding left of the gap that ended it."""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from ..._elementary import power
from .balance import balance_of
from .motion import Motion, Number, State

# How often the place and the speed of an end are found from each other. With x^p = c v and
# v² = E + 2Γx an error of v comes back as Γx/(p v²) < 1/(2p) of itself, p ≥ 1.
_ROUNDS = 3


def at_end(motion: Motion, end: State, arrived: Bool[Array, ""], max_indentation: Number) -> State:
    """The end of a way out, as exactly as its own formulas tell it.

    The search puts a moment within the rounding of a whole step, in which place and speed may
    change much more than they are at the end.
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
    """Weak damping ends a contact at x^p = -c v: with the speed that the energies say there.

    After a strong push the speed has the rounding of one much larger, and the place with it, whose
    work under the push is a part of e.
    """
    assert motion.softness is not None
    softness, p = motion.softness
    weak = parted & (softness == 0)
    for _ in range(_ROUNDS):
        speed = balance_of(motion, end, max_indentation).restitution
        place = power(motion.damping_back()[0] * speed, 1 / (motion.order * p))
        end = end._replace(w=jnp.where(weak, place, end.w))
    return end
