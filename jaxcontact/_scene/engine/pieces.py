"""The search of a run, as one program, or from Python, piece by piece."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..._program import quick
from ..._text.progress import Tell
from ..arrays.arrays import Layout, Numbers
from ..contact_times.cells import Grid
from ..contact_times.grid import grid_of
from ..derivative.followed import Given
from .cluster_slots import everyone
from .event_queue import expecting
from .log import Known, Log, blank_log
from .loop import advance, begun, goes_on, with_places
from .next_event import flown
from .state import CROWDED, RUNNING, Rules, State

_MOST_GROWN = 32
"""Places to which a coupled solve grows by itself."""

_PIECE = 256
"""Impacts between two looks of Python at a run."""

_PATIENCE = 2048
"""Impacts that run in a program that was compiled quickly, over one and the places of a coupled
solve. Not a time: the two programs round differently, and a script shall repeat its numbers."""

_RUN: dict[Any, int] = {}
"""How many impacts of a kind have run in a program that was compiled quickly."""


@eqx.filter_jit
def all_at_once(rules: Rules, given: Given, grid: Grid | None, room: int) -> Known:
    """The whole run as one program with room for so many impacts.

    Where a cell is full the run goes on without cells.
    """
    layout, numbers, valid, end, tolerance = given
    numbers, end = jax.tree.map(
        lambda x: jax.lax.stop_gradient(x) if eqx.is_inexact_array(x) else x, (numbers, end)
    )
    last = jnp.where(valid, end, -1)
    state = begun(layout, numbers, rules, grid)
    log = blank_log(room, layout, numbers.dtype, rules.members)
    state, log, written = advance(layout, numbers, rules, state, log, last, tolerance)
    if state.cells is not None:
        full = state.cells.full & valid
        now = jnp.maximum(jnp.min(state.events.time), state.now)
        state = expecting(layout, numbers, state, now, None, full)
        state, log, written = advance(layout, numbers, rules, state, log, last, tolerance, written)
    more = goes_on(state, last)
    return Known(log, written, state.status, state.now, more, valid)


def from_python(
    rules: Rules, given: Given, start: State | None, most: int | None, tell: Tell, grows: bool
) -> tuple[Rules, Known]:
    """The run from its `start`, of at `most` so many rows, and the rules that it ended with: with
    more places in coupled solves where it `grows`.
    """
    layout, numbers = given[:2]
    state = _begun(layout, numbers, rules) if start is None else start
    ended, known = _piece_by_piece(rules, given, state, most, tell)
    room = min(_MOST_GROWN, layout.spheres)
    while grows and int(known.status) == CROWDED and ended.members < room:
        more = Rules(rules.soft, rules.v0, min(2 * ended.members, layout.spheres))
        ended, known = _piece_by_piece(more, given, state, most, tell)
    return ended, known


def _piece_by_piece(
    wanted: Rules, given: Given, state: State, most: int | None, tell: Tell
) -> tuple[Rules, Known]:
    """The run: one program goes on until all impacts are there.

    Among many spheres or in a periodic space most scenes need no coupled solve: there the program
    is one without, until one is needed.
    """
    layout, numbers, valid, end, tolerance = given
    rules = wanted
    within = numbers.start is not None and numbers.start.leans
    if not everyone(layout, rules.members) and not within:
        rules = Rules(rules.soft, rules.v0, 0)
    places = 0 if state.coupling is None else state.coupling.seats.who.shape[0]
    if not rules.members:
        state = state._replace(coupling=None)
    elif places != rules.members:
        state = _with_places(layout, numbers, rules.members, state)
    grid = None if rules.soft else grid_of(layout, numbers)
    if grid is not None:
        state = _expecting(layout, numbers, state, state.now, grid)
    pieces: list[tuple[Log, int]] = []
    total, more, crowded_at = 0, True, -1.0
    while more and int(state.status) == RUNNING and (most is None or total < most):
        if state.cells is not None and bool(state.cells.full):
            state, crowded_at = _with_room(layout, numbers, state, crowded_at)
        state, log, written, ahead = _piece(layout, numbers, rules, state, valid, end, tolerance)
        count = int(written) if most is None else min(int(written), most - total)
        more = bool(ahead) or count < int(written)
        pieces.append((log, count))
        total += count
        tell(total, None, f"t = {float(state.now):.4g} s")
        if int(state.status) == CROWDED and rules.members < wanted.members:
            rules = wanted
            state = _with_places(layout, numbers, rules.members, state)
    log = pieces[0][0] if len(pieces) == 1 else _one_log(layout, numbers, rules, pieces)
    written, ahead = jax.device_put((np.asarray(total), np.asarray(more)))
    return rules, Known(log, written, state.status, state.now, ahead, valid)


def _piece(
    layout: Layout, numbers: Numbers, rules: Rules, state: State, *given: Array
) -> tuple[State, Log, Array, Array]:
    """A piece of a run: by the program that is compiled in a fraction of the time, until pieces of
    its kind have run so long that a faster one is worth its compilation.
    """
    kind = jax.tree.structure((layout, numbers, rules, state)), numbers.dtype
    done = _RUN.get(kind, 0)
    if done * (1 + rules.members) > _PATIENCE:
        return _swiftly(layout, numbers, rules, state, *given)
    piece = _quickly(layout, numbers, rules, state, *given)
    _RUN[kind] = done + int(piece[2])
    return piece


def _onward(
    layout: Layout,
    numbers: Numbers,
    rules: Rules,
    state: State,
    valid: Array,
    end: Array,
    tolerance: Array,
) -> tuple[State, Log, Array, Array]:
    """A piece with its own log; how many rows that has, and whether there is more to come."""
    end = jnp.where(valid, end, -1)
    log = blank_log(_PIECE, layout, numbers.dtype, rules.members)
    state, log, written = advance(layout, numbers, rules, state, log, end, tolerance)
    return state, log, written, goes_on(state, end)


_quickly, _swiftly = quick(_onward), eqx.filter_jit(_onward)
_begun = quick(begun)
_expecting = quick(expecting)
_with_places = quick(with_places)
_blank = quick(blank_log)


def _with_room(
    layout: Layout, numbers: Numbers, state: State, before: float
) -> tuple[State, float]:
    """The run with other cells where one is full, and when that was; without cells where they were
    full at the same time `before`, so that they are no use.
    """
    assert state.cells is not None
    now, position = _here(layout, numbers, state)
    useful = float(now) > before
    grid = grid_of(layout, numbers, position, state.cells.grid) if useful else None
    return _expecting(layout, numbers, state, now, grid), float(now)


@quick
def _here(layout: Layout, numbers: Numbers, state: State) -> tuple[Array, Array]:
    """When the next event is, and where all spheres are then."""
    now = jnp.maximum(jnp.min(state.events.time), state.now)
    return now, flown(layout, numbers, state, None, now)[0]


def _one_log(
    layout: Layout, numbers: Numbers, rules: Rules, pieces: Sequence[tuple[Log, int]]
) -> Log:
    """The log of several pieces, with blank rows at its end.

    Pieces from before there was a coupled solve get blank rows for calls.
    """
    total = sum(count for _, count in pieces)
    # Rows of lengths that are powers of two share the programs that read them.
    room = 1 << max(total - 1, 0).bit_length()
    blank = _blank(1, layout, numbers.dtype, rules.members)

    def repeated(tree: Any, rows: int) -> Any:
        return jax.tree.map(lambda x: np.repeat(np.asarray(x), rows, axis=0), tree)

    def cut(log: Log, rows: int) -> Log:
        figures, facts = jax.tree.map(lambda x: np.asarray(x)[:rows], log)
        if facts.call is None:
            together, called = repeated((blank.figures.coupled, blank.facts.call), rows)
            figures, facts = figures._replace(coupled=together), facts._replace(call=called)
        return Log(figures, facts)

    parts = [*(cut(*piece) for piece in pieces), repeated(blank, room - total)]
    return jax.device_put(jax.tree.map(lambda *x: np.concatenate(x), *parts))
