"""What a run writes down: one row an impact, with the bodies before and after it."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..arrays.arrays import Layout
from ..arrays.flight import Flying
from ..cluster.equations import ClusterState
from ..pair_impact.instantaneous import Choice, Outcome
from .cluster_slots import Seats, places, unchanged
from .coupled import Call, as_numbers, blank_state


class Together(NamedTuple):
    """A call of the coupled solve: the spheres in it before, with the v0 `held` by those that rest;
    the state that it `began` from, and that at its `end`, with flags as numbers; the `work` of
    moving walls in J, and the `error` in m/s that was estimated.
    """

    spheres: Flying
    held: Float[Array, "K M"]
    began: ClusterState
    end: ClusterState
    work: Any
    error: Any


class Called(NamedTuple):
    """The decisions about a call: whether the row is one, what its spheres rested on before it, and
    what was `decided` beside the choice of the row; whether the bodies are apart after it, or at
    `rest`, or whether it was only `paused`.
    """

    is_call: Any
    support: Int[Array, "K M"]
    decided: Call
    ends: Any
    rest: Any
    paused: Any


class Figures(NamedTuple):
    """The numbers of the rows, which have derivatives."""

    before: Flying
    outcome: Outcome
    coupled: Together | None


class Facts(NamedTuple):
    """The decisions of the rows: what met, what each body rests on after it, how it was solved.

    `tied`: whether another impact competed with this one at the same time; `rival`, the time until
    the next event of either body would have been, or since its last one, in s.
    """

    choice: Choice
    support: Int[Array, "K 2"]
    tied: Any
    rival: Float[Array, " K"]
    call: Called | None


class Log(NamedTuple):
    """The rows of a run; those from `count` on are blank."""

    figures: Figures
    facts: Facts


class Known(NamedTuple):
    """What a search wrote down: its `log` with `written` rows; its `status` and its time, `now`, at
    its end; whether there is `more` to come, and whether the run was `valid`.
    """

    log: Log
    written: Int[Array, ""]
    status: Int[Array, ""]
    now: Float[Array, ""]
    more: Bool[Array, ""]
    valid: Bool[Array, ""]


def blank_log(rows: int, layout: Layout, dtype: Any, members: int) -> Log:
    """A log with room for so many rows, of calls of the coupled solve, too, unless that has room
    for no `members`.
    """
    dimensions = layout.dimensions
    vector = jnp.zeros((rows, 2, dimensions), dtype)
    pair, one = jnp.zeros((rows, 2), dtype), jnp.zeros(rows, dtype)
    flying = Flying(vector, vector, pair)

    def repeated(row: Any) -> Any:
        return jax.tree.map(lambda x: jnp.broadcast_to(x, (rows, *jnp.shape(x))), row)

    choice = repeated(blank_choice(layout, dtype))
    together = called = None
    if members:
        together, called = repeated(blank_calls(layout, members, dtype))
    facts = Facts(choice, jnp.zeros((rows, 2), int) - 1, jnp.zeros(rows, bool), one, called)
    outcome = Outcome(flying, *[one] * (len(Outcome._fields) - 1))
    return Log(Figures(flying, outcome, together), facts)


def blank_choice(layout: Layout, dtype: Any) -> Choice:
    """The choice of nobody."""
    zero, no = jnp.asarray(0), jnp.asarray(False)
    image, time = jnp.zeros(layout.dimensions, dtype), jnp.zeros((), dtype)
    return Choice(zero, zero, jnp.full(2, -1), image, time, no)


def blank_calls(layout: Layout, members: int, dtype: Any) -> tuple[Together, Called]:
    """One row without a call."""
    dimensions = layout.dimensions
    vector, each = jnp.zeros((members, dimensions), dtype), jnp.zeros(members, dtype)
    state, no = as_numbers(blank_state(layout, members, dtype)), jnp.asarray(False)
    none = jnp.zeros((), dtype)
    pairs = jnp.zeros(places(layout, members)[0].shape, bool)
    whole = jnp.zeros(members, int)
    seats, change = Seats(whole, whole > 0, vector), unchanged(layout, members)
    decided = Call(no, None, seats, change, pairs, none, no)
    together = Together(Flying(vector, vector, each), each, state, state, none, none)
    return together, Called(no, whole - 1, decided, no, no, no)


def last_call(
    log: Log, written: Int[Array, ""], times: Float[Array, " T"]
) -> tuple[Int[Array, " T"], Bool[Array, " T"]]:
    """The last call that began before each time, and whether there is one."""
    called, together = log.facts.call, log.figures.coupled
    assert called is not None and together is not None
    number = jnp.arange(called.is_call.shape[0])
    is_call = called.is_call & (number < written)
    began = jnp.where(is_call, together.began.time, jnp.inf)
    # What a run began in is there from the first moment, after impacts that were on before.
    at_once = is_call & (number == jnp.argmax(is_call)) & ~called.decided.starts
    earlier = (began[None] < times[:, None]) | (at_once & (began == 0))[None]
    # Of calls that began at the same time, the last one.
    row = jnp.max(jnp.where(earlier, number[None], -1), axis=1)
    return jnp.maximum(row, 0), row >= 0
