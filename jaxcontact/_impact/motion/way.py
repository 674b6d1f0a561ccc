"""A leg of an impact as a field: the motion to its turn, or from there to its end."""

from __future__ import annotations

import dataclasses

import equinox as eqx

from ..._forms import Flag
from ..._solver import Flags
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
