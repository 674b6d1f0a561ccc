"""Where a run is: the spheres, the event that each expects, and the coupled solve if any."""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
from jaxtyping import Array, Bool, Float, Int

from ._cells import Cells
from ._hit import Choice
from ._touching import ClusterState


class Rules(eqx.Module):
    """What is static of a run: whether impacts take time, what v0 is, and whether there is room for
    a coupled solve.
    """

    soft: bool = eqx.field(static=True)
    v0: str | float = eqx.field(static=True)
    coupled: bool = eqx.field(static=True)


class Coupling(NamedTuple):
    """The coupled solve in progress: whether it is `active`, whether it `starts` with the touch of
    `choice`, who is in it, and its state.
    """

    active: Bool[Array, ""]
    starts: Bool[Array, ""]
    choice: Choice
    members: Bool[Array, " N"]
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
