"""The public function `simulate`."""

from __future__ import annotations

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
    rendered,
    require_count,
    require_flag,
    require_kind,
    require_number,
)
from ._bodies import one_number
from ._log import Log, blank_log
from ._replay import differentiable
from ._result import Ending, Impacts, Margin, Way, flagged, traced
from ._run import Run, moment
from ._scene import Scene
from ._schedule import State, advance, begun
from ._system import Layout, Numbers, first_overlap, layout_of, numbers_of, replaced

ROOM = 256
"""Impacts that a traced run has room for."""

_PIECE = 256
"""Impacts between two looks of Python at a run."""


def simulate(
    scene: Scene,
    duration: ArrayLike,
    *,
    times: ArrayLike | None = None,
    rtol: float = 1e-9,
    instantaneous: bool = False,
    max_impacts: int | None = None,
) -> Run:
    """Follow a scene from impact to impact: flights by formula, times of impact in closed form.

    Arguments: the scene; its `duration` in s; `times` (T,) in s at which states are wanted,
    ascending, within the duration (the start and the end if not given); `rtol`, the tolerance of
    each impact. With `instantaneous` impacts are out of time: each has the law's e at its own
    closing speed. `max_impacts` is the room for impacts: from Python it grows by itself; with
    traced values it is fixed (256 if not given), `impacts` are padded to it, and a run that needs
    more is flagged and NaN.

    Impacts at the same time are taken pair by pair, the largest closing speed first, and marked.
    Where a ball bounces on a wall with a constant e < 1 under gravity, and the next bounce would be
    lower than `rtol` radii, the time of the infinitely many bounces is summed and the ball rests
    on the wall, along which it slides. Where impacts accumulate in any other way the run stops, and
    is flagged.

    Returns a `Run`, differentiable by all numbers of the scene in both modes; the derivative is
    that of the order of impacts that happened (`Run.margin`). Bad lanes are flagged in `status`,
    and NaN. Raises ValueError for what is out of range.

    Source: event-driven simulation with one stored event a body, Lubachevsky (1991),
    doi 10.1016/0021-9991(91)90222-7.
    """
    scene = require_kind("scene", scene, Scene, "a `Scene`")
    length = one_number(duration, "duration", POSITIVE)
    tolerance = require_number("rtol", rtol, FRACTION)
    if not require_flag("instantaneous", instantaneous):
        raise ValueError(
            "Argument `instantaneous` must be True: impacts that take time are not there yet, but "
            f"is {rendered(instantaneous)}."
        )
    most = None if max_impacts is None else require_count("max_impacts", max_impacts, 1)
    asked = _times(times, length)
    layout = layout_of(scene)
    numbers, valid = numbers_of(scene, layout, contacts=not all(layout.constant))
    length, asked = length.astype(numbers.dtype), asked.astype(numbers.dtype)
    given = (numbers, length, asked)
    within = jnp.asarray(tolerance, numbers.dtype)
    if traced(given):
        room = ROOM if most is None else most
        outcome = _all_at_once(layout, numbers, valid, length, within, room)
    else:
        outcome = _piece_by_piece(layout, numbers, valid, length, within, most)
    numbers, log, written, status, reached = outcome
    now = moment(layout, numbers, log, written, reached, asked)
    rows = log.facts.tied.shape[0] if traced(given) else int(written)
    impacts = _impacts(scene, layout, numbers, log, written, status, rows)
    return Run(
        time=now.time,
        position=now.position,
        velocity=now.velocity,
        energy=now.energy,
        impacts=impacts,
        margin=_margin(impacts, log),
        status=status,
        reached=reached,
        duration=length,
        scene=scene,
        _layout=layout,
        _numbers=numbers,
        _log=log,
        _written=written,
    )


def _times(given: Any, duration: Array) -> Array:
    """The times asked for; ValueError unless they ascend within the duration."""
    if given is None:
        return jnp.stack([jnp.zeros_like(duration), duration])
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
    layout: Layout, numbers: Numbers, valid: Array, end: Array, tolerance: Array, room: int
) -> tuple[Numbers, Log, Array, Array, Array]:
    """The whole run as one program with room for so many impacts, differentiable."""
    valid = valid & (first_overlap(layout, jax.lax.stop_gradient(numbers)) == 0)
    valid = valid & POSITIVE.holds(end)
    numbers = replaced(numbers, valid)
    fixed = jax.tree.map(
        lambda x: jax.lax.stop_gradient(x) if eqx.is_inexact_array(x) else x, numbers
    )
    last = jnp.where(valid, jax.lax.stop_gradient(end), -1)
    state = begun(layout, fixed, last)
    log = blank_log(room, layout.dimensions, numbers.dtype)
    state, log, written = advance(layout, fixed, state, log, last, tolerance)
    more = jnp.min(state.events.time) <= last
    status, reached = _ending(state, more, valid, end)
    return numbers, differentiable(layout, numbers, log, written), written, status, reached


def _ending(state: State, more: Array, valid: Array, end: Array) -> tuple[Array, Array]:
    """How a run ended, and up to which time its values hold."""
    stuck = state.status != 0
    status = jnp.where(stuck, int(Ending.ACCUMULATED), int(Ending.COMPLETED))
    status = jnp.where(~stuck & more, int(Ending.TOO_MANY_IMPACTS), status)
    status = jnp.where(valid, status, int(Ending.INVALID_INPUT))
    reached = jnp.where(stuck, state.now, jnp.where(more | ~valid, -1, end))
    return status, jax.lax.stop_gradient(reached)


_begun = eqx.filter_jit(begun)
_advance = eqx.filter_jit(advance)


def _piece_by_piece(
    layout: Layout, numbers: Numbers, valid: Array, end: Array, tolerance: Array, most: int | None
) -> tuple[Numbers, Log, Array, Array, Array]:
    """The run from Python: one program goes on until all impacts are there."""
    numbers = replaced(numbers, valid)
    last = jnp.where(valid, end, -1)
    state = _begun(layout, numbers, last)
    pieces: list[Log] = []
    total, more = 0, True
    while more and int(state.status) == 0 and (most is None or total < most):
        blank = blank_log(_PIECE, layout.dimensions, numbers.dtype)
        state, log, written = _advance(layout, numbers, state, blank, last, tolerance)
        count = int(written) if most is None else min(int(written), most - total)
        more = bool(jnp.min(state.events.time) <= last) or count < int(written)
        pieces.append(jax.tree.map(lambda x, n=count: np.asarray(x)[:n], log))
        total += count
    # Rows of lengths that are powers of two share the programs that read them.
    room = max(64, 1 << max(total - 1, 0).bit_length())
    blank = jax.tree.map(np.asarray, blank_log(room - total, layout.dimensions, numbers.dtype))
    log = jax.tree.map(lambda *parts: jnp.asarray(np.concatenate(parts)), *pieces, blank)
    status, reached = _ending(state, jnp.asarray(more), valid, end)
    return numbers, log, jnp.asarray(total), status, reached


def _impacts(
    scene: Scene,
    layout: Layout,
    numbers: Numbers,
    log: Log,
    written: Array,
    status: Array,
    rows: int,
) -> Impacts:
    figures, facts = jax.tree.map(lambda x: x[:rows], log)
    outcome, choice = figures.outcome, facts.choice
    valid = (jnp.arange(rows) < written) & (status != int(Ending.INVALID_INPUT))
    good = valid & (status != int(Ending.TOO_MANY_IMPACTS))
    body, face = jnp.asarray(layout.body), jnp.asarray(layout.face)

    def number(value: Array) -> Array:
        return flagged(value, good)

    def whole(value: Array) -> Array:
        return jnp.where(valid, value, -1)

    nothing = jnp.zeros_like(outcome.time)
    way = jnp.where(choice.tail, int(Way.SERIES), int(Way.INSTANTANEOUS))
    return Impacts(
        time=number(outcome.time),
        first=whole(body[choice.first]),
        second=whole(body[choice.second]),
        face=whole(face[choice.second]),
        closing_speed=number(outcome.closing),
        restitution=number(outcome.restitution),
        duration=number(outcome.duration),
        max_force=number(jnp.full_like(nothing, jnp.inf)),
        energy_loss=number(outcome.energy_loss),
        turn=number(nothing),
        way=whole(way),
        error_estimate=number(nothing),
        tied=facts.tied & valid,
        valid=valid,
        names=tuple(
            body.name if body.name is not None else f"{type(body).__name__.lower()} {k}"
            for k, body in enumerate(scene.bodies)
        ),
    )


def _margin(impacts: Impacts, log: Log) -> Margin:
    rows = impacts.valid.shape[0]
    rival = jnp.where(impacts.valid, log.facts.rival[:rows], jnp.inf)
    closing = jnp.where(impacts.valid, impacts.closing_speed, jnp.inf)
    return Margin(
        time=jnp.min(rival, initial=jnp.inf), closing_speed=jnp.min(closing, initial=jnp.inf)
    )
