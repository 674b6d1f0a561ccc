"""The search: which impact comes next, one stored event a body, fixed shapes.

Each sphere stores the time and the partner of its next event, and how many impacts the partner had
had when it was found. The least time is taken; if the partner has met something else since, the
event is out of date and only searched again. Otherwise both bodies are moved to the impact, and
their two rows are searched anew, among all bodies. Of every pair the one that was searched last
knows the impact, so that none is missed, and there is no table of pairs.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ._hit import Choice, Flying, Outcome, accelerations, hit
from ._log import Facts, Figures, Log
from ._system import Layout, Numbers, nearest_image
from ._touch import curved_time, image_horizon, sphere_time, wall_time

NOISE = 16
"""Roundings of a speed below which bodies that touch neither close nor part."""

TIED = 64
"""Roundings of a time within which two events are simultaneous."""

PATIENCE = 64
"""Impacts per body without progress in time after which a run stops."""

SLOW = 2.0**14
"""Roundings of the largest speed below which closing speeds of simultaneous impacts have died out:
the impacts have accumulated."""

RUNNING, ACCUMULATED, TWO_SUPPORTS = 0, 1, 2


class Events(NamedTuple):
    """The stored events, (N,) each: `time`, `partner` (-1: only search again), the partner's count
    of impacts then, the closing `speed`, and the time of the `second` best event.
    """

    time: Float[Array, " N"]
    partner: Int[Array, " N"]
    count: Int[Array, " N"]
    speed: Float[Array, " N"]
    second: Float[Array, " N"]


class State(NamedTuple):
    """The spheres, each at its own time, and their events."""

    position: Float[Array, "N D"]
    velocity: Float[Array, "N D"]
    time: Float[Array, " N"]
    support: Int[Array, " N"]
    count: Int[Array, " N"]
    events: Events
    now: Float[Array, ""]
    idle: Int[Array, ""]
    status: Int[Array, ""]


def begun(layout: Layout, numbers: Numbers, end: Float[Array, ""]) -> State:
    """The start: all spheres at time zero, their first events found one row after the other."""
    count = layout.spheres
    zero = jnp.zeros(count, numbers.dtype)
    whole = jnp.zeros(count, int)
    none = whole - 1
    start = jnp.zeros((), numbers.dtype)
    state = State(
        numbers.position, numbers.velocity, zero, none, whole,
        Events(zero, none, whole, zero, zero), start, jnp.zeros((), int), jnp.zeros((), int),
    )  # fmt: skip

    def row(i: Int[Array, ""]) -> Events:
        return jax.tree.map(lambda x: x[0], _searched(layout, numbers, state, i[None], start, end))

    return state._replace(events=jax.lax.map(row, jnp.arange(count)))


def advance(
    layout: Layout,
    numbers: Numbers,
    state: State,
    log: Log,
    end: Float[Array, ""],
    tolerance: Float[Array, ""],
) -> tuple[State, Log, Int[Array, ""]]:
    """Impacts up to `end` (inclusive), until the log is full or the run is stuck.

    Returns how many rows were written.
    """
    rows = log.facts.tied.shape[0]

    def unfinished(carry: tuple[State, Log, Array]) -> Array:
        state, _, written = carry
        within = jnp.min(state.events.time) <= end
        return within & (written < rows) & (state.status == RUNNING)

    def step(carry: tuple[State, Log, Array]) -> tuple[State, Log, Array]:
        state, log, written = carry
        state, figures, facts, fresh = _event(layout, numbers, state, end, tolerance)
        log = jax.tree.map(lambda all, one: all.at[written].set(one), log, Log(figures, facts))
        return state, log, written + fresh.astype(written.dtype)

    return jax.lax.while_loop(unfinished, step, (state, log, jnp.zeros((), int)))


def _event(
    layout: Layout,
    numbers: Numbers,
    state: State,
    end: Float[Array, ""],
    tolerance: Float[Array, ""],
) -> tuple[State, Figures, Facts, Bool[Array, ""]]:
    """The next event, and whether it was an impact."""
    count, events = layout.spheres, state.events
    least = jnp.min(events.time)
    simultaneous = _simultaneous(numbers, least)
    i = jnp.argmax(jnp.where(events.time <= least + simultaneous, events.speed, -jnp.inf))
    now = jnp.maximum(events.time[i], state.now)
    partner = events.partner[i]
    j = jnp.clip(partner, 0, count - 1)
    is_sphere = (partner >= 0) & (partner < count)
    fresh = (partner >= count) | (is_sphere & (state.count[j] == events.count[i]))
    # A wall has no row: the first body stands in for it.
    j = jnp.where(is_sphere, j, i)
    who = jnp.stack([i, j])

    before = Flying(state.position[who], state.velocity[who], state.time[who])
    choice = _choice(layout, numbers, state, who, jnp.maximum(partner, 0), before, now, tolerance)
    still = jax.eval_shape(lambda: hit(layout, numbers, before, choice))
    still = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), still)
    outcome = jax.lax.cond(fresh, lambda: hit(layout, numbers, before, choice), lambda: still)
    support, crowded = _supports(layout, numbers, choice, outcome)

    competing = jnp.where(events.partner[j] == i, events.second[j], events.time[j])
    rival = jnp.minimum(events.second[i], jnp.where(is_sphere, competing, jnp.inf)) - now
    since = jnp.where(state.count[who] > 0, now - state.time[who], jnp.inf)
    rival = jnp.minimum(rival, jnp.min(since))
    tied = rival <= simultaneous

    def put(all: Array, new: Array) -> Array:
        old = all[who]
        keep = jnp.stack([fresh, fresh & is_sphere]).reshape((2,) + (1,) * (old.ndim - 1))
        new = jnp.where(keep, new, old)
        # The second first: where it stands for a wall it is the first body again.
        return all.at[j].set(new[1]).at[i].set(new[0])

    idle = jnp.where(now > state.now + simultaneous, 0, state.idle + 1)
    patience = PATIENCE * (layout.spheres + layout.walls)
    fastest = jnp.max(jnp.sqrt(jnp.sum(jnp.square(state.velocity), axis=-1)))
    slow = outcome.closing <= SLOW * jnp.finfo(numbers.dtype).eps * fastest
    died = slow & (rival <= simultaneous) & ~choice.tail
    stuck = jnp.where(died | (idle > patience), ACCUMULATED, RUNNING)
    status = jnp.where(fresh & crowded, TWO_SUPPORTS, stuck)
    state = state._replace(
        position=put(state.position, outcome.after.position),
        velocity=put(state.velocity, outcome.after.velocity),
        time=put(state.time, outcome.after.time),
        support=put(state.support, support),
        count=put(state.count, state.count[who] + 1),
        now=jnp.where(fresh, now, state.now),
        idle=jnp.where(fresh, idle, state.idle),
        status=jnp.where(fresh, status, state.status),
    )
    found = _searched(layout, numbers, state, who, now, end)
    state = state._replace(
        events=jax.tree.map(lambda all, new: all.at[who].set(new), events, found)
    )
    return state, Figures(before, outcome), Facts(choice, support, tied, rival), fresh


def _simultaneous(numbers: Numbers, time: Float[Array, ""]) -> Float[Array, ""]:
    finite = jnp.where(jnp.isfinite(time), jnp.abs(time), 0)
    return TIED * jnp.finfo(numbers.dtype).eps * finite


def _choice(
    layout: Layout,
    numbers: Numbers,
    state: State,
    who: Int[Array, "2"],
    partner: Int[Array, ""],
    before: Flying,
    now: Float[Array, ""],
    tolerance: Float[Array, ""],
) -> Choice:
    """The decisions about an impact: its image, and whether a ball comes to rest on a wall.

    A ball on a wall that gravity presses it to, with a constant e < 1, bounces for ever in a finite
    time. Where the next bounce is lower than `tolerance` radii its time is summed.
    """
    support = state.support[who]
    pull = accelerations(layout, numbers, who, support)
    passed = (now - before.time)[:, None]
    velocity = before.velocity + pull * passed
    position = before.position + (before.velocity + velocity) / 2 * passed
    image = nearest_image(layout, numbers, (position[0] - position[1])[None])[1][0]
    tail = jnp.asarray(False)
    if layout.walls and layout.gravity and any(layout.constant):
        face = numbers.normal[jnp.clip(partner - layout.spheres, 0)]
        weight = -jnp.sum(face * numbers.gravity)
        closing = jnp.maximum(-jnp.sum(face * velocity[0]), 0)
        law = layout.chosen(layout.laws, who[0], partner) if layout.laws else 0
        e = numbers.restitution[law]
        low = jnp.square(e * closing) <= 2 * weight * tolerance * numbers.radius[who[0]]
        rests = (weight > 0) & (e < 1) & low & jnp.asarray(layout.constant)[law]
        tail = (partner >= layout.spheres) & rests
    image = jnp.where(partner < layout.spheres, image, 0)
    return Choice(who[0], partner, support, image, now, tail)


def _supports(
    layout: Layout, numbers: Numbers, choice: Choice, outcome: Outcome
) -> tuple[Int[Array, "2"], Bool[Array, ""]]:
    """The walls that the two bodies rest on after the impact, and whether one needs two walls."""
    support = choice.support
    if not layout.walls:
        return support, jnp.asarray(False)
    velocity = outcome.after.velocity
    normal = numbers.normal[jnp.maximum(support, 0)]
    leaving = jnp.abs(jnp.sum(velocity * normal, axis=-1))
    speed = jnp.sqrt(jnp.sum(jnp.square(velocity), axis=-1)) + outcome.closing
    kept = (support >= 0) & (leaving <= NOISE * jnp.finfo(numbers.dtype).eps * speed)
    support = jnp.where(kept, support, -1)
    wall = choice.second - layout.spheres
    crowded = choice.tail & kept[0] & (support[0] != wall)
    first = jnp.where(choice.tail, wall, support[0])
    return jnp.stack([first, support[1]]), crowded


def _searched(
    layout: Layout,
    numbers: Numbers,
    state: State,
    who: Int[Array, " M"],
    now: Float[Array, ""],
    end: Float[Array, ""],
) -> Events:
    """The next events of some spheres, searched among all bodies."""
    count, eps = layout.spheres, jnp.finfo(numbers.dtype).eps
    passed = (now - state.time)[:, None]
    velocity, position = state.velocity, state.position
    pull = jnp.zeros_like(velocity)
    if layout.gravity:
        pull = accelerations(layout, numbers, jnp.arange(count), state.support)
        velocity = velocity + pull * passed
    position = position + (state.velocity + velocity) / 2 * passed
    moves = numbers.inverse_mass[:count] > 0
    speeds = jnp.sqrt(jnp.sum(jnp.square(velocity), axis=-1))

    apart = (position[who][:, None] - position[None]).reshape(-1, layout.dimensions)
    apart = nearest_image(layout, numbers, apart)[0].reshape(-1, count, layout.dimensions)
    rate = velocity[who][:, None] - velocity[None]
    bend = pull[who][:, None] - pull[None]
    distance = numbers.radius[who][:, None] + numbers.radius[None]
    noise = NOISE * eps * (speeds[who][:, None] + speeds[None])
    straight = sphere_time(apart, rate, distance, noise)
    if layout.gravity and (layout.walls or any(layout.fixed)):
        bent = jnp.any(bend != 0, axis=-1)
        horizon = jnp.maximum(end - now, 0)

        def curved() -> Array:
            return curved_time(apart, rate, bend, distance, noise, horizon)

        times = jnp.where(bent, jax.lax.cond(jnp.any(bent), curved, lambda: straight), straight)
    else:
        times = straight
    other = (jnp.arange(count)[None] != who[:, None]) & (moves[None] | moves[who][:, None])
    times = jnp.where(other, times, jnp.inf)
    reached = jnp.where(jnp.isfinite(times), times, 0)[..., None]
    at = apart + (rate + bend / 2 * reached) * reached
    closing = -jnp.sum(at * (rate + bend * reached), axis=-1) / distance

    horizon = jnp.full(who.shape, jnp.inf, numbers.dtype)
    for axis in range(layout.dimensions):
        if layout.periodic[axis]:
            bound = image_horizon(
                apart[..., axis], rate[..., axis], bend[..., axis], distance, numbers.period[axis]
            )
            horizon = jnp.minimum(horizon, jnp.min(jnp.where(other, bound, jnp.inf), axis=-1))

    if layout.walls:
        height = jnp.sum(position[who][:, None] * numbers.normal[None], axis=-1)
        gap = height - numbers.offset[None] - numbers.radius[who][:, None]
        fall = jnp.sum(velocity[who][:, None] * numbers.normal[None], axis=-1)
        weight = jnp.sum(pull[who][:, None] * numbers.normal[None], axis=-1)
        wall = wall_time(gap, fall, weight, NOISE * eps * speeds[who][:, None])
        resting = jnp.arange(layout.walls)[None] == state.support[who][:, None]
        wall = jnp.where(resting | ~moves[who][:, None], jnp.inf, wall)
        reached = jnp.where(jnp.isfinite(wall), wall, 0)
        times = jnp.concatenate([times, wall], axis=-1)
        closing = jnp.concatenate([closing, -(fall + weight * reached)], axis=-1)
    # A fixed sphere is found by those that move.
    times = jnp.where(moves[who][:, None], times, jnp.inf)

    least = jnp.min(times, axis=-1, keepdims=True)
    simultaneous = TIED * eps * (jnp.abs(now) + jnp.where(jnp.isfinite(least), least, 0))
    together = times <= least + simultaneous
    best = jnp.argmax(jnp.where(together, closing, -jnp.inf), axis=-1)
    everyone = jnp.arange(times.shape[-1])[None]
    second = jnp.min(jnp.where(everyone == best[:, None], jnp.inf, times), axis=-1)
    time = jnp.take_along_axis(times, best[:, None], axis=-1)[:, 0]
    speed = jnp.take_along_axis(closing, best[:, None], axis=-1)[:, 0]
    early = horizon < time
    sphere = jnp.minimum(best, count - 1)
    return Events(
        time=now + jnp.minimum(time, horizon),
        partner=jnp.where(early, -1, best),
        count=jnp.where(best < count, state.count[sphere], 0),
        speed=jnp.where(early, jnp.inf, speed),
        second=now + second,
    )
