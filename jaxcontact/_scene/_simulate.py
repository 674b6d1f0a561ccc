"""The public function `simulate`."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, ArrayLike

from .._parameter import (
    FRACTION,
    POSITIVE,
    as_parameter,
    refuses_unknown,
    rendered,
    require_choice,
    require_count,
    require_flag,
    require_kind,
    require_number,
)
from .._program import derived, quick
from .._progress import Listener, Tell, progress_of, require_progress
from ._cells import Grid
from ._coupled import MOST
from ._due import expecting
from ._entry import one_number
from ._followed import Known, followed
from ._grid import grid_of
from ._log import Log, blank_log
from ._numbers import Given, gathered, given_in, replaced
from ._overlap import require_clear_of_each_other
from ._progress import CROWDED, RUNNING, Rules, State
from ._reading import Course, read
from ._result import traced
from ._run import Run
from ._scene import Scene
from ._schedule import advance, begun, goes_on, with_places
from ._search import flown
from ._slots import everyone
from ._system import Layout, Numbers, first_overlap, layout_of

ROOM = 256
"""Impacts that a traced run has room for."""

_CALLS = 4
"""Rows of the log for each impact that a coupled solve may need."""

_MOST_GROWN = 32
"""Places to which a coupled solve grows by itself."""

_PIECE = 256
"""Impacts between two looks of Python at a run."""

_PATIENCE = 2048
"""Impacts that run in a program that was compiled quickly, over one and the places of a coupled
solve. Not a time: the two programs round differently, and a script shall repeat its numbers."""


@refuses_unknown
def simulate(
    scene: Scene,
    duration: ArrayLike,
    *,
    times: ArrayLike | None = None,
    rtol: float = 1e-9,
    instantaneous: bool = False,
    v0: str | float = "peak",
    max_impacts: int | None = None,
    max_cluster: int | None = None,
    progress: bool | Listener | None = None,
) -> Run:
    """Follow a scene from impact to impact: flights by formula, times of impact in closed form.

    Arguments: the scene; its `duration` in s; `times` (T,) in s at which states are wanted,
    ascending, within the duration (the start and the end if not given); `rtol`, the tolerance of
    each impact: velocities relative to the closing speed.

    An isolated impact lasts as long as its law says, and the line of centres turns meanwhile: by
    closed form where it is head-on, else by the radial equation with its angular momentum. Whatever
    is not isolated is a coupled solve: a third body near, gravity across a wall, a contact that
    comes to rest. It has room for `max_cluster` spheres, two at the least: those in contact and
    those that they may reach soon; a run that needs more is flagged (`Ending.CROWDED`). If it is
    not given it is 8, and from Python a run that needs more begins anew with room for 16 or 32.
    `v0` is the speed that the damping of a law refers to: "peak", the largest closing speed since
    touch, which in a free impact is that at touch; "touch", that at touch; a number, that at touch
    or this least one in m/s.

    With `instantaneous` impacts are out of time: each has the law's e at its own closing speed.
    Impacts at the same time are taken pair by pair, the largest closing speed first, and marked.
    Where a ball bounces on a wall with a constant e < 1 under gravity, and the next bounce would be
    lower than `rtol` radii, the time of the infinitely many bounces is summed and the ball rests
    on the wall, along which it slides. Where impacts accumulate in any other way the run stops, and
    is flagged.

    `max_impacts` is the room for impacts: from Python, and for its derivatives there, it grows by
    itself; under `jit` and `vmap` it is fixed (256 if not given), `impacts` are padded to it, and a
    run that needs more is flagged and NaN.

    `progress` of a run from Python: None shows the impacts on stderr after a second, if that is a
    terminal or a notebook; True does so anywhere, False nowhere; a function is called with their
    number and None, as the whole is not known.

    Returns a `Run`, differentiable by all numbers of the scene in both modes; the derivative is
    that of the order of impacts that happened (`Run.margin`). Bad lanes are flagged in `status`,
    and NaN. Raises ValueError for what is out of range.

    Source: event-driven simulation with one stored event a body, Lubachevsky (1991),
    doi 10.1016/0021-9991(91)90222-7.
    """
    scene = require_kind("scene", scene, Scene, "a `Scene`")
    length = one_number(duration, "duration", POSITIVE)
    tolerance = require_number("rtol", rtol, FRACTION)
    soft = not require_flag("instantaneous", instantaneous)
    rule = _v0(v0)
    room_for = MOST if max_cluster is None else require_count("max_cluster", max_cluster, 2)
    most = None if max_impacts is None else require_count("max_impacts", max_impacts, 1)
    asked = _times(times, length)
    require_progress(progress)
    layout = layout_of(scene)
    if max_cluster is None:
        room_for = _places_of(scene, room_for)
    scene = _going_on(scene, soft, min(room_for, layout.spheres))
    require_clear_of_each_other(scene.bodies, length)
    rules = Rules(soft, rule, min(room_for, layout.spheres) if soft else 0)
    plain = not traced((scene, length, asked))
    start: State | None = None
    if plain:
        *numbers_of_it, start = _started(given_in(scene), layout, rules, length, asked)
    else:
        began: list[State] = []

        def seen(*given: Any) -> tuple[tuple[Any, ...], None]:
            *known, state = _seen(*given)
            began[:] = [state]
            return tuple(known), None

        numbers_of_it = derived(_unseen, scene, layout, rules, length, asked, decide=seen)
        start = began[0] if began else None
    numbers, valid, length, asked, last = numbers_of_it
    within = jax.device_put(np.asarray(tolerance, numbers.dtype))
    grows = max_cluster is None and _places_of(scene, 0) == 0
    # A call of the coupled solve ends where any pair touches or opens.
    calls = _CALLS if rules.members and not plain else 1
    room = ROOM if most is None else most

    def from_python(given: tuple) -> tuple[Rules, Known]:
        layout, numbers, valid, last, within = given
        rows = None if most is None else most * calls
        with progress_of(progress, "impacts", "simulate") as tell:
            return _grown(rules, layout, numbers, valid, last, within, start, rows, tell, grows)

    def at_once(given: tuple) -> Known:
        layout, numbers, valid, last, within = given
        grid = None if soft else grid_of(layout, numbers)
        return _all_at_once(layout, numbers, rules, valid, last, within, room * calls, grid)

    given = (layout, numbers, valid, last, within)
    rules, numbers, known = followed(rules, given, from_python, at_once)
    course = Course(*known, last, length)
    told = read(layout, numbers, rules, course, asked, within, room)
    names = tuple(
        body.name if body.name is not None else f"{type(body).__name__.lower()} {k}"
        for k, body in enumerate(scene.bodies)
    )
    return Run(
        time=told.now.time,
        position=told.now.position,
        velocity=told.now.velocity,
        energy=told.now.energy,
        impacts=dataclasses.replace(told.impacts, names=names),
        status=told.status,
        reached=told.reached,
        wall_work=told.work,
        duration=length,
        scene=scene,
        _nearest=told.nearest,
        _layout=layout,
        _numbers=numbers,
        _log=course.log,
        _written=course.written,
        _rules=rules,
        _tolerance=within,
    )


def _places_of(scene: Scene, otherwise: int) -> int:
    """For how many spheres the coupled solve that a scene begins in has room."""
    contacts = None if scene._start is None else scene._start.contacts
    return otherwise if contacts is None else contacts.who.shape[0]


def _grown(
    rules: Rules,
    layout: Layout,
    numbers: Numbers,
    valid: Array,
    last: Array,
    tolerance: Array,
    start: State | None,
    most: int | None,
    tell: Tell,
    grows: bool,
) -> tuple[Rules, Known]:
    """The run from Python, with more places in coupled solves where it `grows`."""
    state = _begun(layout, numbers, rules) if start is None else start
    given = (layout, (numbers, valid, last, state), tolerance, most, tell)
    ended, known = _piece_by_piece(rules, *given)
    while (
        grows and int(known.status) == CROWDED and ended.members < min(_MOST_GROWN, layout.spheres)
    ):
        more = min(2 * ended.members, layout.spheres)
        ended, known = _piece_by_piece(Rules(rules.soft, rules.v0, more), *given)
    return ended, known


def _going_on(scene: Scene, soft: bool, members: int) -> Scene:
    """The scene, with what it goes on from where that is of use."""
    start = scene._start
    if start is None or start.soft == soft:
        if start is not None and start.contacts is not None:
            places = start.contacts.who.shape[0]
            if places != members and not traced(start) and not bool(start.contacts.active):
                return eqx.tree_at(lambda scene: scene._start, scene, start.without_contacts())
            if places != members:
                raise ValueError(
                    "Argument `max_cluster` must be that of the run that ended in contact, "
                    f"{places}, but is {members}."
                )
        return scene
    if start.soft:
        raise ValueError(
            "Argument `instantaneous` must be False for a scene that goes on from soft contacts, "
            "but is True."
        )
    # A ball that rested out of time has no indentation yet.
    return eqx.tree_at(lambda scene: scene._start, scene, None)


def _v0(given: Any) -> str | float:
    """The rule of v0: "peak", "touch" or a floor in m/s; ValueError for anything else."""
    if isinstance(given, str):
        return require_choice("v0", given, ("peak", "touch"))
    return require_number("v0", given, POSITIVE)


def _times(given: Any, duration: Array) -> Array:
    """The times asked for; ValueError unless they ascend within the duration."""
    if given is None:
        if isinstance(duration, Tracer):
            return jnp.stack([jnp.zeros_like(duration), duration])
        end = np.asarray(duration)
        return jax.device_put(np.stack([np.zeros_like(end), end]))
    times = as_parameter(given, "times")
    if times.ndim != 1 or times.shape[0] == 0:
        raise ValueError(f"Argument `times` must be a list of numbers, but is {rendered(given)}.")
    if isinstance(times, Tracer):
        return times
    plain = np.asarray(times)
    if not (np.all(np.isfinite(plain)) and np.all(np.diff(plain) > 0)):
        raise ValueError(f"Argument `times` must ascend, but is {rendered(given)}.")
    late = not isinstance(duration, Tracer) and plain[-1] > float(duration)
    if plain[0] < 0 or late:
        raise ValueError(
            f"Argument `times` must lie between 0 and the duration, but is {rendered(given)}."
        )
    return times


@eqx.filter_jit
def _all_at_once(
    layout: Layout,
    numbers: Numbers,
    rules: Rules,
    valid: Array,
    end: Array,
    tolerance: Array,
    room: int,
    grid: Grid | None,
) -> Known:
    """The whole run as one program with room for so many impacts.

    Where a cell is full the run goes on without cells.
    """
    fixed = jax.tree.map(
        lambda x: jax.lax.stop_gradient(x) if eqx.is_inexact_array(x) else x, numbers
    )
    last = jnp.where(valid, jax.lax.stop_gradient(end), -1)
    state = begun(layout, fixed, rules, grid)
    log = blank_log(room, layout, numbers.dtype, rules.members)
    state, log, written = advance(layout, fixed, rules, state, log, last, tolerance)
    if state.cells is not None:
        full = state.cells.full & valid
        now = jnp.maximum(jnp.min(state.events.time), state.now)
        state = expecting(layout, fixed, state, now, None, full)
        state, log, written = advance(layout, fixed, rules, state, log, last, tolerance, written)
    more = goes_on(state, last)
    return Known(log, written, state.status, state.now, more, valid)


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


@quick
def _started(given: Given, layout: Layout, rules: Rules, *times: Array) -> tuple[Any, ...]:
    """What `_numbers` says, and the state at the start."""
    known = _numbers(given, layout, rules, *times)
    return *known, begun(layout, known[0], rules)


@quick
def _seen(scene: Scene, layout: Layout, rules: Rules, *times: Array) -> tuple[Any, ...]:
    """As `_started`, of a scene beneath a derivative."""
    known = _unseen(None, scene, layout, rules, *times)
    return *known, begun(layout, known[0], rules)


@quick
def _unseen(choice: None, scene: Scene, layout: Layout, *given: Any) -> tuple[Any, ...]:
    """What `_numbers` says of a scene that nobody has looked at: bodies may overlap."""
    numbers, valid, length, *rest = _numbers(given_in(scene), layout, *given)
    valid = valid & (first_overlap(layout, jax.lax.stop_gradient(numbers)) == 0)
    valid = valid & POSITIVE.holds(length)
    return replaced(numbers, valid), valid, length, *rest


def _numbers(
    given: Given, layout: Layout, rules: Rules, length: Array, asked: Array
) -> tuple[Numbers, Array, Array, Array, Array]:
    """The numbers of a scene and whether they are valid, the duration and the times in their
    precision, and until when the run goes.
    """
    contacts = rules.soft or not all(layout.constant)
    numbers, valid = gathered(given, layout, contacts, rules.soft)
    numbers = replaced(numbers, valid)
    length, asked = length.astype(numbers.dtype), asked.astype(numbers.dtype)
    last = length
    for movers in (numbers.motion, numbers.shaking):
        if movers is not None:
            last = jnp.minimum(last, movers.kept_until(length))
    return numbers, valid, length, asked, last


def _onward(
    layout: Layout,
    numbers: Numbers,
    rules: Rules,
    state: State,
    valid: Array,
    end: Array,
    tolerance: Array,
) -> tuple[State, Log, Array, Array]:
    """A piece of a run: with its own log; whether there is more to come."""
    end = jnp.where(valid, end, -1)
    log = blank_log(_PIECE, layout, numbers.dtype, rules.members)
    state, log, written = advance(layout, numbers, rules, state, log, end, tolerance)
    return state, log, written, goes_on(state, end)


_quickly, _swiftly = quick(_onward), eqx.filter_jit(_onward)
_begun = quick(begun)
_expecting = quick(expecting)
_with_places = quick(with_places)
_blank = quick(blank_log)


_RUN: dict[Any, int] = {}
"""How many impacts of a kind have run in a program that was compiled quickly."""


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


def _piece_by_piece(
    rules: Rules, layout: Layout, start: tuple, tolerance: Array, most: int | None, tell: Tell
) -> tuple[Rules, Known]:
    """The run from Python: one program goes on until all impacts are there.

    Among many spheres or in a periodic space most scenes need no coupled solve: there the program
    is one without, until one is needed. Returns the rules that it ended with.
    """
    numbers, valid, end, state = start
    given = rules
    within = numbers.start is not None and bool(numbers.start.leans)
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
        if int(state.status) == CROWDED and rules.members < given.members:
            rules = given
            state = _with_places(layout, numbers, rules.members, state)
    log = pieces[0][0] if len(pieces) == 1 else _one_log(layout, numbers, rules, pieces)
    written, ahead = jax.device_put((np.asarray(total), np.asarray(more)))
    return rules, Known(log, written, state.status, state.now, ahead, valid)


def _one_log(
    layout: Layout, numbers: Numbers, rules: Rules, pieces: Sequence[tuple[Log, int]]
) -> Log:
    """The log of several pieces, with blank rows at its end."""
    total = sum(count for _, count in pieces)
    # Rows of lengths that are powers of two share the programs that read them.
    room = 1 << max(total - 1, 0).bit_length()
    blank = _blank(1, layout, numbers.dtype, rules.members)
    cut = [jax.tree.map(lambda x, n=count: np.asarray(x)[:n], log) for log, count in pieces]
    rest = jax.tree.map(lambda x: np.repeat(np.asarray(x), room - total, axis=0), blank)
    parts = [_with_calls(piece, blank) for piece in cut]
    return jax.device_put(jax.tree.map(lambda *x: np.concatenate(x), *parts, rest))


def _with_calls(piece: Log, blank: Log) -> Log:
    """A piece from before there was a coupled solve, with rows for calls where `blank` has them."""
    if blank.facts.call is None or piece.facts.call is not None:
        return piece
    rows = piece.facts.tied.shape[0]
    together, called = jax.tree.map(
        lambda x: np.repeat(np.asarray(x), rows, axis=0),
        (blank.figures.coupled, blank.facts.call),
    )
    return Log(piece.figures._replace(coupled=together), piece.facts._replace(call=called))
