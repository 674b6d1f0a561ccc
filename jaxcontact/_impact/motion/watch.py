"""The quantities recorded during a solve instead of all its states."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from ..._solver import Packed, Record, chosen
from .dip import Dip
from .motion import Motion, Number, State
from .way import Way


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
