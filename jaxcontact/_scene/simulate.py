"""The simulation of a scene."""

from __future__ import annotations

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike

from .._entry import (
    FRACTION,
    POSITIVE,
    as_parameter,
    refusal,
    require_choice,
    require_count,
    require_flag,
    require_number,
)
from .._laws import require_no_adhesion
from .._program import derived, quick, traced
from .._text.failure import checked
from .._text.progress import TellRun
from .arrays.arrays import SceneArrays, SceneLayout, first_overlap, layout_of
from .arrays.from_scene import SceneInputs, arrays_of, inputs_of, ones_unless
from .bodies.bodies import names_of
from .bodies.entry import one_number
from .bodies.overlap import require_clear_of_each_other
from .bodies.scene import Scene
from .contact_times.cells import grid_of
from .derivative.differentiable_run import RunInputs, differentiable_run
from .engine.coupled import MOST
from .engine.log import LoopOutcome, RunRecord
from .engine.loop import initial_state
from .engine.pieces import all_at_once, from_python
from .engine.state import Rules, RunState
from .readout.reading import read_run
from .result import Ending, Impacts
from .run import Run

ROOM = 256
"""The number of impacts that a traced run can hold."""

_CALLS = 4
"""The number of log rows for each impact, as a coupled solve may need several."""


def simulate_scene(
    scene: Scene,
    duration: ArrayLike,
    *,
    times: ArrayLike | None,
    rtol: float,
    instantaneous: bool,
    v0: str | float,
    max_impacts: int | None,
    max_cluster: int | None,
    tell: TellRun,
    throw: bool,
) -> Run:
    """Simulate a scene; see `simulate`."""
    length = one_number(duration, "duration", POSITIVE)
    tolerance = require_number("rtol", rtol, FRACTION)
    soft, throw = not require_flag("instantaneous", instantaneous), require_flag("throw", throw)
    rule = require_v0(v0)
    if not soft:
        for law in scene.law.values:
            require_no_adhesion(law, "where impacts are instantaneous")
    max_cluster = _count("max_cluster", max_cluster, 2)
    most = _count("max_impacts", max_impacts, 1)
    at = times_of(times, length)
    moves = traced(at)
    layout = layout_of(scene)
    slots = _slots_for(scene, max_cluster, layout)
    scene = _usable_start(scene, soft, slots)
    require_clear_of_each_other(scene.bodies, length)
    rules = Rules(soft, rule, slots if soft else 0)
    plain = not traced((scene, length, at))
    start: RunState | None = None

    def prepare(scene: Scene, *arguments: Any) -> tuple[tuple[Any, ...], None]:
        nonlocal start
        *prepared, start = _prepare(inputs_of(scene), *arguments)
        return tuple(prepared), None

    given = scene, layout, rules, not plain, length, at
    if plain:
        tell.says("compiling")
    prepared = prepare(*given)[0] if plain else derived(_numbers_of, *given, decide=prepare)
    model, valid, length, at, last = prepared
    within = jax.device_put(np.asarray(tolerance, model.dtype))
    grows = max_cluster is None and _slots_of(scene, 0) == 0
    # A call of the coupled solve ends when any pair touches or opens.
    calls = _CALLS if rules.slots and not plain else 1
    room = ROOM if most is None else most

    def piecewise(inputs: RunInputs) -> tuple[Rules, LoopOutcome]:
        rows = None if most is None else most * calls
        return from_python(rules, inputs, start, rows, tell, grows)

    def at_once(inputs: RunInputs) -> LoopOutcome:
        return all_at_once(rules, inputs, None if soft else grid_of(inputs[0]), room * calls)

    inputs = (model, valid, last, within)
    ended, model, outcome = differentiable_run(rules, inputs, piecewise, at_once)
    record = RunRecord(model, ended, within, outcome, last, length)
    contents = read_run(record, at, room, moves)
    impacts = dataclasses.replace(contents.impacts, names=names_of(scene.bodies))
    run = Run(
        **contents.now._asdict(),
        impacts=impacts,
        status=_status_with_gains(contents.status, record, impacts),
        reached=contents.reached,
        wall_work=contents.work,
        sliding_loss=contents.sliding_loss,
        duration=length,
        scene=scene,
        _nearest=contents.nearest,
        _record=record,
    )
    right = "{} Up to {:.6g} s the run is right.".format
    return checked(run, throw, "simulate", lambda: right(run._why(), max(float(run.reached), 0)))


def _count(name: str, value: Any, least: int) -> int | None:
    return None if value is None else require_count(name, value, least)


def _status_with_gains(status: Array, record: RunRecord, impacts: Impacts) -> Array:
    if traced(status) or not some_impact_gains(record, impacts):
        return status
    done = np.asarray(status) == Ending.COMPLETED
    return jax.device_put(np.where(done, Ending.GAINED, status).astype(status.dtype))


def _slots_for(scene: Scene, asked: int | None, layout: SceneLayout) -> int:
    """Return the slots of the coupled solve: as asked, or those in which the scene starts."""
    slots = _slots_of(scene, MOST) if asked is None else asked
    if slots <= MOST or slots != _slots_of(scene, 0):
        slots = min(slots, layout.spheres)
    return slots


def _slots_of(scene: Scene, otherwise: int) -> int:
    """Return the number of slots of the coupled solve that a scene starts in, else `otherwise`."""
    contacts = None if scene._start is None else scene._start.contacts
    return otherwise if contacts is None else contacts.who.shape[0]


def _usable_start(scene: Scene, soft: bool, size: int) -> Scene:
    """Return the scene with its start state removed where that is not used."""
    start, slots = scene._start, _slots_of(scene, size)
    if start is None or start.soft == soft:
        if start is None or start.contacts is None or slots == size:
            return scene
        if not traced(start) and not bool(start.contacts.active):
            start = dataclasses.replace(start, contacts=None)
            return eqx.tree_at(lambda scene: scene._start, scene, start)
        raise ValueError(
            "Argument `max_cluster` must be that of the run that ended in contact, "
            f"{slots}, but is {size}."
        )
    if start.soft:
        raise ValueError(
            "Argument `instantaneous` must be False for a scene that goes on from soft contacts, "
            "but is True."
        )
    # A ball that rested after instantaneous impacts has no indentation.
    return eqx.tree_at(lambda scene: scene._start, scene, None)


def require_v0(value: Any) -> str | float:
    """Return the rule for v0: "peak", "touch" or a lower bound in m/s.

    Raises ValueError for anything else.
    """
    if isinstance(value, str):
        return require_choice("v0", value, ("peak", "touch"))
    return require_number("v0", value, POSITIVE)


def times_of(value: Any, duration: Array) -> Array:
    """Return the output times; raises ValueError unless they ascend within the duration."""
    if value is None:
        if traced(duration):
            return jnp.stack([jnp.zeros_like(duration), duration])
        end = np.asarray(duration)
        return jax.device_put(np.stack([np.zeros_like(end), end]))
    times = as_parameter(value, "times")
    if times.ndim != 1 or times.shape[0] == 0:
        raise refusal("times", "be a list of numbers", value)
    if traced(times):
        return times
    plain = np.asarray(times)
    if not np.all(np.isfinite(plain)) & np.all(np.diff(plain) > 0):
        raise refusal("times", "ascend", value)
    late = not traced(duration) and plain[-1] > float(duration)
    if plain[0] < 0 or late:
        raise refusal("times", "lie between 0 and the duration", value)
    return times


@quick
def _prepare(inputs: SceneInputs, layout: SceneLayout, rules: Rules, *others: Any) -> tuple:
    """Return the values of `_numbers` and the state at the start."""
    prepared = _numbers(inputs, layout, rules, *others)
    return *prepared, initial_state(prepared[0], rules)


@quick
def _numbers_of(choice: None, scene: Scene, *others: Any) -> tuple:
    return _numbers(inputs_of(scene), *others)


def _numbers(
    inputs: SceneInputs,
    layout: SceneLayout,
    rules: Rules,
    unchecked: bool,
    length: Array,
    times: Array,
) -> tuple[SceneArrays, Array, Array, Array, Array]:
    """Return the numbers of a scene and their validity, the duration, the times and the last time.

    Duration and times have the precision of the numbers. The last time is earlier than the duration
    if a motion exceeds its bound. Bodies with `unchecked` values may overlap.
    """
    contacts = rules.soft or not all(layout.constant)
    model, valid = arrays_of(inputs, layout, contacts, rules.soft)
    model = ones_unless(model, valid)
    length, times = (jnp.asarray(time, model.dtype) for time in (length, times))
    last = length
    for movers in (model.motion, model.shaking):
        if movers is not None:
            last = jnp.minimum(last, movers.kept_until(length))
    if unchecked:
        valid = valid & (first_overlap(jax.lax.stop_gradient(model)) == 0)
        valid = valid & POSITIVE.holds(length)
        model = ones_unless(model, valid)
    return model, valid, length, times, last


_SURE = 10
"""Errors of an impact beyond which it has gained energy."""


def some_impact_gains(record: RunRecord, impacts: Impacts) -> bool:
    """Return whether a whole impact has a negative loss, beyond its error; False if traced.

    Parts of impacts are left out: they may return energy that was stored before the run.
    """
    if traced((record, impacts)):
        return False
    # In NumPy, which needs no compilation.
    inverse = np.zeros(len(impacts.names))
    inverse[np.asarray(record.model.body)] = np.asarray(record.model.inverse_mass)
    columns = impacts.to_dict()
    whole = np.isfinite(columns["restitution"]) & (columns["time"] >= 0)
    share = inverse[columns["first"]] + inverse[columns["second"]]
    error = np.maximum(columns["error_estimate"], float(record.tolerance))
    gain = -2 * columns["energy_loss"] * share
    return bool(np.any(whole & (gain > _SURE * error * columns["closing_speed"] ** 2)))
