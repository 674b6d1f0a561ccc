"""The results of a run, read from its log: status, states at given times, impacts and work."""

from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..._coupled.scalars import Index, Number
from ..._program import derived, quick
from ..result import Impacts, States, traced
from ..run_record import RunRecord
from .impact_table import table_of, taken_beside
from .states import (
    has_forces_at,
    states_as_numpy,
    states_at,
    states_in_log,
    states_in_log_as_numpy,
    states_of,
)
from .straddling import clip_to_run
from .wall_work import friction_at_rest, work_of


class RunContents(NamedTuple):
    """The contents of a `Run`; `total` is the number of impacts."""

    status: Index
    reached: Number
    now: States
    impacts: Impacts
    nearest: tuple[Array, Array]
    total: Index
    work: Number
    sliding_loss: Number | None


def read_run(
    record: RunRecord, times: Float[Array, " T"], rows: int | None, moves: bool
) -> RunContents:
    """Return the results, with the table of impacts padded to so many `rows`. With concrete numbers
    the table has no blank rows. Motion inside contacts is compiled only if one of the times needs
    it. `moves`: whether the times may have tangents.
    """
    reading = derived(_by_choice, record, times, rows, moves, decide=_from_log)
    if traced(reading.total):
        return reading
    total = int(reading.total)
    if not traced(reading.impacts):
        table = jax.tree.map(lambda x: np.asarray(x)[:total], reading.impacts)
        return reading._replace(impacts=jax.device_put(table))
    return reading._replace(impacts=_first(reading.impacts, total))


@eqx.filter_jit
def _first(impacts: Impacts, total: int) -> Impacts:
    return jax.tree.map(lambda column: column[:total], impacts)


def _from_log(
    record: RunRecord, times: Array, rows: int | None, moves: bool
) -> tuple[RunContents, tuple[bool, bool]]:
    """Return the results from Python, with two flags for `_by_choice`. They say whether a requested
    time, and whether an end of the run, is inside a contact.
    """
    count, length = times.shape[0], np.asarray(record.length)
    ends = np.stack([np.zeros_like(length), length])
    every, inside = states_in_log_as_numpy(record, np.concatenate([np.asarray(times), ends]))
    inside, cut = bool(np.any(inside[:count])), bool(np.any(inside[count:]))
    now = states_as_numpy(record, times) if inside else jax.tree.map(lambda x: x[:count], every)
    if cut:
        record = clip_to_run(record, jax.device_put(states_as_numpy(record, ends)))
    inside = inside or (moves and has_forces_at(record, times))
    return _without_states(record)._replace(now=jax.device_put(now)), (inside, cut)


def _by_choice(
    choice: tuple[bool, bool] | None,
    record: RunRecord,
    times: Array,
    rows: int | None,
    moves: bool,
) -> RunContents:
    """Return the results from one program with the parts chosen, or with all parts."""
    if choice is not None:
        inside, cut = choice
        now = states_of(record, times) if inside else states_in_log(record, times)[0]
        return _contents(
            clip_to_run(record, states_at(record, record.ends)) if cut else record, now, None
        )
    if not record.rules.soft:
        return _contents(record, states_at(record, times), rows)
    # One program for all times.
    every, count = states_at(record, jnp.concatenate([times, record.ends])), times.shape[0]
    now, there = (
        jax.tree.map(lambda x, k=k: x[k], every) for k in (slice(count), slice(count, None))
    )
    return _contents(clip_to_run(record, there), now, rows)


def _contents(record: RunRecord, now: Any, rows: int | None) -> RunContents:
    status, reached = record.ending()
    impacts, nearest, total = table_of(record, status, rows)
    work, sliding_loss = work_of(record, status, reached), None
    if record.layout.frictions is not None:
        carried, lost = friction_at_rest(record, reached)
        if record.calls is not None:
            lost = lost + taken_beside(record)
        work, sliding_loss = work + carried, lost + 0 * work
    return RunContents(status, reached, now, impacts, nearest, total, work, sliding_loss)


@quick
def _without_states(record: RunRecord) -> RunContents:
    """Return everything but the states."""
    return _contents(record, None, None)
