"""The end of a contact between two steps, neither of which shows it."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..._functions import bracketed_root
from ..._solver import Packed, Record, chosen, in_time
from .motion import Motion, Number, State
from .way import Way


class Dip(NamedTuple):
    """The step of a way out in which the force first had a minimum, if it was `found`.

    A force without tension ends the contact where it vanishes. Under a push the bodies may slow
    down so much that it soon becomes positive again. The step begins at `start`, has the given
    `size`, and has `slopes` at its ends. `gap` and `slope` are those of the force at the last
    state.
    """

    gap: Number
    slope: Number
    found: Bool[Array, ""]
    start: Record
    size: Number
    slopes: Float[Array, "2"]

    @staticmethod
    def begin(start: Record, zero: Number) -> Dip:
        """Return an empty record for a motion from `start` on."""
        return Dip(zero, zero, jnp.isnan(zero), start, zero, jnp.zeros(2, zero.dtype))

    def seen(self, motion: Motion, packed: Packed[State], last: Record, now: Record) -> Dip:
        """Return the record with the moment `now`, which follows `last`."""
        gap, slope = _gap(*jax.lax.stop_gradient((motion, packed.state(now))))
        turns = ~self.found & (self.slope < 0) & (slope > 0) & (self.gap > 0) & (gap > 0)
        size = jax.lax.stop_gradient(packed.tau(now) - packed.tau(last))
        return Dip(
            gap=gap,
            slope=slope,
            found=self.found | turns,
            start=chosen(turns, last, self.start),
            size=jnp.where(turns, size, self.size),
            slopes=jnp.where(turns, jnp.stack([self.slope, slope]), self.slopes),
        )

    def bottom(self, way: Way, packed: Packed[State]) -> tuple[Bool[Array, ""], Record]:
        """Return whether the force vanishes at its minimum, and that moment."""
        way, start = jax.lax.stop_gradient((way, self.start))
        size, step = jnp.where(self.found, self.size, 1), packed.step(in_time)

        def rise(fraction: Number) -> Number:
            there, _ = step(way, start, fraction * size)
            slope = _gap(way.motion, packed.state(there))[1]
            return jnp.where(self.found, -slope, 0.5 - fraction)

        ends = [jnp.where(self.found, -self.slopes[k], 0.5 - k) for k in (0, 1)]
        lowest = bracketed_root(rise, *ends, iterations=60) * size
        there, _ = step(way, start, lowest)
        closes = _gap(way.motion, packed.state(there))[0] <= 0
        return self.found & closes, there


def _gap(motion: Motion, state: State) -> tuple[Number, Number]:
    """Return a quantity that vanishes with the force, and its slope."""
    state = state._replace(loss=None)
    return jax.jvp(motion.gap_of_force, (state,), (motion.rate(state, jnp.asarray(False)),))
