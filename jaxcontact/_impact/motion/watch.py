"""A leg of an impact as a field, what is recorded in it, and dips of a force within its steps."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..._forms import Flag
from ..._functions import bracketed_root
from ..._solver import Flags, Packed, Record, chosen, in_time
from .motion import Motion, Number, State

# The share of a force that its tangent predicts where it vanished. A force that is a power p of the
# time to the end leaves 1-p.
_JUMP = 0.9


class Way(eqx.Module):
    """The motion of bodies: until they turn if `compressing`, else until they separate."""

    motion: Motion
    compressing: Flag

    def rate(self, state: State) -> State:
        """Return d(w, u, t)/dτ."""
        return self.motion.rate(state, self.compressing)

    def guards(self, state: State) -> tuple[Number, ...]:
        """Return the closing speed, or the separating speed with the gaps that end the contact."""
        return self.motion.gaps(state, self.compressing)

    @property
    def one_way(self) -> bool:
        """Always False: if strongly damped, the last step to a turn cannot be one of u. Such a step
        was off by 8e-6 of its time.
        """
        return False

    @property
    def smooth(self) -> bool:
        """False if the gap of a force has a corner at the end of the contact."""
        return self.motion.ends_smoothly

    @property
    def clamped(self) -> bool:
        """True if the law may clamp its own force to zero."""
        return self.motion.may_clamp

    def continued(self, inside: State) -> Way:
        """Return the motion under the unclamped force, from a state `inside` the contact."""
        return dataclasses.replace(self, motion=self.motion.continued(inside))

    def jumps(self, inside: State, end: State, closed: Flags) -> Flag:
        """Return whether the force of a way out jumps to zero before x = 0. It does so only if no
        other guard closed, hence not at a turn.
        """
        before, after = map(self.motion.gap_of_force, (inside, end))
        left = (after >= _JUMP * before) & (2 * end.w > inside.w)
        return ~self.compressing & ~closed[0] & closed[-1] & left


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


class Nearest(NamedTuple):
    """The moment of the largest force so far, and those before and after it, packed. `fresh`:
    whether the moment after it is still missing.
    """

    force: Number
    before: Record
    at: Record
    after: Record
    fresh: Bool[Array, ""]

    def seen(self, last: Record, now: Record, force: Number) -> Nearest:
        """Return the record with the moment `now`, which follows `last`."""
        larger = force > self.force
        return Nearest(
            force=jnp.where(larger, force, self.force),
            before=chosen(larger, last, self.before),
            at=chosen(larger, now, self.at),
            after=chosen(larger | self.fresh, now, self.after),
            fresh=larger,
        )


class Watch(NamedTuple):
    """The largest and the least force; whether the bodies creep to rest; a dip of the force.
    `least` has -F as its force, and is None if the contact cannot pull. `creeps` and `dip` are None
    without a push or if the force cannot vanish.
    """

    nearest: Nearest
    least: Nearest | None
    creeps: Bool[Array, ""] | None
    dip: Dip | None

    @staticmethod
    def begin(motion: Motion, packed: Packed[State]) -> Watch:
        """Return an empty record of a motion."""
        start, zero = packed.start, packed.tau(packed.start)
        no = jnp.isnan(zero)
        nearest = Nearest(jnp.full_like(zero, -jnp.inf), start, start, start, no)
        return Watch(
            nearest=nearest,
            least=nearest if motion.may_pull else None,
            creeps=None if motion.push is None else no,
            dip=Dip.begin(start, zero) if motion.may_dip else None,
        )

    def seen(self, way: Way, packed: Packed[State], last: Record, now: Record) -> Watch:
        """Return the record with the accepted moment `now`, which follows `last`."""
        frozen, state = jax.lax.stop_gradient((way.motion, packed.state(now)))
        creeps, dip = self.creeps, self.dip
        if creeps is not None:
            creeps = creeps | frozen.creeps_to_rest(state)
        if dip is not None:
            dip = dip.seen(frozen, packed, last, now)
        force = frozen.force(state, way.compressing)
        least = self.least
        if least is not None:
            # Rounding may put the end below w = 0, where there is no force.
            inside = state._replace(w=jnp.maximum(state.w, 0))
            least = least.seen(last, now, -frozen.force(inside, way.compressing))
        return Watch(self.nearest.seen(last, now, force), least, creeps, dip)
