"""What rounding leaves of an impact under a force that makes the bodies faster than they came."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Bool

from .motion import Motion, State

# In units of rounding of the largest energy: by how much the energy at the end is off, measured.
_ROUNDING = 50
# What an impact may lack of its initial energy when it settles, and its duration of itself, in
# units of rtol.
_SPENT, _LATE = 100, 10
# How far beyond rest bodies must go before they turn: in tolerances of a step, for a velocity that
# is zero within them; and in the same over rtol, for a time that is known as well as its condition
# allows. Near critical damping that time was off, relatively, by up to 1.3e-3 of a tolerance over
# the way beyond (400 lanes).
_BEYOND, _BEYOND_IN_TIME = 10, 5e-6


def end_is_sharp(motion: Motion, turn: State, end: State, rtol: float) -> Bool[Array, ""]:
    """Whether rounding moves the end of a pushed contact by less than 10 rtol of its duration.

    At the end the speed v is off by dv = eps Γ x/v, x that of the turn, and the duration T by dv/Γ
    at most, and by T dv/v.
    """
    if motion.push is None:
        return jnp.asarray(True)
    push = jnp.maximum(motion.push, 0)
    rounding = _ROUNDING * jnp.finfo(end.w.dtype).eps * push * turn.w**motion.order
    speed = jnp.abs(motion.velocity(end))
    return rounding <= _LATE * rtol * speed * jnp.maximum(push * end.t, speed)


def is_spent(motion: Motion, end: State, rtol: float) -> Bool[Array, ""]:
    """Whether damping has taken the energy of the impact, as it has where bodies settle.

    What has not lost it but was turned inwards was turned by rounding.
    """
    return 2 * motion.lost(end) >= 1 - _SPENT * rtol


def turn_is_sharp(motion: Motion, turn: State, finest: float, rtol: float) -> Bool[Array, ""]:
    """Whether bodies that turn do so far enough beyond their place at rest to tell when.

    Near critical damping they go beyond it by next to nothing, and are still there for long.
    """
    static = motion.static_indentation()
    if motion.push is None or static is None:
        return jnp.asarray(True)
    beyond = jnp.abs(turn.w**motion.order - static)
    least = finest * max(_BEYOND, _BEYOND_IN_TIME / rtol)
    return (motion.push <= 0) | (beyond >= least * static)
