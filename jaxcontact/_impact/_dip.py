"""The end of a contact that lies between two steps, neither of which shows it."""

from __future__ import annotations

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from ._motion import Moment, Motion, Number, State
from ._root_in_step import StepTaken, root_in_step


class Dip(NamedTuple):
    """Where the force of a way out first had a minimum within a step, if it was `found`.

    A force that may not pull ends the contact where it vanishes. Under a push the bodies may slow
    down so much that it would soon be positive again. The step begins at `start` and is of `size`;
    `gap` and `slope` are those of the force at the last state.
    """

    gap: Number
    slope: Number
    found: Bool[Array, ""]
    start: Moment
    size: Number

    @staticmethod
    def begin(start: Moment) -> Dip:
        """Nothing seen yet of a motion from `start` on."""
        zero = jnp.zeros_like(start.tau)
        return Dip(zero, zero, jnp.isnan(zero), start, zero)

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
        )

    def bottom(self, motion: Motion) -> tuple[Bool[Array, ""], Moment]:
        """Whether the force vanishes at its minimum, and when, which is no event yet."""
        motion, start = jax.lax.stop_gradient((motion, self.start.state))
        size, out = jnp.where(self.found, self.size, 1), jnp.asarray(False)

        def later(fraction: Number) -> State:
            return motion.later(start, fraction * size, out)

        end = later(jnp.ones_like(size))
        step = StepTaken(start, end, size, lambda state: motion.rate(state, out), later)
        lowest = root_in_step(lambda state: -_gap(motion, state)[1], step, self.found) * size
        state = motion.later(start, lowest, out)
        closes = _gap(motion, state)[0] <= 0
        return self.found & closes, Moment(self.start.tau + lowest, state)


def _gap(motion: Motion, state: State) -> tuple[Number, Number]:
    """What vanishes with the force, and its slope."""
    state = state._replace(loss=None)
    return jax.jvp(motion.gap_of_force, (state,), (motion.rate(state, jnp.asarray(False)),))
