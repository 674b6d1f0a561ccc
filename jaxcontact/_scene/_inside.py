"""The states of spheres that are in contact, solved from their touch."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ._cluster import cluster, touched
from ._coupled import Call, as_flags, blank_state, call, meets, stored_energy
from ._flying import Flying, accelerations
from ._hit import Choice, meeting_of
from ._log import Log, last_call
from ._progress import Rules
from ._rows import rows_of
from ._slots import Seats, empty_seats, everyone, in_line, index_of, joining, put, unchanged
from ._stored import stored_in
from ._system import Layout, Numbers, known_contact_of, law_of
from ._touching import Pairs


class States(NamedTuple):
    """Positions and velocities (T, N, D), and the elastic energy `stored` in contacts (T,)."""

    position: Float[Array, "T N D"]
    velocity: Float[Array, "T N D"]
    stored: Float[Array, " T"]


class Entries(NamedTuple):
    """Of every sphere at some times: what it last did, (T, N); `row` of the log, or -1; the v0
    `held` by one that rests.

    A sphere that is inside of an isolated impact has not `began` yet.
    """

    position: Array
    velocity: Array
    began: Array
    support: Array
    row: Array
    held: Array


def in_contacts(
    layout: Layout,
    numbers: Numbers,
    rules: Rules,
    log: Log,
    times: Float[Array, " T"],
    tolerance: Float[Array, ""],
    found: Entries,
    here: States,
    written: Int[Array, ""],
) -> States:
    """The states with those of spheres in isolated impacts and in coupled solves.

    All are calls of the coupled solve, so that it is compiled once: N lanes a time for the isolated
    impacts, each by its first body, and one for the solve in progress.
    """
    count, members = layout.spheres, rules.members
    called, together = log.facts.call, log.figures.coupled
    assert called is not None and together is not None
    rows, lasts = last_call(log, written, times)
    nobody, none = jnp.zeros(count, bool), jnp.full(members, -1)
    yes = jnp.asarray(True)

    def pair(row: Array, who: Array, until: Array) -> tuple[tuple, Array]:
        """The isolated impact of a row, as a call; whether `who` is its first body."""
        choice, before = jax.tree.map(lambda x: x[row], (log.facts.choice, log.figures.before))
        seats = _seats_of_two(layout, numbers, members, choice, before)
        is_first, is_second = seats.who == choice.first, seats.who == choice.second

        def seated(pair: Array) -> Array:
            shape = (members,) + (1,) * (pair.ndim - 1)
            one, other = is_first.reshape(shape), is_second.reshape(shape)
            return jnp.where(one, pair[:1], jnp.where(other, pair[1:], jnp.zeros_like(pair[:1])))

        change = joining(layout, members, seats.present)
        closed = meets(layout, members, seats, choice)
        decided = Call(yes, choice, seats, change, closed, until, ~yes)
        spheres = jax.tree.map(seated, before)
        blank = blank_state(layout, members, numbers.dtype)
        held = jnp.zeros(members, numbers.dtype)
        return (spheres, none, held, blank, decided), who == choice.first

    def going_on(row: Array, until: Array) -> tuple[tuple, Array]:
        """The call of a row, up to a time; whether it lasts until then."""
        rows = (together, called, log.facts.choice)
        known, facts, choice = jax.tree.map(lambda x: x[row], rows)
        change = unchanged(layout, members)
        decided = facts.decided._replace(starts=~yes, choice=choice, change=change, until=until)
        inside = (until < known.end.time) | ~facts.ends
        began = as_flags(known.began)
        return (known.spheres, facts.support, known.held, began, decided), inside

    def lane(given: tuple[Array, ...]) -> tuple[Array, Array, Array, Array]:
        time, who, row, inside, call_row, last = given
        is_call = who == count
        alone, is_first = pair(row, who, time)
        coupled, goes_on = going_on(call_row, time)
        chosen = jax.tree.map(lambda a, b: jnp.where(is_call, a, b), coupled, alone)
        active = jnp.where(is_call, last & goes_on, inside & is_first)
        spheres, support, held, before, decided = chosen
        away = jnp.zeros((count, layout.dimensions), numbers.dtype)

        def solved() -> tuple[Array, Array, Array, Array]:
            seats = decided.seats
            state = call(
                layout, numbers, members, spheres, support, held, before, decided.where(active),
                tolerance, rules.v0,
            )[1].state  # fmt: skip
            late = time - state.time
            index = index_of(layout, seats)
            velocity = state.velocity[:members]
            place = state.position[:members] + seats.shift * numbers.period[None] + velocity * late
            return (
                put(nobody, index, seats.present),
                put(away, index, place),
                put(away, index, velocity),
                stored_energy(layout, numbers, members, seats, state),
            )

        def flying() -> tuple[Array, Array, Array, Array]:
            return nobody, away, away, jnp.zeros((), numbers.dtype)

        return jax.lax.cond(active, solved, flying)

    total = times.shape[0]

    def lanes(each: Array, of_call: Array) -> Array:
        return jnp.concatenate([each, of_call[:, None]], axis=1).reshape(-1)

    inside = (times[:, None] < found.began) & (found.row >= 0)
    blank = jnp.zeros((total, count), int)
    given = (
        jnp.repeat(times, count + 1),
        jnp.tile(jnp.arange(count + 1), total),
        lanes(jnp.maximum(found.row, 0), blank[:, 0]),
        lanes(inside, jnp.zeros(total, bool)),
        lanes(blank, rows),
        lanes(jnp.zeros((total, count), bool), lasts),
    )
    who, place, speed, stored = jax.tree.map(
        lambda x: x.reshape(total, count + 1, *x.shape[1:]), jax.lax.map(lane, given)
    )

    def merged(old: Array, new: Array) -> Array:
        known = who[..., None]
        return jnp.where(jnp.any(known, axis=1), jnp.sum(jnp.where(known, new, 0), axis=1), old)

    return States(
        merged(here.position, place),
        merged(here.velocity, speed),
        jnp.sum(stored, axis=1)
        + at_rest(layout, numbers, found, here, times, jnp.any(who, axis=1)),
    )


def stored_at_ends(
    layout: Layout,
    numbers: Numbers,
    rules: Rules,
    log: Log,
    times: Float[Array, " T"],
    written: Int[Array, ""],
) -> Float[Array, " T"]:
    """The energy stored in contacts that go on at the times at which a call of theirs ended."""
    rows, lasts = last_call(log, written, times)
    called, together = log.facts.call, log.figures.coupled
    assert called is not None and together is not None

    def one(given: tuple[Array, Array, Array]) -> Array:
        time, row, last = given
        end, seats, ends = rows_of((together.end, called.decided.seats, called.ends), row)
        stored = stored_energy(layout, numbers, rules.members, seats, as_flags(end))
        return jnp.where(last & ~ends & (time == end.time), stored, 0)

    return jax.lax.map(one, (times, rows, lasts))


def at_rest(
    layout: Layout,
    numbers: Numbers,
    found: Entries,
    here: States,
    times: Float[Array, " T"],
    elsewhere: Array,
) -> Float[Array, " T"]:
    """The energy stored in the contacts of spheres that rest on walls, (T,), but for those that
    are `elsewhere` (T, N).
    """
    if not layout.walls:
        return jnp.zeros(found.row.shape[0], numbers.dtype)

    def one(i: Array, support: Array, place: Array, time: Array) -> Array:
        wall = jnp.maximum(support, 0)
        height = jnp.sum(place * numbers.normal[wall]) - numbers.walls_at(time, wall).offset
        contact = known_contact_of(layout, numbers, i, layout.spheres + wall)
        law = law_of(layout, numbers, i, layout.spheres + wall)
        depth = jnp.where(support >= 0, numbers.radius[i] - height, 0)
        return stored_in(law, contact, depth, jnp.ones_like(depth))

    rests = jnp.where(elsewhere, -1, found.support)
    everyone = jnp.arange(layout.spheres)
    each = jax.vmap(jax.vmap(one, in_axes=(0, 0, 0, None)), in_axes=(None, 0, 0, 0))(
        everyone, rests, here.position, times
    )
    return jnp.sum(each, axis=1)


def _seats_of_two(
    layout: Layout, numbers: Numbers, members: int, choice: Choice, before: Flying
) -> Seats:
    """The places of the bodies of an isolated impact; the second may be a wall."""
    blank = empty_seats(layout, numbers, members)
    if everyone(layout, members):
        present = (blank.who == choice.first) | (blank.who == choice.second)
        return blank._replace(present=present)
    count = layout.spheres
    second = jnp.where(choice.second < count, choice.second, count)
    image = -choice.image
    two, shift = jnp.stack([choice.first, second]), jnp.stack([jnp.zeros_like(image), image])
    if in_line(layout):
        # Neighbours in the order of the line.
        places = before.position - shift * numbers.period[None]
        turned = (places[1, 0] < places[0, 0]) & (second < count)
        two, shift = (jnp.where(turned, x[::-1], x) for x in (two, shift))
    rest = members - 2
    who = jnp.concatenate([two, jnp.full(max(rest, 0), count)])[:members]
    shift = jnp.concatenate([shift, jnp.zeros((max(rest, 0), layout.dimensions), numbers.dtype)])
    return Seats(who, who < count, shift[:members])


def in_pairs(
    layout: Layout,
    numbers: Numbers,
    rules: Rules,
    log: Log,
    times: Float[Array, " T"],
    tolerance: Float[Array, ""],
    found: Entries,
    here: States,
) -> States:
    """As `in_contacts` where no solve is coupled: each sphere by the two bodies of its impact."""
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
            start = touched(pairs, places, speeds, inside[None], v0=rules.v0)
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
        here.position.reshape(flat),
        here.velocity.reshape(flat),
    )
    place, speed, stored = jax.lax.map(one, given)
    shape = here.position.shape
    stored = jnp.sum(stored.reshape(shape[:2]), axis=1)
    return States(place.reshape(shape), speed.reshape(shape), stored)
