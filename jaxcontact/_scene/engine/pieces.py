"""The event loop as one program, or from Python in pieces."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..._program import quick, swift_options
from ..._solver.chunks import in_chunks
from ..._text.progress import TellRun
from ..arrays.arrays import SceneArrays
from ..contact_times.cells import CellGrid, grid_of
from ..derivative.differentiable_run import RunInputs
from ..pair_impact.friction import is_followed
from .coupled import MOST
from .log import Log, LoopOutcome, blank_log
from .loop import advance, has_events_left, initial_state, with_empty_slots
from .search import flight_at, reset_events
from .slots import all_fit, in_more_slots, keeps_energy, most_pairs, slot_pairs
from .state import LoopStatus, Rules, RunState, RunTask

_MOST_GROWN = 40
"""The largest number of slots to which a coupled solve grows automatically."""

_DIRECT = 16
"""The number of spheres up to which all have slots at once without gravity."""

_PIECE = 256
"""The number of impacts between two returns to Python."""

_PATIENCE = 131_072
"""The number of impacts, times one plus 12 for each pair that is followed, for which the faster
program is compiled. Measured: it saves its compilation after some 100,000 impacts, or 300 calls
with 34 pairs. It is no time: the programs round differently, and scripts reproduce their numbers.
"""

_RUN: dict[Any, float] = {}
"""The number of impacts of each kind in a quickly compiled program; infinite after the faster."""


@eqx.filter_jit
def all_at_once(rules: Rules, inputs: RunInputs, grid: CellGrid | None, room: int) -> LoopOutcome:
    """Run the whole event loop as one program with room for so many impacts. If a cell is full, the
    run continues without cells.
    """
    model, valid, end, tolerance = inputs
    model, end = jax.tree.map(
        lambda x: jax.lax.stop_gradient(x) if eqx.is_inexact_array(x) else x, (model, end)
    )
    given = (model, valid, end, tolerance), grid
    arrays, static = eqx.partition(given, eqx.is_array)
    leaves, structure = jax.tree.flatten(arrays)

    def run(*leaves: Array) -> LoopOutcome:
        inputs, grid = eqx.combine(jax.tree.unflatten(structure, leaves), static)
        return _whole_loop(rules, inputs, grid, room)

    # Two scenes side by side take longer than one after the other: both branches are computed.
    return in_chunks(run, 1)(*leaves)


def _whole_loop(rules: Rules, inputs: RunInputs, grid: CellGrid | None, room: int) -> LoopOutcome:
    model, valid, end, tolerance = inputs
    last = jnp.where(valid, end, -1)
    state = initial_state(model, rules, grid)
    task = RunTask(model, rules, last, tolerance)
    log = blank_log(room, model, rules.slots)
    state, log, written = advance(task, state, log)
    if state.cells is not None:
        full = state.cells.full & valid
        now = jnp.maximum(jnp.min(state.events.time), state.now)
        state = reset_events(model, state, now, None, full)
        state, log, written = advance(task, state, log, written)
    more = has_events_left(state, last)
    return LoopOutcome(log, written, state.status, state.now, more, valid)


def from_python(
    rules: Rules,
    inputs: RunInputs,
    start: RunState | None,
    most: int | None,
    tell: TellRun,
    grows: bool,
) -> tuple[Rules, LoopOutcome]:
    """Run one program repeatedly until all impacts are found; return the final rules and the
    outcome. It writes at `most` so many rows. If it `grows`, a piece that needs more slots in a
    coupled solve is run again with more.
    """
    model, valid, end, tolerance = inputs
    state = _begun(model, rules) if start is None else start
    if grows and rules.slots and all_fit(model, min(_direct(model), model.spheres)):
        rules = Rules(rules.soft, rules.v0, model.spheres)
    wanted, most_slots = rules, min(_MOST_GROWN, model.spheres) if grows else 0
    rules, model = _first_rules(model, rules), _resumed(model, rules)
    slots = 0 if state.coupling is None else state.coupling.slots.size
    if not rules.slots:
        state = state._replace(coupling=None)
    elif slots != rules.slots:
        state = _with_slots(model, rules.slots, state)
    grid = None if rules.soft else grid_of(model)
    if grid is not None:
        state = _expecting(model, state, state.now, grid)
    pieces: list[tuple[Log, int]] = []
    total, more, crowded_at = 0, True, -1.0
    while more and int(state.status) == LoopStatus.RUNNING and (most is None or total < most):
        if state.cells is not None and bool(state.cells.full):
            state, crowded_at = _with_room(model, state, crowded_at)
        before = state
        inputs_now = (model, rules, state, valid, end, tolerance)
        state, log, written, ahead = _piece(tell, total, *inputs_now)
        if int(state.status) == LoopStatus.CROWDED and 0 < rules.slots < most_slots:
            wider = min(2 * rules.slots, most_slots)
            # A sphere keeps its slot, so that as many slots as spheres are one more.
            sizes = rules.slots, wider + all_fit(model, wider)
            rules = Rules(rules.soft, rules.v0, sizes[1])
            blank = _with_slots(model, rules.slots, before)
            coupling = in_more_slots(model, before.coupling, blank.coupling, sizes)
            state = blank._replace(coupling=jax.device_put(coupling))
            continue
        count = int(written) if most is None else min(int(written), most - total)
        more = bool(ahead) or count < int(written)
        pieces.append((log, count))
        total += count
        tell(total, "impacts", float(state.now), float(end))
        if int(state.status) == LoopStatus.CROWDED and rules.slots < wanted.slots:
            rules, state = wanted, _with_slots(model, wanted.slots, state)
    tell.says("reading the results")
    log = pieces[0][0] if len(pieces) == 1 else _one_log(model, rules, pieces)
    written, ahead = jax.device_put((np.asarray(total), np.asarray(more)))
    return rules, LoopOutcome(log, written, state.status, state.now, ahead, valid)


def _direct(model: SceneArrays) -> int:
    """Return the number of spheres up to which all have slots; under gravity they gather."""
    return _MOST_GROWN if model.has_gravity and keeps_energy(model) else _DIRECT


def _first_rules(model: SceneArrays, rules: Rules) -> Rules:
    """Return the rules without a coupled solve, unless it runs or most such scenes need it."""
    followed, many = is_followed(model), not all_fit(model, rules.slots)
    pressed = model.has_gravity and (rules.v0 != "touch" if followed else any(model.fixed))
    rubs = model.frictions is not None and not (pressed or (followed and model.spheres > 1))
    leans = model.start is not None and model.start.leans
    return rules if leans or not (many or rubs) else Rules(rules.soft, rules.v0, 0)


def _resumed(model: SceneArrays, rules: Rules) -> SceneArrays:
    """Return the model less a start that the state holds."""
    start = model.start
    if start is None or start.underway is not None or not (rules.soft or model.settles):
        return model
    return eqx.tree_at(lambda model: model.start, model, None)


def _piece(tell: TellRun, total: int, *inputs: Any) -> tuple[RunState, Log, Array, Array]:
    """Run a piece, by the quickly compiled program at first. A faster program is compiled once it
    saves its own compilation, by the impacts that have run and those that this run, after `total`
    of them, probably has left.
    """
    model, rules, state, _, end, _ = inputs
    now = float(state.now)
    left = total * (float(end) - now) / now if now > 0 else 0.0
    kind = jax.tree.structure(inputs[:3]), model.dtype
    swift = _is_swift(model, rules.slots, (done := _RUN.get(kind, 0)) + left)
    compiles = kind not in _RUN or (swift and done < math.inf)
    if compiles or not left:
        tell.says("compiling" if compiles else "running")
    piece = (_swiftly if swift else _quickly)(*inputs)
    _RUN[kind] = math.inf if swift else done + int(piece[2])
    return piece


def _is_swift(model: SceneArrays, slots: int, rows: float) -> bool:
    """Return whether the faster program is right for a number of impacts."""
    near = most_pairs(model, slots) if slots else None
    pairs = near or (slot_pairs(model, slots)[0].size if slots else 0)
    return (near is not None and slots > MOST) or rows * (1 + 12 * pairs) >= _PATIENCE


def _onward(
    model: SceneArrays, rules: Rules, state: RunState, valid: Array, end: Array, tolerance: Array
) -> tuple[RunState, Log, Array, Array]:
    """Return a piece with its own log, the number of its rows, and whether events are left."""
    end = jnp.where(valid, end, -1)
    log = blank_log(_PIECE, model, rules.slots)
    state, log, written = advance(RunTask(model, rules, end, tolerance), state, log)
    return state, log, written, has_events_left(state, end)


_quickly, _swiftly = quick(_onward), quick(_onward, options=swift_options)
_begun = quick(initial_state)
_expecting = quick(reset_events)
_with_slots = quick(with_empty_slots)
_blank = quick(blank_log)


def _with_room(model: SceneArrays, state: RunState, before: float) -> tuple[RunState, float]:
    """Return the run with new cells after one was full, and the time at which that was. If they
    were also full at the time `before`, cells are useless and omitted.
    """
    assert state.cells is not None
    now, position = _here(model, state)
    useful = float(now) > before
    grid = grid_of(model, position, state.cells.grid) if useful else None
    return _expecting(model, state, now, grid), float(now)


@quick
def _here(model: SceneArrays, state: RunState) -> tuple[Array, Array]:
    """Return the time of the next event, and the positions of all spheres then."""
    now = jnp.maximum(jnp.min(state.events.time), state.now)
    return now, flight_at(model, state, None, now)[0]


def _one_log(model: SceneArrays, rules: Rules, pieces: Sequence[tuple[Log, int]]) -> Log:
    """Return the log of several pieces, with blank rows at its end. Pieces from before the first
    coupled solve get blank rows for calls, and those with fewer slots more of them.
    """
    total = sum(count for _, count in pieces)
    # Logs of one piece's length, or of a larger power of two, share the programs that read them.
    room = max(_PIECE, 1 << max(total - 1, 0).bit_length())
    blank = _blank(1, model, rules.slots)

    def repeat(tree: Any, rows: int) -> Any:
        return jax.tree.map(lambda x: np.repeat(np.asarray(x), rows, axis=0), tree)

    def head(log: Log, rows: int) -> Log:
        figures, facts = jax.tree.map(lambda x: np.asarray(x)[:rows], log)
        empty, held = (blank.figures.coupled, blank.facts.call), (figures.coupled, facts.call)
        if held[1] is None:
            held = repeat(empty, rows)
        elif (slots := held[1].decided.slots.size) < rules.slots:
            held = held[0], _with_near(held, empty)
            held = in_more_slots(model, held, empty, (slots, rules.slots))
        return Log(figures._replace(coupled=held[0]), facts._replace(call=held[1]))

    parts = [*(head(*piece) for piece in pieces), repeat(blank, room - total)]
    return jax.device_put(jax.tree.map(lambda *x: np.concatenate(x), *parts))


def _with_near(held: Any, blank: Any) -> Any:
    """Return the decisions of calls that followed all pairs as if only those that touch."""
    (figures, facts), decided = held, held[1].decided
    if decided.near is not None or blank[1].decided.near is None:
        return facts
    near = (figures.began.closed > 0.5) | (figures.end.closed > 0.5)
    return facts._replace(decided=decided._replace(near=near))
