"""The largest force along a solved stretch of motion, between its steps too."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .._implicit import bracketed_root
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
    # Unused entries hold infinities: the state at touch replaces them.
    states = jax.tree.map(lambda leaf: jnp.where(taken, leaf, leaf[0]), states)
    moments = jax.lax.stop_gradient(jnp.where(taken, moments, moments[0]))
    forces = jax.vmap(lambda state: motion.force(state, compressing))(states)
    best = jnp.argmax(jax.lax.stop_gradient(jnp.where(taken, forces, -jnp.inf)))
    last = jnp.sum(taken) - 1
    frozen = jax.lax.stop_gradient(motion)
    rising = _force_rate(frozen, jax.lax.stop_gradient(_at(states, best)), compressing) > 0
    left = jnp.clip(jnp.where(rising, best, best - 1), 0, jnp.maximum(last - 1, 0))
    size = moments[left + 1] - moments[left]
    start = jax.lax.stop_gradient(_at(states, left))
    finish = jax.lax.stop_gradient(_at(states, left + 1))

    def slope(fraction: Number) -> Number:
        return _force_rate(frozen, frozen.later(start, fraction * size, compressing), compressing)

    # Without a change of sign the maximum is at an end, at touch for a law that jumps there.
    before, after = slope(jnp.zeros_like(size)), _force_rate(frozen, finish, compressing)
    inside = (before > 0) & (after < 0)
    theta = jnp.where(inside, bracketed_root(slope, before, after, iterations=10), 0)
    between = motion.force(motion.later(_at(states, left), theta * size, compressing), compressing)
    return jnp.maximum(between, forces[best])


def _at(states: State, index: Int[Array, ""]) -> State:
    return jax.tree.map(lambda leaf: leaf[index], states)


def _force_rate(motion: Motion, state: State, compressing: Bool[Array, ""]) -> Number:
    """dF/dτ along the motion."""
    return jax.jvp(
        lambda s: motion.force(s, compressing), (state,), (motion.rate(state, compressing),)
    )[1]
