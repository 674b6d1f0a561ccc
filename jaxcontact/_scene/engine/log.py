"""The log of a run: one row for each impact, with the bodies before and after it; and the record of
the finished run, from which all results are read.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..._coupled.modes import Flag, Index, Number
from ..._functions import spin_axes
from ..arrays.arrays import Flying, SceneArrays
from ..arrays.movers import Turning
from ..cluster.problem import ClusterState
from ..pair_impact.friction import SlipSpeeds
from ..pair_impact.instantaneous import Choice, ImpactOutcome
from ..result import Ending
from .coupled_friction import blank_rubbing
from .slots import SlotChange, most_pairs, no_change, slot_pairs
from .state import LoopStatus, Rules, Slots


class Call(NamedTuple):
    """The discrete choices about one call.

    It `starts` a solve at the touch of `choice`, or continues one. `slots` holds its spheres, and
    `change` the new ones. `closed` (P,) marks the new pairs that are in contact at once. The call
    ends at the time `until` in s, if no event happens before. `to_the_end`: whether it continues at
    rest. `near` (P,) marks the pairs that it follows, None if all. In a log the choice is that of
    the row.
    """

    starts: Flag
    choice: Choice | None
    slots: Slots
    change: SlotChange
    closed: Bool[Array, " P"]
    until: Number
    to_the_end: Flag
    near: Bool[Array, " P"] | None

    def where(self, needed: Flag) -> Call:
        """Return the call, with empty slots unless `needed`; other lanes may need one."""
        slots = self.slots._replace(present=self.slots.present & needed)
        return self._replace(slots=slots)


class ClusterNumbers(NamedTuple):
    """The numbers of a call of the coupled solve. `spheres` are those in its slots, with the v0
    `held` by those at rest before it. `began` and `end` are its first and last states, with flags
    as numbers. `work` is that of moving walls in J, and `error` the estimated error in m/s. With
    friction, `turning` is the rotation of these after it, and `rubbed` the energy taken in J.
    """

    spheres: Flying
    held: Float[Array, "K M"]
    began: ClusterState
    end: ClusterState
    work: Any
    error: Any
    turning: Turning | None = None
    rubbed: Any = None


class ClusterDecisions(NamedTuple):
    """The discrete choices of a call.

    `is_call`: whether the row is a call. `support` holds the walls on which its spheres rested
    before it. `decided` holds the choices beside that of the row. After the call, `ends`: the
    bodies are apart or at rest; `rest`: they are at rest; `paused`: it stopped at its step limit.
    """

    is_call: Any
    support: Int[Array, "K M"]
    decided: Call
    ends: Any
    rest: Any
    paused: Any


class LogNumbers(NamedTuple):
    """The numbers of the rows, which have derivatives."""

    before: Flying
    outcome: ImpactOutcome
    coupled: ClusterNumbers | None


class LogDecisions(NamedTuple):
    """The discrete choices of the rows: the bodies, their supports afterwards, and the call.
    `tied`: whether another impact competed with this one at the same time. `rival` in s is the time
    to the next competing event of either body, or since its last event.
    """

    choice: Choice
    support: Int[Array, "K 2"]
    tied: Any
    rival: Float[Array, " K"]
    call: ClusterDecisions | None


class Log(NamedTuple):
    """The rows of a run; unwritten ones are blank."""

    figures: LogNumbers
    facts: LogDecisions


class LoopOutcome(NamedTuple):
    """The outcome of an event loop: its `log` with `written` rows. `status` and `now` are those at
    its end. `more`: whether events are left. `valid`: whether the scene was valid.
    """

    log: Log
    written: Index
    status: Index
    now: Number
    more: Flag
    valid: Flag


def blank_log(rows: int, model: SceneArrays, size: int) -> Log:
    """Return a blank log with some rows, also of calls if these have slots."""
    each = jnp.zeros(rows, model.dtype)

    def repeat(row: Any) -> Any:
        return jax.tree.map(lambda x: jnp.broadcast_to(x, (rows, *jnp.shape(x))), row)

    choice = repeat(blank_choice(model))
    together = called = None
    if size:
        together, called = repeat(blank_calls(model, size))
    facts = LogDecisions(choice, jnp.zeros((rows, 2), int) - 1, jnp.zeros(rows, bool), each, called)
    outcome = repeat(no_impact(model))
    return Log(LogNumbers(outcome.after, outcome, together), facts)


def no_impact(model: SceneArrays) -> ImpactOutcome:
    """Return a placeholder outcome of zeros."""
    dtype, dimensions = model.dtype, model.dimensions
    vector, zero = jnp.zeros((2, dimensions), dtype), jnp.zeros((), dtype)
    turning = sliding = None
    if model.frictions is not None:
        spin, sliding = jnp.zeros((2, spin_axes(dimensions)), dtype), SlipSpeeds(zero, zero)
        turning = Turning(spin, vector, spin, vector[:, 0])
    columns: dict[str, Any] = dict.fromkeys(ImpactOutcome._fields, zero)
    columns |= {"after": Flying(vector, vector, vector[:, 0], turning), "sliding": sliding}
    return ImpactOutcome(**columns)


def blank_choice(model: SceneArrays) -> Choice:
    """Return a placeholder choice."""
    zero, no = jnp.zeros((), int), jnp.asarray(False)
    image, time = jnp.zeros(model.dimensions, model.dtype), jnp.zeros((), model.dtype)
    return Choice(zero, zero, jnp.full(2, -1, int), image, time, no)


def as_numbers(state: ClusterState) -> ClusterState:
    """Return the state with its flags as 0 and 1, for a log whose figures have derivatives."""
    dtype = state.position.dtype
    return state._replace(closed=state.closed.astype(dtype), rising=state.rising.astype(dtype))


def as_flags(state: ClusterState) -> ClusterState:
    """Return the inverse of `as_numbers`."""
    return state._replace(closed=state.closed > 0.5, rising=state.rising > 0.5)


def blank_state(model: SceneArrays, size: int) -> ClusterState:
    """Return a state of zeros, with all pairs open."""
    total, pairs = size + model.walls, slot_pairs(model, size)[0].shape[0]
    sizes = (), (total, model.dimensions), pairs
    zero, vector, each = (jnp.zeros(size, model.dtype) for size in sizes)
    flags = jnp.zeros(pairs, bool)
    rubbing = blank_rubbing(model, total, pairs)
    return ClusterState(
        zero, vector, vector, each, flags, flags, each, each, each, each, each, each, rubbing,
        each if model.remembers else None,
    )  # fmt: skip


def blank_calls(model: SceneArrays, size: int) -> tuple[ClusterNumbers, ClusterDecisions]:
    """Return one row without a call."""
    dimensions, dtype = model.dimensions, model.dtype
    vector, each = jnp.zeros((size, dimensions), dtype), jnp.zeros(size, dtype)
    state, no = as_numbers(blank_state(model, size)), jnp.asarray(False)
    none = jnp.zeros((), dtype)
    pairs = jnp.zeros(slot_pairs(model, size)[0].shape, bool)
    integers = jnp.zeros(size, int)
    nobody = jnp.full(size, model.spheres, int)
    slots, change = Slots(nobody, integers > 0, vector), no_change(model, size)
    near = None if most_pairs(model, size) is None else pairs
    decided = Call(no, None, slots, change, pairs, none, no, near)
    turning = rubbed = None
    if model.frictions is not None:
        spin = jnp.zeros((size, spin_axes(dimensions)), dtype)
        turning, rubbed = Turning(spin, vector, spin, each), none
    spheres = Flying(vector, vector, each, turning)
    together = ClusterNumbers(spheres, each, state, state, none, none, turning, rubbed)
    return together, ClusterDecisions(no, integers - 1, decided, no, no, no)


def last_call(
    log: Log, written: Index, times: Float[Array, " T"]
) -> tuple[Int[Array, " T"], Bool[Array, " T"]]:
    """Return the last call that began before each time, and whether there is one."""
    called, together = log.facts.call, log.figures.coupled
    assert called is not None and together is not None
    number = jnp.arange(called.is_call.shape[0])
    is_call = called.is_call & (number < written)
    began = jnp.where(is_call, together.began.time, jnp.inf)
    # A contact in which the run began is active from the first moment, after impacts begun earlier.
    at_once = is_call & (number == jnp.argmax(is_call)) & ~called.decided.starts
    earlier = (began[None] < times[:, None]) | (at_once & (began == 0))[None]
    # Of calls that began at the same time, the last one.
    row = jnp.max(jnp.where(earlier, number[None], -1), axis=1)
    return jnp.maximum(row, 0), row >= 0


class RunRecord(eqx.Module):
    """The scene, the rules and the `tolerance` of a run, and its `outcome`. The run ended at
    `last`; its requested duration is `length`.
    """

    model: SceneArrays
    rules: Rules
    tolerance: Number
    outcome: LoopOutcome
    last: Number
    length: Number

    @property
    def log(self) -> Log:
        """The log of the run."""
        return self.outcome.log

    @property
    def counts(self) -> Bool[Array, " K"]:
        """A mask of the log rows that are written."""
        return jnp.arange(self.log.facts.tied.shape[0]) < self.outcome.written

    @property
    def calls(self) -> Bool[Array, " K"] | None:
        """A mask of the rows that are calls of the coupled solve; None if there are none."""
        call = self.log.facts.call
        return None if call is None else call.is_call & self.counts

    @property
    def ends(self) -> Float[Array, "2"]:
        """The start and end times of the run."""
        return jnp.stack([jnp.zeros_like(self.length), self.length])

    def ending(self) -> tuple[Index, Number]:
        """Return the `Ending` of the run and the time up to which its values hold."""
        # A run may end while bodies are in contact.
        searched, valid = self.outcome.status, self.outcome.valid
        stuck = (searched != LoopStatus.RUNNING) & (searched != LoopStatus.OVER)
        more = self.outcome.more & (searched != LoopStatus.OVER)
        status = jnp.where(stuck, int(Ending.ACCUMULATED), int(Ending.COMPLETED))
        crowded = (searched == LoopStatus.CROWDED) | (searched == LoopStatus.TWO_SUPPORTS)
        status = jnp.where(crowded, int(Ending.CROWDED), status)
        status = jnp.where(searched == LoopStatus.NOT_CONVERGED, int(Ending.NOT_CONVERGED), status)
        if self.model.frictions is not None:
            status = jnp.where(
                searched == LoopStatus.FRICTION, int(Ending.FRICTION_NOT_MODELLED), status
            )
        status = jnp.where(~stuck & more, int(Ending.TOO_MANY_IMPACTS), status)
        status = jnp.where(valid, status, int(Ending.INVALID_INPUT))
        reached = jnp.where(stuck, self.outcome.now, jnp.where(more | ~valid, -1, self.last))
        abrupt = (self.last < self.length) & (status == int(Ending.COMPLETED))
        status = jnp.where(abrupt, int(Ending.WALL_TOO_ABRUPT), status)
        return status, jax.lax.stop_gradient(reached)
