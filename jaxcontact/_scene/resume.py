"""The state from which a scene continues a finished run: resting spheres and contacts."""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .._coupled.modes import Flag, Number
from .arrays.movers import Turning
from .cluster.problem import ClusterState


class Contacts(NamedTuple):
    """A coupled solve in progress at time zero, if `active`. Its slots hold the spheres `who`
    (M,), of which those `present` count. They are shifted by `shift` (M, D) periods. The other
    fields are as in `Coupling`.
    """

    active: Flag
    who: Int[Array, " M"]
    present: Bool[Array, " M"]
    shift: Float[Array, "M D"]
    pace: Number
    reserve: Number
    state: ClusterState


class Underway(NamedTuple):
    """The isolated impacts in progress at time zero. `partner` is the other body of each sphere's
    impact, or -1. `touch` < 0 is the time of touch in s. `position` and `velocity` are the values
    after the sphere's previous event, at `time`. `turning` is None without friction.
    """

    partner: Int[Array, " N"]
    touch: Float[Array, " N"]
    position: Float[Array, "N D"]
    velocity: Float[Array, "N D"]
    time: Float[Array, " N"]
    turning: Turning | None = None

    @property
    def counts(self) -> Bool[Array, " N"]:
        """A mask of the spheres in such an impact."""
        return self.partner >= 0


class Start(eqx.Module):
    """The start state of a scene that continues a run. `support` is the wall on which each sphere
    rests, or -1, and `held` its v0 in m/s. `contacts` is the coupled solve in progress, and
    `underway` holds the isolated impacts. `soft` is True if impacts took time in the previous run.
    """

    support: Int[Array, " N"]
    held: Float[Array, " N"]
    contacts: Contacts | None
    underway: Underway | None
    soft: bool = eqx.field(static=True)

    @property
    def leans(self) -> bool:
        """True if a sphere rests or a coupled solve is active; needs concrete values."""
        active = self.contacts is not None and bool(self.contacts.active)
        return active or bool(np.any(np.asarray(self.support) >= 0))

    def as_needed(self) -> Start | None:
        """Return the part of the start state that positions and velocities do not determine.
        Returns None if there is none.
        """
        underway = self.underway
        if underway is not None and not np.any(np.asarray(underway.partner) >= 0):
            underway = None
        if underway is None and not self.leans:
            return None
        return Start(self.support, self.held, self.contacts, underway, self.soft)
