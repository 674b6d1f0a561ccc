"""The end of a contact that lies between two steps, neither of which shows it."""

from __future__ import annotations

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._implicit import bracketed_root
from ._motion import Moment, Motion, Number, State


class Dip(NamedTuple):
    """Where the force of a way out first had a minimum within a step, if it was `found`.

    A force that may not pull ends the contact where it vanishes. Under a push the bodies may slow
    down so much that it would soon be positive again. The step begins at `start`, is of the given
    `size` and has `slopes` at its ends. `gap` and `slope` are those of the force at the last state.
    """

    gap: Number
    slope: Number
    found: Bool[Array, ""]
    start: Moment
    size: Number
    slopes: Float[Array, "2"]

    @staticmethod
    def begin(start: Moment) -> Dip:
        """Nothing seen yet of a motion from `start` on."""
        zero = jnp.zeros_like(start.tau)
        return Dip(zero, zero, jnp.isnan(zero), start, zero, jnp.zeros(2, zero.dtype))

    def seen(self, motion: Motion, last: Moment, now: Moment) -> Dip:
        """With the state `now`, which followed on `last`."""
        gap, slope = _gap(*jax.lax.stop_gradient((motion, now.state)))
        turns = ~self.found & (self.slope < 0) & (slope > 0) & (self.gap > 0) & (gap > 0)
        size = jax.lax.stop_gradient(now.tau - last.tau)
        return Dip(
            gap=gap,
            slope=slope,
            found=self.found | turns,
            start=jax.tree.map(functools.partial(jnp.where, turns), last, self.start),
            size=jnp.where(turns, size, self.size),
            slopes=jnp.where(turns, jnp.stack([self.slope, slope]), self.slopes),
        )

    def bottom(self, motion: Motion) -> tuple[Bool[Array, ""], Moment]:
        """Whether the force vanishes at its minimum, and when, which is no event yet."""
        motion, start = jax.lax.stop_gradient((motion, self.start.state))
        size = jnp.where(self.found, self.size, 1)

        def rise(fraction: Number) -> Number:
            slope = _gap(motion, motion.later(start, fraction * size, jnp.asarray(False)))[1]
            return jnp.where(self.found, -slope, 0.5 - fraction)

        ends = [jnp.where(self.found, -self.slopes[k], 0.5 - k) for k in (0, 1)]
        lowest = bracketed_root(rise, *ends, iterations=60) * size
        state = motion.later(start, lowest, jnp.asarray(False))
        closes = _gap(motion, state)[0] <= 0
        return self.found & closes, Moment(self.start.tau + lowest, state)


def _gap(motion: Motion, state: State) -> tuple[Number, Number]:
    """What vanishes with the force, and its slope."""
    state = state._replace(loss=None)
    return jax.jvp(motion.gap_of_force, (state,), (motion.rate(state, jnp.asarray(False)),))
