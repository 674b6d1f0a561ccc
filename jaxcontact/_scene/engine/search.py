"""The search for the next event: the earliest contact of a sphere with any other body. Stale events
are searched again until the next one is an impact.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..._coupled.modes import Flag, Index, Number
from ..._coupled.rows import rows_of, with_one_or_two, with_rows
from ..arrays.arrays import SceneArrays, SceneLayout, at_once, nearest_image
from ..bodies.overlap import NOISE, ROUNDINGS
from ..contact_times.cells import (
    CellGrid,
    Cells,
    Shift,
    everywhere,
    fill_cells,
    leaving,
    move_sphere,
    neighbours,
    shift_of,
    staying,
)
from ..contact_times.touch import (
    curved_time,
    image_horizon,
    shaking_sphere_time,
    shaking_wall_time,
    sphere_time,
    wall_time,
)
from .state import Coupling, Events, RunState, index_of

TIED = 64
"""The rounding errors of a time within which two events are simultaneous."""

AGAIN, LEAVES, OUT_OF_DATE = -1, -2, -3
"""Markers in place of a partner: search again, leave the cell, or path changed since the search."""


def simultaneous(model: SceneArrays, time: Number) -> Number:
    """Return the largest difference between two times that are equal up to rounding."""
    finite = jnp.where(jnp.isfinite(time), jnp.abs(time), 0)
    return TIED * jnp.finfo(model.dtype).eps * finite


def find_next_events(
    model: SceneArrays, state: RunState, who: Int[Array, " M"], now: Number, end: Number
) -> Events:
    """Search the next events of some spheres among all bodies, or those of nearby cells."""
    count, eps = model.spheres, jnp.finfo(model.dtype).eps
    others, valid = None, jnp.asarray(True)[None, None]
    names = jnp.arange(count)[None]
    if state.cells is not None:
        others, valid = neighbours(model, state.cells, who)
        names = others
    size = (who.shape[0], names.shape[1])
    position, velocity, pull = flight_at(model, state, who, now)
    across = flight_at(model, state, None if others is None else others.reshape(-1), now)
    speeds, all_speeds = (jnp.sqrt(jnp.sum(jnp.square(x), axis=-1)) for x in (velocity, across[1]))

    def relative(mine: Array, theirs: Array) -> Array:
        return mine[:, None] - theirs.reshape(-1, size[1], model.dimensions)

    apart = relative(position, across[0]).reshape(-1, model.dimensions)
    apart = nearest_image(model, apart)[0].reshape(*size, model.dimensions)
    rate, bend = relative(velocity, across[1]), relative(pull, across[2])
    radius = rows_of(model.radius, who)[:, None]
    distance = radius + _of(model.radius, others).reshape(-1, size[1])
    noise = NOISE * eps * (speeds[:, None] + all_speeds.reshape(-1, size[1]))
    straight = sphere_time(apart, rate, distance, noise, shells=model.spheres > model.visible)
    stand = sum(model.fixed) > len(model.shaken)
    if model.has_gravity and (model.walls or stand):
        bent = jnp.any(bend != 0, axis=-1)
        horizon = jnp.maximum(end - now, 0)

        def curved() -> Array:
            return curved_time(apart, rate, bend, distance, noise, horizon)

        times = jnp.where(bent, jax.lax.cond(jnp.any(bent), curved, lambda: straight), straight)
    else:
        times = straight
    other = valid & (names != who[:, None])
    if model.shaken:
        # Shaken spheres have columns of their own.
        other = other & (model.shaken_row(names) == len(model.shaken))
    if any(model.fixed):
        all_move = _of(model.inverse_mass[:count] > 0, others).reshape(-1, size[1])
        other = other & (all_move | _moves(model, who)[:, None])
    times = jnp.where(other, times, jnp.inf)
    reached = jnp.where(jnp.isfinite(times), times, 0)[..., None]
    at = apart + (rate + bend / 2 * reached) * reached
    closing = -jnp.sum(at * (rate + bend * reached), axis=-1) / distance

    horizon = jnp.full(who.shape, jnp.inf, model.dtype)
    for axis in range(model.dimensions):
        # Spheres in neighbouring cells have one nearest image.
        cut = state.cells is not None and state.cells.grid.axes[axis]
        near = size[1] - len(everywhere(model)) if cut else 0
        if model.periodic[axis] and near < size[1]:
            away, fast, falls = (x[:, near:, axis] for x in (apart, rate, bend))
            bound = image_horizon(away, fast, falls, distance[:, near:], model.period[axis])
            bound = jnp.where(other[:, near:], bound, jnp.inf)
            horizon = jnp.minimum(horizon, jnp.min(bound, axis=-1))
    leaves = jnp.full(who.shape, jnp.inf, model.dtype)
    if state.cells is not None:
        leaves = leaving(model, state.cells, who, position, velocity, pull)
        if model.shaken:
            leaves = jnp.where(model.shaken_row(who) < len(model.shaken), jnp.inf, leaves)

    columns = [_OtherBodies(times, closing, jnp.broadcast_to(names, size))]
    those = _Those(who, position, velocity, pull, now, end)
    if model.shaken:
        shaken, bound = _of_shaken(model, those)
        columns.append(shaken)
        horizon = jnp.minimum(horizon, bound)
    if model.walls:
        columns.append(_of_walls(model, state, those))
    times, closing, names = jax.tree.map(lambda *x: jnp.concatenate(x, axis=-1), *columns)
    if any(model.fixed):
        # Spheres in motion find the fixed ones.
        times = jnp.where(_moves(model, who)[:, None], times, jnp.inf)

    # Of simultaneous events the fastest closing one is chosen, then the lowest number. The result
    # does not depend on the order of the columns.
    least = jnp.min(times, axis=-1, keepdims=True)
    within = TIED * eps * (jnp.abs(now) + jnp.where(jnp.isfinite(least), least, 0))
    together = times <= least + within
    speed = jnp.max(jnp.where(together, closing, -jnp.inf), axis=-1)
    fastest = together & (closing == speed[:, None])
    best = jnp.min(jnp.where(fastest, names, count + model.walls - 1), axis=-1)
    chosen = fastest & (names == best[:, None])
    time = jnp.min(jnp.where(chosen, times, jnp.inf), axis=-1)
    second = jnp.min(jnp.where(chosen, jnp.inf, times), axis=-1)
    met = jnp.where(best < count, rows_of(state.count, jnp.minimum(best, count - 1)), 0)
    event = Events(now + time, best, met, speed, now + second)
    if state.cells is not None or any(model.periodic):
        early = jnp.minimum(horizon, leaves)
        sooner, reason = early < time, jnp.where(leaves <= horizon, LEAVES, AGAIN)
        before = Events(now + early, reason, met, jnp.full_like(speed, jnp.inf), event.time)
        event = jax.tree.map(lambda a, b: jnp.where(sooner, a, b), before, event)
    if state.coupling is not None:
        event = without_cluster(model, state.coupling, event, now)
    return event


class _OtherBodies(NamedTuple):
    """Contacts with other bodies, (M, C) each: `times` from now, closing speeds, and numbers."""

    times: Float[Array, "M C"]
    closing: Float[Array, "M C"]
    names: Int[Array, "M C"]


class _Those(NamedTuple):
    """The spheres that are searched `now`, up to `end`, with their positions and motions."""

    who: Int[Array, " M"]
    position: Float[Array, "M D"]
    velocity: Float[Array, "M D"]
    pull: Float[Array, "M D"]
    now: Number
    end: Number


def _of_walls(model: SceneArrays, state: RunState, those: _Those) -> _OtherBodies:
    """Return the contacts of spheres with walls on which they do not rest."""
    who, position, velocity, pull, now, end = those
    count, eps = model.spheres, jnp.finfo(model.dtype).eps
    height = jnp.sum(position[:, None] * model.normal[None], axis=-1)
    walls = model.walls_at(now)
    radius = rows_of(model.radius, who)[:, None]
    gap = height - walls.offset[None] - radius
    fall = jnp.sum(velocity[:, None] * model.normal[None], axis=-1)
    weight = jnp.sum(pull[:, None] * model.normal[None], axis=-1)
    noise = NOISE * eps * jnp.sqrt(jnp.sum(jnp.square(velocity), axis=-1))[:, None]
    motion = None if model.motion is None else model.motion.in_rows()
    if motion is not None:
        fall = fall - motion.speed
        noise = noise + NOISE * eps * motion.fastest(now, jnp.zeros_like(now))
    free = jnp.arange(model.walls)[None] != rows_of(state.support, who)[:, None]
    wall = wall_time(gap, fall, weight, noise)
    if any(model.vibrating):
        assert motion is not None
        shaking = jnp.asarray(model.vibrating)[None]
        left = jnp.maximum(end - now, 0)
        noise = jnp.broadcast_to(noise, gap.shape)
        size = jnp.max(jnp.abs(position), axis=-1)[:, None] + radius
        rounding = ROUNDINGS * eps * (size + jnp.zeros_like(gap))
        limits = (noise, rounding, motion, now, left)
        shaken = shaking_wall_time(gap, fall, weight, *limits, free & shaking)
        wall = jnp.where(shaking, shaken, wall)
    wall = jnp.where(free, wall, jnp.inf)
    if state.turning is not None:
        # A ball meets the wall on which it rests when it stops sliding.
        left = jnp.maximum(rows_of(state.turning.until, who) - now, 0)[:, None]
        wall = jnp.where(free, wall, left)
    reached = jnp.where(jnp.isfinite(wall), wall, 0)
    rises = fall + weight * reached
    if any(model.vibrating):
        assert motion is not None
        swing = motion.velocity(now + reached) - motion.speed
        rises = rises - jnp.where(jnp.asarray(model.vibrating)[None], swing, 0)
    names = jnp.arange(count, count + model.walls)[None]
    return _OtherBodies(wall, -rises, jnp.broadcast_to(names, wall.shape))


def _of_shaken(model: SceneArrays, those: _Those) -> tuple[_OtherBodies, Float[Array, " M"]]:
    """Return the contacts of spheres with shaken fixed ones, and a time limit for other images.
    Before that time no other image of these is met.
    """
    assert model.shaking is not None
    who, position, velocity, pull, now, end = those
    motion, eps = model.shaking.in_rows(), jnp.finfo(model.dtype).eps
    shaken = jnp.asarray(model.shaken)
    place, speed = model.shaken_at(now)
    shape = (who.shape[0], shaken.shape[0])
    apart = (position[:, None] - place[None]).reshape(-1, model.dimensions)
    apart = nearest_image(model, apart)[0].reshape(*shape, model.dimensions)
    rate, bend = (jnp.broadcast_to(x[:, None], apart.shape) for x in (velocity, pull))
    distance = rows_of(model.radius, who)[:, None] + model.radius[shaken][None]
    fast = jnp.sqrt(jnp.sum(jnp.square(velocity), axis=-1))[:, None]
    noise = NOISE * eps * (fast + motion.fastest(now, jnp.zeros_like(now)))
    moves = _moves(model, who)
    wanted = jnp.broadcast_to(moves[:, None], shape)
    left = jnp.maximum(end - now, 0)
    size = jnp.max(jnp.abs(position), axis=-1)[:, None] + jnp.max(jnp.abs(place), axis=-1)[None]
    given = (noise, ROUNDINGS * eps * (size + jnp.abs(distance)), motion, now, left)
    times = shaking_sphere_time(apart, rate, bend, distance, *given, wanted)
    reached = jnp.where(jnp.isfinite(times), times, 0)
    passed, (high, swings) = reached[..., None], motion.swing(now, reached)
    at, closes = apart + (rate + bend / 2 * passed) * passed - high, rate + bend * passed - swings
    closing = -jnp.sum(at * closes, axis=-1) / distance
    bound = jnp.full(who.shape, jnp.inf, model.dtype)
    rate = rate - speed[None]
    for axis in range(model.dimensions):
        if model.periodic[axis]:
            most = jnp.abs(bend[..., axis]) + motion.strongest
            given = (apart[..., axis], rate[..., axis], most, distance, model.period[axis])
            bound = jnp.minimum(bound, jnp.min(image_horizon(*given), axis=-1))
    names = jnp.broadcast_to(shaken[None], shape)
    return _OtherBodies(times, closing, names), jnp.where(moves, bound, jnp.inf)


def _moves(model: SceneArrays, who: Int[Array, " M"]) -> Bool[Array, " M"]:
    """Return which spheres are not fixed."""
    return rows_of(model.inverse_mass, who) > 0


def without_cluster(model: SceneArrays, coupling: Coupling, events: Events, now: Number) -> Events:
    """Return events without those that involve moving spheres of the coupled solve. Those spheres
    leave their flight paths. The others search again at the time of their second best event. A
    fixed sphere stays where it would be anyway.
    """
    slots = coupling.slots
    moves = model.inverse_mass[jnp.minimum(slots.who, model.spheres - 1)] > 0
    # An empty slot is no partner.
    who = jnp.where(slots.present & coupling.active & moves, slots.who, model.spheres)
    is_sphere = events.partner < model.spheres
    off = is_sphere & jnp.any(events.partner[:, None] == who[None], axis=1)
    later = now + simultaneous(model, now) + jnp.finfo(model.dtype).eps * coupling.pace
    return events._replace(
        time=jnp.where(off, jnp.maximum(events.second, later), events.time),
        partner=jnp.where(off, AGAIN, events.partner),
        speed=jnp.where(off, jnp.inf, events.speed),
    )


def in_cluster(layout: SceneLayout, coupling: Coupling) -> Bool[Array, " N"]:
    """Return which spheres are in the coupled solve."""
    nobody = jnp.zeros(layout.spheres, bool)
    return with_rows(nobody, index_of(layout, coupling.slots), coupling.slots.present)


def flight_at(
    model: SceneArrays, state: RunState, who: Int[Array, " M"] | None, now: Number
) -> tuple[Float[Array, "M D"], Float[Array, "M D"], Float[Array, "M D"]]:
    """Return current positions, velocities and accelerations of some spheres, or of all."""
    flying = jax.tree.map(lambda all: _of(all, who), state.flying)
    named = jnp.arange(model.spheres) if who is None else who
    there, pull = at_once(model, named, flying, _of(state.support, who), now)
    return there.position, there.velocity, pull


def _of(all: Array, who: Int[Array, "..."] | None) -> Array:
    """Return some rows of an array, or all of them without a copy."""
    return all if who is None else rows_of(all, who.reshape(-1))


def reset_events(
    model: SceneArrays,
    state: RunState,
    now: Number,
    grid: CellGrid | None,
    needed: Flag | None = None,
) -> RunState:
    """Return the state with new cells, or none, and all events out of date. Unless `needed`, the
    events are kept.
    """
    cells = None
    if grid is not None:
        cells = fill_cells(model, grid, flight_at(model, state, None, now)[0])
    events = stale_events(jnp.broadcast_to(now, (model.spheres,)))
    if needed is not None:
        events = jax.tree.map(lambda a, b: jnp.where(needed, a, b), events, state.events)
    return state._replace(cells=cells, events=events)


def stale_events(time: Float[Array, " M"]) -> Events:
    """Return events marked out of date, to be searched at given times."""
    far, none = jnp.full_like(time, jnp.inf), jnp.full(time.shape, OUT_OF_DATE, int)
    return Events(time, none, jnp.zeros_like(none), far, far)


class Due(NamedTuple):
    """The next event: its body, its partner, and whether it is an impact. `least` is the least of
    all times; `time` is that of the event, which may differ by rounding.
    """

    least: Number
    time: Number
    first: Index
    partner: Index
    fresh: Flag


def next_event(model: SceneArrays, events: Events, count: Int[Array, " N"]) -> Due:
    """Return the event of least time; of simultaneous ones that with the largest closing speed."""
    least = jnp.min(events.time)
    together = events.time <= least + simultaneous(model, least)
    # Two plain reductions are twice as fast as one that carries an index.
    speed = jnp.where(together, events.speed, -jnp.inf)
    everyone = jnp.arange(model.spheres)
    i = jnp.min(jnp.where(speed == jnp.max(speed), everyone, model.spheres - 1))
    time, partner, met = rows_of((events.time, events.partner, events.count), i)
    is_sphere = (partner >= 0) & (partner < model.spheres)
    is_current = rows_of(count, jnp.clip(partner, 0, model.spheres - 1)) == met
    fresh = (partner >= model.spheres) | (is_sphere & is_current)
    return Due(least, time, i, partner, fresh)


def update_events(
    model: SceneArrays, state: RunState, until: Number, end: Number
) -> tuple[RunState, Due]:
    """Search stale spheres again until the next event is an impact or is later than `until`. Events
    are searched only here. Two spheres are searched at a time, since both bodies of an impact are
    out of date; in small scenes one at a time.
    """

    def unfinished(carry: tuple[Events, Cells | None, Due]) -> Array:
        _, cells, due = carry
        stale = ~due.fresh & (due.least <= until)
        return stale if cells is None else stale & ~cells.full

    def again(carry: tuple[Events, Cells | None, Due]) -> tuple[Events, Cells | None, Due]:
        events, cells, due = carry
        here = state._replace(events=events, cells=cells)
        i, now = due.first, jnp.maximum(due.time, state.now)
        # Always true here; but reads in a branch precede all writes.
        wanted = due.least <= until
        if cells is not None:

            def stay(cells: Cells = cells) -> Shift:
                return staying(cells, i)

            def shift(cells: Cells = cells) -> Shift:
                place = flight_at(model, here, i[None], now)[0]
                return shift_of(model, cells, i, place, due.partner == LEAVES)

            # After an impact a sphere is where it was.
            cells = move_sphere(cells, i, jax.lax.cond(due.partner == OUT_OF_DATE, stay, shift))
            here = here._replace(cells=cells)
        who = rows = i[None]
        if model.spheres > _FEW:
            who, rows = _both(model, events, i, now)
        new = in_branch(wanted, lambda: find_next_events(model, here, who, now, end))
        events = with_one_or_two(events, rows, new)
        return events, cells, next_event(model, events, state.count)

    first = next_event(model, state.events, state.count)
    events, cells, due = jax.lax.while_loop(unfinished, again, (state.events, state.cells, first))
    return state._replace(events=events, cells=cells), due


_FEW = 8
"""The number of spheres up to which one is searched at a time. In a batch of small scenes each row
counts, and all runs wait for the one with most to search."""


def _both(
    layout: SceneLayout, events: Events, i: Index, now: Number
) -> tuple[Int[Array, "2"], Int[Array, "2"]]:
    """Return a sphere and another one that is out of date at the same time, and their rows. If
    there is no other one, its row does not exist.
    """
    everyone = jnp.arange(layout.spheres)
    marked = (events.partner == OUT_OF_DATE) & (events.time <= now) & (everyone != i)
    other = jnp.min(jnp.where(marked, everyone, layout.spheres))
    there = other < layout.spheres
    return jnp.stack([i, jnp.where(there, other, i)]), jnp.stack([i, other])


def in_branch(wanted: Flag, of: Callable[[], Any]) -> Any:
    """Return the result of a function if it is wanted, else zeros; it is traced once."""
    kinds: list[Any] = []

    def yes() -> Any:
        out = of()
        kinds[:] = [jax.eval_shape(lambda: out)]
        return out

    def no() -> Any:
        # JAX traces this branch after the other one.
        return jax.tree.map(lambda kind: jnp.zeros(kind.shape, kind.dtype), kinds[0])

    return jax.lax.cond(wanted, yes, no)
