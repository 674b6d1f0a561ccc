"""A leg of an impact as a field: the motion to its turn, or from there to its end."""

from __future__ import annotations

import dataclasses

import equinox as eqx

from .._forms import Flag
from ._motion import Motion, Number, State


class Way(eqx.Module):
    """The motion of bodies that are `compressing`, until they turn, or not, until they part.

    `searched`: whether the end is searched for in any case.
    """

    motion: Motion
    compressing: Flag
    searched: bool = eqx.field(static=True, default=False)

    def rate(self, state: State) -> State:
        """d(w, u, t)/dτ."""
        return self.motion.rate(state, self.compressing)

    def guards(self, state: State) -> tuple[Number, ...]:
        """The speed of closing, or that of parting and what tells that the bodies have parted."""
        return self.motion.gaps(state, self.compressing)

    @property
    def one_way(self) -> bool:
        """Of free impacts that follow a smooth momentum: u falls to 0, and then w."""
        return not self.searched and self.motion.one_way and self.motion.momentum is not None

    @property
    def clamped(self) -> bool:
        """Whether the law may clamp its own force to zero."""
        return self.motion.may_clamp

    def continued(self, inside: State) -> Way:
        """The motion under a force that a clamp does not end, from a state `inside` the contact."""
        return dataclasses.replace(self, motion=self.motion.continued(inside))
