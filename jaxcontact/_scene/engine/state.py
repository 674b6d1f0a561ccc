"""The state of a run: the spheres, their next events, and the coupled solve if any."""

from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..._coupled.modes import Flag, Index, Number
from ..._coupled.rows import with_one_or_two, with_rows
from ..arrays.arrays import Flying, SceneArrays, SceneLayout
from ..arrays.movers import Turning
from ..cluster.problem import ClusterState
from ..contact_times.cells import Cells
from ..pair_impact.instantaneous import Choice

PATIENCE = 64
"""The number of impacts for each body without progress in time after which a run stops."""


class LoopStatus:
    """The status of an event loop. OVER: bodies are in contact at the end. FRICTION: it acts where
    no formula is known.
    """

    RUNNING, ACCUMULATED, TWO_SUPPORTS, CROWDED, NOT_CONVERGED, OVER, FRICTION = range(7)


class Rules(eqx.Module):
    """The static rules of a run. `soft`: whether impacts take time. `v0` is its rule, and `slots`
    the number of spheres for which a coupled solve has slots, 0 without one.
    """

    soft: bool = eqx.field(static=True)
    v0: str | float = eqx.field(static=True)
    slots: int = eqx.field(static=True)


class RunTask(eqx.Module):
    """A scene and the rules of its run, its `end` in s, and the `tolerance` of its solves."""

    model: SceneArrays
    rules: Rules
    end: Number
    tolerance: Number


class Slots(NamedTuple):
    """The assignment of slots. `who` (M,) holds the spheres, of which those `present` are in the
    solve. `shift` (M, D) is the number of periods between each sphere and its solved image.
    """

    who: Int[Array, " M"]
    present: Bool[Array, " M"]
    shift: Float[Array, "M D"]

    @property
    def size(self) -> int:
        """The number M of slots, which may be the last axis of several."""
        return self.who.shape[-1]


def index_of(layout: SceneLayout, slots: Slots) -> Int[Array, " M"]:
    """Return the sphere in each slot, or a unique number from N on for empty slots. Each number
    occurs once, so that it can index a write.
    """
    return jnp.where(slots.present, slots.who, layout.spheres + jnp.arange(slots.size))


class Coupling(NamedTuple):
    """The coupled solve in progress.

    `active`: whether there is one. `starts`: whether it is about to start. `touches`: whether the
    pair of `choice` touches now. `slots` and `state` are its spheres and their state. `pace` in s
    is a part of the duration of its first contact. `reserve` in J is a bound on the energy stored
    in contacts.
    """

    active: Flag
    starts: Flag
    touches: Flag
    choice: Choice
    slots: Slots
    pace: Number
    reserve: Number
    state: ClusterState


class Events(NamedTuple):
    """The stored events, (N,) each. `partner` is negative if the event is only a search. `count` is
    the partner's number of impacts when it was found, and `speed` the closing speed. `second` is
    the time of the second best impact, or of the best one if the event is only a search.
    """

    time: Float[Array, " N"]
    partner: Int[Array, " N"]
    count: Int[Array, " N"]
    speed: Float[Array, " N"]
    second: Float[Array, " N"]


class RunState(NamedTuple):
    """The spheres, each at its own time, their events, and their cells, if any. `turning` is None
    without friction.
    """

    position: Float[Array, "N D"]
    velocity: Float[Array, "N D"]
    time: Float[Array, " N"]
    support: Int[Array, " N"]
    count: Int[Array, " N"]
    events: Events
    now: Number
    idle: Index
    status: Index
    held: Float[Array, " N"]
    owed: Float[Array, " N"]
    coupling: Coupling | None
    cells: Cells | None
    turning: Turning | None = None

    @property
    def flying(self) -> Flying:
        """The spheres, each at its own time."""
        return Flying(self.position, self.velocity, self.time, self.turning)

    def replace_rows(self, rows: Int[Array, " M"], **columns: Any) -> RunState:
        """Return the state with some rows of its columns replaced, as by `with_rows`."""
        old = {name: getattr(self, name) for name in columns}
        # The loop of coupled contacts is too large to be compiled as one function.
        write = with_one_or_two if self.coupling is None else with_rows
        return self._replace(**write(old, rows, columns))
