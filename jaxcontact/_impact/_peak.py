"""The largest force along a solved stretch of motion, between its steps too."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .._implicit import bracketed_root, ratio
from ._motion import Motion, Number, State


class Path(NamedTuple):
    """States along a stretch of motion, when (in regularised time), and which of them are real."""

    moments: Float[Array, " steps"]
    states: State
    taken: Bool[Array, " steps"]


def largest_force(motion: Motion, path: Path, compressing: Bool[Array, ""]) -> Number:
    """The largest force among the taken states and between them, to the accuracy of a step.

    The step that holds the maximum is taken again by one Runge-Kutta step of a fraction θ, chosen
    so that the force is stationary. A stationary value does not move with θ to first order, so θ
    may be a constant to the derivative.
    """
    moments, states, taken = path
    states = states._replace(loss=None)
    # Unused entries hold infinities: the state at touch replaces them.
    states = jax.tree.map(lambda leaf: jnp.where(taken, leaf, leaf[0]), states)
    forces = jax.vmap(lambda state: motion.force(state, compressing))(states)
    best = jnp.argmax(jax.lax.stop_gradient(jnp.where(taken, forces, -jnp.inf)))
    frozen, fixed, moments = jax.lax.stop_gradient(
        (motion, states, jnp.where(taken, moments, moments[0]))
    )

    def slope(state: State) -> Number:
        return _steepness(frozen, state, compressing)

    # From the best state to the next one, or to it from the one before.
    near = jnp.clip(best + jnp.arange(-1, 2), 0, jnp.sum(taken) - 1)
    slopes = jax.vmap(lambda index: slope(_at(fixed, index)))(near)
    first = jnp.where(slopes[1] > 0, 1, 0)
    left, before, after = near[first], slopes[first], slopes[first + 1]
    size = moments[near[first + 1]] - moments[left]

    def later(fraction: Number) -> Number:
        return slope(frozen.later(_at(fixed, left), fraction * size, compressing))

    # Without a change of sign the maximum is at an end, at touch for a law that jumps there.
    inside = (before > 0) & (after < 0)
    theta = jnp.where(inside, bracketed_root(later, before, after, iterations=100), 0)
    between = motion.force(motion.later(_at(states, left), theta * size, compressing), compressing)
    return jnp.maximum(between, forces[best])


def _at(states: State, index: Int[Array, ""]) -> State:
    return jax.tree.map(lambda leaf: leaf[index], states)


def _steepness(motion: Motion, state: State, compressing: Bool[Array, ""]) -> Number:
    """w dF/dτ beside F dw/dτ along the motion: from -1 to 1, of the sign of dF/dτ.

    Positive at touch, where a force that is a power of x has no slope of its own; bounded, because
    regula falsi crawls where one end is much steeper than the other.
    """
    rate = motion.rate(state, compressing)
    force, change = jax.jvp(lambda s: motion.force(s, compressing), (state,), (rate,))
    pushing = (state.w > 0) & (force > 0)
    alone = jnp.where(force == 0, rate.w, change)
    slope = jnp.where(pushing, state.w * change, alone)
    speed = jnp.abs(rate.w) * jnp.where(pushing, force, 1)
    return ratio(slope, jnp.abs(slope) + speed)


def is_rising(motion: Motion, state: State, compressing: Bool[Array, ""]) -> Bool[Array, ""]:
    """Whether the force rises with x, by more than the nearly constant one of creeping bodies."""
    return _steepness(motion, state, compressing) > 0.01
