"""Checks of rounding errors in an impact under a push that makes the bodies faster."""

from __future__ import annotations

from typing import cast

import jax.numpy as jnp
from jaxtyping import Array, Bool

from .ending import PlasticMotion
from .motion import Motion, State

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
    """Return whether rounding changes the time at which a plastic contact ends by less than 10
    rtol; True for other contacts.
    """
    if motion.form.remembers and not motion.form.tension:
        return cast(PlasticMotion, motion).force_is_sharp(end, _LATE * rtol)
    return jnp.asarray(True)


def is_spent(motion: Motion, end: State, rtol: float) -> Bool[Array, ""]:
    """Return whether damping has taken the energy of the impact, as in a settled contact. A contact
    that turned inwards without this loss turned because of rounding.
    """
    return 2 * motion.lost(end) >= 1 - _SPENT * rtol


def turn_is_sharp(motion: Motion, turn: State, finest: float, rtol: float) -> Bool[Array, ""]:
    """Return whether bodies overshoot their rest position far enough to determine the turn time.
    Near critical damping the overshoot is almost zero, and the bodies stay there for long.
    """
    static = motion.static_indentation()
    if motion.push is None or static is None:
        return jnp.asarray(True)
    beyond = jnp.abs(turn.w**motion.order - static)
    least = finest * max(_BEYOND, _BEYOND_IN_TIME / rtol)
    return (motion.push <= 0) | (beyond >= least * static)
