"""The end of a contact that lies between two steps, neither of which shows it."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .._implicit import bracketed_root
from ._motion import Motion, Number, State


def dip(
    motion: Motion, moments: Float[Array, " steps"], states: State, steps: Int[Array, ""]
) -> tuple[Bool[Array, ""], Int[Array, ""], Number]:
    """Whether the force vanished and came back within a step of a way out; which step; when.

    A force that may not pull ends the contact where it vanishes. Under a push the bodies may slow
    down so much that it would soon be positive again. The moment is one in between, no event yet.
    """
    motion, moments, states = jax.lax.stop_gradient((motion, moments, states._replace(loss=None)))
    taken = jnp.arange(moments.size) <= steps
    # Unused entries hold infinities: the first state replaces them.
    states = jax.tree.map(lambda leaf: jnp.where(taken, leaf, leaf[0]), states)
    out = jnp.asarray(False)

    def gap(state: State) -> tuple[Number, Number]:
        return jax.jvp(motion.gap_of_force, (state,), (motion.rate(state, out),))

    gaps, slopes = jax.vmap(gap)(states)
    turns = (slopes[:-1] < 0) & (slopes[1:] > 0) & (gaps[:-1] > 0) & (gaps[1:] > 0) & taken[1:]
    index = jnp.argmax(turns)
    found = turns[index]
    start = jax.tree.map(lambda leaf: leaf[index], states)
    size = jnp.where(found, moments[index + 1] - moments[index], 1)

    def rise(fraction: Number) -> Number:
        slope = gap(motion.later(start, fraction * size, out))[1]
        return jnp.where(found, -slope, 0.5 - fraction)

    ends = [jnp.where(found, -slopes[index + k], 0.5 - k) for k in (0, 1)]
    lowest = bracketed_root(rise, *ends, iterations=60) * size
    closes = gap(motion.later(start, lowest, out))[0] <= 0
    return found & closes, index, moments[index] + lowest
