"""What a scene goes on from where it is the end of a run: what rests, and what is in contact."""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .cluster.equations import ClusterState


class Contacts(NamedTuple):
    """A coupled solve in progress at time zero, if it is `active`: the spheres `who` (M,) have its
    places, those that are `present`, `shift` (M, D) periods away; the rest is as in `Coupling`.
    """

    active: Bool[Array, ""]
    who: Int[Array, " M"]
    present: Bool[Array, " M"]
    shift: Float[Array, "M D"]
    pace: Float[Array, ""]
    reserve: Float[Array, ""]
    state: ClusterState


class Underway(NamedTuple):
    """The isolated impacts that are on at time zero: of every sphere the body that it meets,
    `partner`, or -1, and when they touched, `touch` < 0 in s; its `position` and `velocity` after
    what it met before that, at the `time` of that.
    """

    partner: Int[Array, " N"]
    touch: Float[Array, " N"]
    position: Float[Array, "N D"]
    velocity: Float[Array, "N D"]
    time: Float[Array, " N"]

    @property
    def counts(self) -> Bool[Array, " N"]:
        """Which spheres are in one."""
        return self.partner >= 0


class Start(eqx.Module):
    """Of every sphere the wall that it rests on, `support`, or -1, and the v0 `held` in m/s; the
    `contacts` in progress, and the isolated impacts that are `underway`. `soft`: whether impacts
    took time in the run that ended so.
    """

    support: Int[Array, " N"]
    held: Float[Array, " N"]
    contacts: Contacts | None
    underway: Underway | None
    soft: bool = eqx.field(static=True)

    @property
    def leans(self) -> bool:
        """Whether anything rests, or is in a coupled solve, of a start that is known."""
        active = self.contacts is not None and bool(self.contacts.active)
        return active or bool(np.any(np.asarray(self.support) >= 0))

    def as_needed(self) -> Start | None:
        """What places and velocities do not say; None where they say it all."""
        underway = self.underway
        if underway is not None and not np.any(np.asarray(underway.partner) >= 0):
            underway = None
        if underway is None and not self.leans:
            return None
        return Start(self.support, self.held, self.contacts, underway, self.soft)

    def without_contacts(self) -> Start:
        """The same where none goes on."""
        return Start(self.support, self.held, None, self.underway, self.soft)
