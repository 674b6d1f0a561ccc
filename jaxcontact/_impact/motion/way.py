"""A leg of an impact as a field: the motion to its turn, or from there to its end."""

from __future__ import annotations

import dataclasses

import equinox as eqx

from ..._forms import Flag
from ..._solver import Flags
from .motion import Motion, Number, State

# What is left of a force, by its tangent, where it has vanished. A power p of the time to the end
# leaves 1-p of it.
_JUMP = 0.9


class Way(eqx.Module):
    """The motion of bodies that are `compressing`, until they turn, or not, until they part."""

    motion: Motion
    compressing: Flag

    def rate(self, state: State) -> State:
        """d(w, u, t)/dτ."""
        return self.motion.rate(state, self.compressing)

    def guards(self, state: State) -> tuple[Number, ...]:
        """The speed of closing, or that of parting and what tells that the bodies have parted."""
        return self.motion.gaps(state, self.compressing)

    @property
    def one_way(self) -> bool:
        """Not so: strongly damped, the last step to a turn is no step of u (8e-6 of its time)."""
        return False

    @property
    def clamped(self) -> bool:
        """Whether the law may clamp its own force to zero."""
        return self.motion.may_clamp

    def continued(self, inside: State) -> Way:
        """The motion under a force that a clamp does not end, from a state `inside` the contact."""
        return dataclasses.replace(self, motion=self.motion.continued(inside))

    def jumps(self, inside: State, end: State, closed: Flags) -> Flag:
        """Whether the force of a way out jumps to zero inside of x = 0, instead of going there.

        It does so only where no other guard closed: not at a turn.
        """
        before, after = map(self.motion.gap_of_force, (inside, end))
        left = (after >= _JUMP * before) & (2 * end.w > inside.w)
        return ~self.compressing & ~closed[0] & closed[-1] & left
