"""The public function `simulate`."""

from __future__ import annotations

import dataclasses
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
from .._text.progress import Listener, progress_of, require_progress
from .arrays.arrays import Layout, Numbers, first_overlap, layout_of
from .arrays.from_scene import Parts, gathered, given_in, replaced
from .bodies.entry import one_number
from .bodies.overlap import require_clear_of_each_other
from .bodies.scene import Scene
from .contact_times.grid import grid_of
from .course import Course
from .derivative.followed import Given, followed
from .engine.coupled import MOST
from .engine.log import Known
from .engine.loop import begun
from .engine.pieces import all_at_once, from_python
from .engine.state import Rules, State
from .readout.reading import read
from .result import traced
from .run import Run

ROOM = 256
"""Impacts that a traced run has room for."""

_CALLS = 4
"""Rows of the log for each impact that a coupled solve may need."""


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

    def piecewise(given: Given) -> tuple[Rules, Known]:
        rows = None if most is None else most * calls
        with progress_of(progress, "impacts", "simulate") as tell:
            return from_python(rules, given, start, rows, tell, grows)

    def at_once(given: Given) -> Known:
        grid = None if soft else grid_of(*given[:2])
        return all_at_once(rules, given, grid, room * calls)

    given = (layout, numbers, valid, last, within)
    ended, numbers, known = followed(rules, given, piecewise, at_once)
    course = Course(layout, numbers, ended, within, known, last, length)
    told = read(course, asked, room)
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
        _course=course,
    )


def _places_of(scene: Scene, otherwise: int) -> int:
    """For how many spheres the coupled solve that a scene begins in has room."""
    contacts = None if scene._start is None else scene._start.contacts
    return otherwise if contacts is None else contacts.who.shape[0]


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


@quick
def _started(given: Parts, layout: Layout, rules: Rules, *times: Array) -> tuple[Any, ...]:
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
    given: Parts, layout: Layout, rules: Rules, length: Array, asked: Array
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
