"""Where a run is: the spheres, the event that each expects, and the coupled solve if any."""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
from jaxtyping import Array, Bool, Float, Int

from ..cluster.equations import ClusterState
from ..contact_times.cells import Cells
from ..pair_impact.instantaneous import Choice
from .cluster_slots import Seats

PATIENCE = 64
"""Impacts per body without progress in time after which a run stops."""

RUNNING, ACCUMULATED, TWO_SUPPORTS, CROWDED, NOT_CONVERGED, OVER = range(6)
"""Why a search goes on or stops; OVER: bodies are in contact at the end."""


class Rules(eqx.Module):
    """What is static of a run: whether impacts take time, what v0 is, and for how many spheres a
    coupled solve has room: 0 where there is none.
    """

    soft: bool = eqx.field(static=True)
    v0: str | float = eqx.field(static=True)
    members: int = eqx.field(static=True)


class Coupling(NamedTuple):
    """The coupled solve in progress: whether it is `active`, whether it `starts`, and whether the
    pair of `choice` `touches` now; who is in it, and its state.

    `pace` in s: a part of the duration of its first contact; `reserve` in J, a bound of the energy
    that is stored in contacts.
    """

    active: Bool[Array, ""]
    starts: Bool[Array, ""]
    touches: Bool[Array, ""]
    choice: Choice
    seats: Seats
    pace: Float[Array, ""]
    reserve: Float[Array, ""]
    state: ClusterState


class Events(NamedTuple):
    """The stored events, (N,) each: `time`, `partner` (negative: only search again), the partner's
    count of impacts then, the closing `speed`, and the time of the `second` best impact (of the
    best, where the event is none).
    """

    time: Float[Array, " N"]
    partner: Int[Array, " N"]
    count: Int[Array, " N"]
    speed: Float[Array, " N"]
    second: Float[Array, " N"]


class State(NamedTuple):
    """The spheres, each at its own time, their events, and the cells they are in, if any."""

    position: Float[Array, "N D"]
    velocity: Float[Array, "N D"]
    time: Float[Array, " N"]
    support: Int[Array, " N"]
    count: Int[Array, " N"]
    events: Events
    now: Float[Array, ""]
    idle: Int[Array, ""]
    status: Int[Array, ""]
    held: Float[Array, " N"]
    owed: Float[Array, " N"]
    coupling: Coupling | None
    cells: Cells | None
