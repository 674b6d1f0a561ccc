"""The largest force along a solved stretch of motion, between its steps too."""

from __future__ import annotations

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .._implicit import bracketed_root, ratio
from ._motion import Moment, Motion, Number, State


class Path(NamedTuple):
    """States along a stretch of motion, and when, in regularised time."""

    moments: Float[Array, " steps"]
    states: State


def largest_force(
    motion: Motion, path: Path, compressing: Bool[Array, ""], sign: int = 1
) -> Number:
    """The largest force among the states of a path and between them; of -F where `sign` is -1."""
    moments, states = path.moments, path.states._replace(loss=None)
    forces = jax.vmap(lambda state: sign * motion.force(state, compressing))(states)
    best = jnp.argmax(jax.lax.stop_gradient(forces))
    near = jnp.clip(best + jnp.arange(-1, 2), 0, moments.size - 1)
    before, at, after = (Moment(moments[index], _at(states, index)) for index in near)
    return largest_near(motion, before, at, after, compressing, sign)


def largest_near(
    motion: Motion,
    before: Moment,
    best: Moment,
    after: Moment,
    compressing: Bool[Array, ""],
    sign: int = 1,
) -> Number:
    """The largest force near the best of three neighbouring states, to the accuracy of a step; of
    -F where `sign` is -1.

    The step that holds the maximum is taken again by one Runge-Kutta step of a fraction θ, chosen
    so that the force is stationary. A stationary value does not move with θ to first order, so θ
    may be a constant to the derivative.
    """
    frozen, fixed = jax.lax.stop_gradient((motion, (before, best, after)))

    def slope(state: State) -> Number:
        return _steepness(frozen, state, compressing, sign)

    slopes = jax.vmap(slope)(
        jax.tree.map(lambda *leaves: jnp.stack(leaves), *(m.state for m in fixed))
    )
    # From the best state to the next one, or to it from the one before.
    rising = slopes[1] > 0
    chosen = functools.partial(jnp.where, rising)
    left = jax.tree.map(chosen, fixed[1], fixed[0])
    size = chosen(fixed[2].tau, fixed[1].tau) - left.tau
    first, last = chosen(slopes[1], slopes[0]), chosen(slopes[2], slopes[1])

    def later(fraction: Number) -> Number:
        return slope(frozen.later(left.state, fraction * size, compressing))

    # Without a change of sign the maximum is at an end, at touch for a law that jumps there.
    inside = (first > 0) & (last < 0)
    theta = jnp.where(inside, bracketed_root(later, first, last, iterations=100), 0)
    start = jax.tree.map(chosen, best.state, before.state)
    between = motion.force(motion.later(start, theta * size, compressing), compressing)
    return jnp.maximum(sign * between, sign * motion.force(best.state, compressing))


def _at(states: State, index: Int[Array, ""]) -> State:
    return jax.tree.map(lambda leaf: leaf[index], states)


def _steepness(motion: Motion, state: State, compressing: Bool[Array, ""], sign: int = 1) -> Number:
    """w dF/dτ beside F dw/dτ along the motion: from -1 to 1, of the sign of dF/dτ.

    Positive at touch, where a force that is a power of x has no slope of its own; bounded, because
    regula falsi crawls where one end is much steeper than the other.
    """
    rate = motion.rate(state, compressing)
    force, change = jax.jvp(lambda s: sign * motion.force(s, compressing), (state,), (rate,))
    pushing = (state.w > 0) & (force > 0)
    alone = jnp.where(force == 0, rate.w, change)
    slope = jnp.where(pushing, state.w * change, alone)
    speed = jnp.abs(rate.w) * jnp.where(pushing, force, 1)
    return ratio(slope, jnp.abs(slope) + speed)


def is_rising(motion: Motion, state: State, compressing: Bool[Array, ""]) -> Bool[Array, ""]:
    """Whether the force rises with x, by more than the nearly constant one of creeping bodies."""
    return _steepness(motion, state, compressing) > 0.01
