"""What a solve remembers of its way instead of all its states."""

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
    """The moment of the largest force so far, and those before and after it, packed.

    `fresh`: whether none has come after it yet.
    """

    force: Number
    before: Record
    at: Record
    after: Record
    fresh: Bool[Array, ""]

    def seen(self, last: Record, now: Record, force: Number) -> Nearest:
        """With the moment `now`, which followed on `last`."""
        larger = force > self.force
        return Nearest(
            force=jnp.where(larger, force, self.force),
            before=chosen(larger, last, self.before),
            at=chosen(larger, now, self.at),
            after=chosen(larger | self.fresh, now, self.after),
            fresh=larger,
        )


class Watch(NamedTuple):
    """The largest force and the least; whether the bodies creep to rest; a dip of the force.

    `least` is None where the contact cannot pull, and has -F as its force; `creeps` and `dip` are
    None where there is no push, or the force cannot vanish.
    """

    nearest: Nearest
    least: Nearest | None
    creeps: Bool[Array, ""] | None
    dip: Dip | None

    @staticmethod
    def begin(motion: Motion, packed: Packed[State]) -> Watch:
        """Nothing seen yet of a motion."""
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
        """With the accepted moment `now`, which followed on `last`."""
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
