"""The state of all spheres at any time, read from the log of a run."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ._cluster import cluster, touched
from ._coupled import as_flags, call, places, stored_energy
from ._hit import accelerations, meeting_of
from ._log import Log
from ._progress import Rules
from ._stored import stored_in
from ._system import Layout, Numbers, known_contact_of, law_of
from ._touching import Pairs


class States(NamedTuple):
    """Positions and velocities (T, N, D), and the elastic energy `stored` in contacts (T,)."""

    position: Float[Array, "T N D"]
    velocity: Float[Array, "T N D"]
    stored: Float[Array, " T"]


class _Entries(NamedTuple):
    """Of every sphere at some times: what it last did, (T, N); `row` of the log, or -1."""

    position: Array
    velocity: Array
    began: Array
    support: Array
    row: Array


def states_at(
    layout: Layout,
    numbers: Numbers,
    rules: Rules,
    log: Log,
    written: Int[Array, ""],
    times: Float[Array, " T"],
    tolerance: Float[Array, ""],
    inside: bool,
) -> States:
    """The states at some times; at an impact out of time those after it.

    Of every sphere the last impact up to that time is looked up, by halving, in a list that is
    sorted by sphere and time: no table of times, spheres and impacts. Inside of a contact its
    motion is solved from the touch, unless `inside` says that no time is.
    """
    found = _looked_up(layout, numbers, log, written, times)
    count, dimensions = layout.spheres, layout.dimensions
    who = jnp.tile(jnp.arange(count), times.shape[0])
    pull = accelerations(layout, numbers, who, found.support.reshape(-1))
    since = (times[:, None] - found.began)[..., None]
    pull = pull.reshape(times.shape[0], count, dimensions)
    velocity = found.velocity + pull * since
    position = found.position + (found.velocity + velocity) / 2 * since
    stored = jnp.zeros_like(times)
    if not rules.soft or not (inside or rules.coupled):
        return States(position, velocity, stored)
    if not inside:
        return States(position, velocity, _at_rest(layout, numbers, log, written, times))
    position, velocity, stored = _in_pairs(
        layout, numbers, rules, log, times, tolerance, found, position, velocity
    )
    if rules.coupled:
        return _in_calls(
            layout, numbers, rules, log, written, times, tolerance, position, velocity, stored
        )
    return States(position, velocity, stored)


def any_inside(
    layout: Layout, numbers: Numbers, log: Log, written: Int[Array, ""], times: Float[Array, " T"]
) -> Bool[Array, ""]:
    """Whether any of the times lies inside of a contact."""
    found = _looked_up(layout, numbers, log, written, times)
    inside = jnp.any((times[:, None] < found.began) & (found.row >= 0))
    if log.facts.call is None or log.figures.coupled is None:
        return inside
    row, last = _last_call(log, written, times)
    end, ends = log.figures.coupled.end.time[row], log.facts.call.ends[row]
    return inside | jnp.any(last & ((times < end) | ~ends))


def _last_call(
    log: Log, written: Int[Array, ""], times: Float[Array, " T"]
) -> tuple[Int[Array, " T"], Bool[Array, " T"]]:
    """The last call that began up to each time, and whether there is one."""
    called, together = log.facts.call, log.figures.coupled
    assert called is not None and together is not None
    number = jnp.arange(called.is_call.shape[0])
    is_call = called.is_call & (number < written)
    began = jnp.where(is_call, together.began.time, jnp.inf)
    earlier = began[None] <= times[:, None]
    # Of calls that began at the same time, the last one.
    row = jnp.max(jnp.where(earlier, number[None], -1), axis=1)
    return jnp.maximum(row, 0), row >= 0


def _at_rest(
    layout: Layout, numbers: Numbers, log: Log, written: Int[Array, ""], times: Float[Array, " T"]
) -> Float[Array, " T"]:
    """The energy that is stored in contacts at rest, at times outside of all others."""
    called, together = log.facts.call, log.figures.coupled
    assert called is not None and together is not None
    row, last = _last_call(log, written, times)
    stored = jax.vmap(lambda state: stored_energy(layout, numbers, as_flags(state)))
    return jnp.where(last & called.rest[row], stored(together.end)[row], 0)


def _looked_up(
    layout: Layout, numbers: Numbers, log: Log, written: Int[Array, ""], times: Float[Array, " T"]
) -> _Entries:
    count, rows = layout.spheres, log.facts.tied.shape[0]
    figures, facts = log
    number = jnp.arange(1, rows + 1)
    blank = number > written
    is_call = jnp.zeros(rows, bool) if facts.call is None else facts.call.is_call
    first = jnp.where(blank | is_call, count, facts.choice.first)
    second = jnp.where(blank | is_call, count, jnp.minimum(facts.choice.second, count))
    start, none = jnp.zeros(count, numbers.dtype), jnp.full(count, -1)
    after = figures.outcome.after
    bodies = [jnp.arange(count), first, second]
    numbered = [jnp.zeros(count, int), number, number]
    place = [numbers.position, after.position[:, 0], after.position[:, 1]]
    speed = [numbers.velocity, after.velocity[:, 0], after.velocity[:, 1]]
    began = [start, after.time[:, 0], after.time[:, 1]]
    support = [none, facts.support[:, 0], facts.support[:, 1]]
    pairs = [none, number - 1, number - 1]
    if facts.call is not None and figures.coupled is not None:
        end = figures.coupled.end
        resting = _resting(layout, log)
        for k in range(count):
            counts = is_call & ~blank & facts.call.ends & facts.call.decided.members[:, k]
            bodies.append(jnp.where(counts, k, count))
            numbered.append(number)
            place.append(end.position[:, k])
            speed.append(end.velocity[:, k])
            began.append(end.time)
            support.append(resting[:, k])
            pairs.append(jnp.full(rows, -1))
    keys = jnp.concatenate(bodies) * (rows + 1) + jnp.concatenate(numbered)
    order = jnp.argsort(keys)
    happened = jnp.where(blank, jnp.inf, figures.outcome.time)
    passed = jnp.searchsorted(happened, times, side="right").astype(int)
    wanted = jnp.arange(count)[None] * (rows + 1) + passed[:, None]
    found = jnp.searchsorted(keys[order], wanted.reshape(-1), side="right") - 1
    entry = order[found].reshape(wanted.shape)
    return _Entries(
        *(jnp.concatenate(column)[entry] for column in (place, speed, began, support, pairs))
    )


def _resting(layout: Layout, log: Log) -> Int[Array, "K N"]:
    """The walls that spheres rest on after a call, -1 where there are none."""
    called, together = log.facts.call, log.figures.coupled
    assert called is not None and together is not None
    first, second = places(layout)
    wall = second - layout.spheres
    closed = (together.end.closed > 0.5) & called.rest[:, None] & jnp.asarray(wall >= 0)[None]
    none = jnp.full((closed.shape[0], layout.spheres), -1)
    return none.at[:, first].max(jnp.where(closed, jnp.asarray(wall)[None], -1))


def _in_pairs(
    layout: Layout,
    numbers: Numbers,
    rules: Rules,
    log: Log,
    times: Float[Array, " T"],
    tolerance: Float[Array, ""],
    found: _Entries,
    position: Array,
    velocity: Array,
) -> tuple[Array, Array, Array]:
    """Spheres in isolated impacts where they are inside of them, and the energy stored there."""
    count = layout.spheres

    def one(given: tuple[Array, ...]) -> tuple[Array, Array, Array]:
        row, who, time, inside, place, speed = given

        def solved() -> tuple[Array, Array, Array]:
            known, choice = log.figures.before, log.facts.choice
            before, choice = jax.tree.map(lambda x: x[row], (known, choice))
            meeting = meeting_of(layout, numbers, before, choice)
            is_wall = choice.second >= count
            second = jnp.minimum(choice.second, count - 1)
            pair = jnp.stack([choice.first, second])
            pull = accelerations(layout, numbers, pair, choice.support)
            image = choice.image * numbers.period
            flying = meeting.flying
            reach = numbers.radius[choice.first] + jnp.where(is_wall, 0, numbers.radius[second])
            foot = flying.position[0] - reach * meeting.normal
            other = jnp.where(is_wall, foot, flying.position[1] + image)
            places = jnp.stack([flying.position[0], other])
            still = jnp.where(is_wall, meeting.driven * meeting.normal, flying.velocity[1])
            speeds = jnp.stack([flying.velocity[0], still])
            pairs = Pairs(
                jnp.asarray([0]), jnp.asarray([1]), reach[None], meeting.normal[None],
                is_wall[None], jnp.asarray([True]),
            )  # fmt: skip
            start = touched(pairs, places, speeds, jnp.asarray([True]), v0=rules.v0)
            start = start._replace(indentation=jnp.zeros_like(start.indentation))
            mass = numbers.inverse_mass
            inverse = jnp.stack([mass[choice.first], mass[choice.second]])
            bend = jnp.stack([pull[0], jnp.where(is_wall, 0, pull[1])])
            contact = known_contact_of(layout, numbers, choice.first, choice.second)
            law = law_of(layout, numbers, choice.first, choice.second)
            state = cluster(
                law, contact, pairs, inverse, bend, start, time - meeting.time,
                rtol=tolerance, v0=rules.v0,
            ).state  # fmt: skip
            late = time - meeting.time - state.time
            first = who == choice.first
            k = jnp.where(first, 0, 1)
            at = state.position[k] + state.velocity[k] * late - jnp.where(first, 0, image)
            depth = jnp.where(state.closed[0], state.indentation[0], 0)
            stored = stored_in(law, contact, depth, state.latched[0])
            # Each body of a pair counts its half; a wall counts none.
            return at, state.velocity[k], stored * jnp.where(is_wall, 1, 0.5)

        return jax.lax.cond(inside, solved, lambda: (place, speed, jnp.zeros_like(time)))

    inside = (times[:, None] < found.began) & (found.row >= 0)
    flat = (-1, layout.dimensions)
    given = (
        jnp.maximum(found.row, 0).reshape(-1),
        jnp.tile(jnp.arange(count), times.shape[0]),
        jnp.repeat(times, count),
        inside.reshape(-1),
        position.reshape(flat),
        velocity.reshape(flat),
    )
    place, speed, stored = jax.lax.map(one, given)
    shape = position.shape
    return place.reshape(shape), speed.reshape(shape), jnp.sum(stored.reshape(shape[:2]), axis=1)


def _in_calls(
    layout: Layout,
    numbers: Numbers,
    rules: Rules,
    log: Log,
    written: Int[Array, ""],
    times: Float[Array, " T"],
    tolerance: Float[Array, ""],
    position: Array,
    velocity: Array,
    stored: Array,
) -> States:
    """All spheres of a coupled solve where the time is inside of it, and at rest on walls."""
    count = layout.spheres
    called, together = log.facts.call, log.figures.coupled
    assert called is not None and together is not None
    rows, lasts = _last_call(log, written, times)

    def one(given: tuple[Array, ...]) -> tuple[Array, Array, Array]:
        time, row, last, place, speed, energy = given
        known, facts = jax.tree.map(lambda x: x[row], (together, called))
        inside = last & ((time < known.end.time) | ~facts.ends)

        def solved() -> tuple[Array, Array, Array]:
            decided = facts.decided._replace(
                starts=jnp.asarray(False),
                joins=jnp.zeros(count, bool),
                until_body=jnp.asarray(-1),
                until=time,
            )
            state = call(
                layout, numbers, known.spheres, facts.support, known.held, as_flags(known.began),
                decided, tolerance, rules.v0,
            )[1].state  # fmt: skip
            members = facts.decided.members[:, None]
            late = time - state.time
            at = state.position[:count] + state.velocity[:count] * late
            return (
                jnp.where(members, at, place),
                jnp.where(members, state.velocity[:count], speed),
                energy + stored_energy(layout, numbers, state),
            )

        def flying() -> tuple[Array, Array, Array]:
            resting = last & facts.rest
            held = stored_energy(layout, numbers, as_flags(known.end))
            return place, speed, energy + jnp.where(resting, held, 0)

        return jax.lax.cond(inside, solved, flying)

    return States(*jax.lax.map(one, (times, rows, lasts, position, velocity, stored)))


def energy_of(
    layout: Layout,
    numbers: Numbers,
    position: Float[Array, "T N D"],
    velocity: Float[Array, "T N D"],
) -> Float[Array, " T"]:
    """Kinetic energy and weight of all free spheres, ½ m v² - m g·x, in J."""
    inverse = numbers.inverse_mass[: layout.spheres]
    free = inverse > 0
    mass = jnp.where(free, 1 / jnp.where(free, inverse, 1), 0)
    kinetic = jnp.sum(jnp.square(velocity), axis=-1) / 2
    weight = jnp.sum(position * numbers.gravity[None, None], axis=-1)
    return jnp.sum(mass[None] * (kinetic - weight), axis=-1)
