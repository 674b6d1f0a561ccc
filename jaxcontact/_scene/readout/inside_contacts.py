"""The states of spheres in contact, solved from their touch."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..._coupled.energies import stored_energy
from ..._coupled.rows import rows_of, with_rows
from ..arrays.arrays import Flying, SceneArrays, known_contact_of, law_of
from ..arrays.movers import Turning
from ..engine.coupled import call, contact_energy, meets
from ..engine.log import Call, RunRecord, as_flags, blank_state, last_call
from ..engine.slots import all_fit, empty_slots, in_line, joins, no_change
from ..engine.state import Slots, index_of
from ..pair_impact.friction import is_followed
from ..pair_impact.instantaneous import Choice


class Kinematics(NamedTuple):
    """Positions and velocities (T, N, D), and the elastic energy `stored` in contacts (T,). `spin`
    (T, N, S) is None without friction.
    """

    position: Float[Array, "T N D"]
    velocity: Float[Array, "T N D"]
    stored: Float[Array, " T"]
    spin: Float[Array, "T N S"] | None = None


class Entries(NamedTuple):
    """The last event of every sphere before given times, (T, N). `row` is that of the log, or -1.
    `held` is the v0 of a sphere at rest. For a sphere within an isolated impact, `began` lies in
    the future.
    """

    position: Array
    velocity: Array
    began: Array
    support: Array
    row: Array
    held: Array
    turning: Turning | None = None


def in_contacts(
    record: RunRecord, times: Float[Array, " T"], last: Entries, here: Kinematics
) -> Kinematics:
    """Return the states, including spheres in isolated impacts and in coupled solves.

    All are calls of the coupled solve, so that it is compiled once. Each time has N lanes for the
    isolated impacts, each assigned to its first body. One more lane holds the solve in progress, if
    the run has any.
    """
    model, log, count = record.model, record.log, record.model.spheres
    size, together = record.rules.slots or min(2, count), log.figures.coupled
    nobody, yes = jnp.zeros(count, bool), jnp.asarray(True)
    away, nothing = jnp.zeros((count, model.dimensions), model.dtype), jnp.zeros_like(times[0])

    def pair(row: Array, until: Array, who: Array) -> tuple[tuple, Array]:
        """Return the isolated impact of a row as a call, and whether `who` is its first body."""
        choice, before = rows_of((log.facts.choice, log.figures.before), row)
        slots = _slots_of_two(model, size, choice, before)
        is_first, is_second = slots.who == choice.first, slots.who == choice.second

        def seat(pair: Array) -> Array:
            shape = (size,) + (1,) * (pair.ndim - 1)
            one, other = is_first.reshape(shape), is_second.reshape(shape)
            return jnp.where(one, pair[:1], jnp.where(other, pair[1:], jnp.zeros_like(pair[:1])))

        change = joins(model, slots.present)
        closed = meets(model, slots, choice)
        decided = Call(yes, choice, slots, change, closed, until, ~yes)
        spheres = jax.tree.map(seat, before)
        blank = blank_state(model, size)
        none, held = jnp.full(size, -1), jnp.zeros(size, model.dtype)
        return (spheres, none, held, blank, decided), who == choice.first

    def resume(row: Array, until: Array) -> tuple[tuple, Array]:
        """Return the call of a row up to a time, and whether it lasts until then."""
        run, facts, choice = rows_of((together, log.facts.call, log.facts.choice), row)
        assert run is not None and facts is not None
        change = no_change(model, size)
        decided = facts.decided._replace(starts=~yes, choice=choice, change=change, until=until)
        if model.frictions is None:
            # By rounding this solve may find its spheres at rest before the end of the call.
            decided = decided._replace(to_the_end=until <= run.end.time)
        inside = (until < run.end.time) | ~facts.ends
        began = as_flags(run.began)
        return (run.spheres, facts.support, run.held, began, decided), inside

    unturned = None if here.spin is None else jnp.zeros_like(here.spin[0])
    blank = nobody, away, away, unturned

    def lane(columns: tuple[Array, ...]) -> tuple:
        time, who, row, inside, *last = columns
        chosen, active = pair(row, time, who)
        active = active & inside & is_followed(model)
        if last:
            coupled, goes_on = resume(last[0], time)
            is_call = who == count
            chosen = jax.tree.map(lambda a, b: jnp.where(is_call, a, b), coupled, chosen)
            active = jnp.where(is_call, last[1] & goes_on, active)
        spheres, support, held, before, decided = chosen

        def solve() -> tuple:
            slots = decided.slots
            state = call(
                model, spheres, support, held, before, decided.where(active),
                record.tolerance, record.rules.v0,
            )[1].state  # fmt: skip
            if last and together is not None:
                end = as_flags(rows_of(together.end, last[0]))
                state = _as_known((who == count) & (time == end.time), end, state)
            late = time - state.time
            index = index_of(model, slots)
            velocity = state.velocity[:size]
            place = state.position[:size] + slots.shift * model.period[None] + velocity * late
            spin = None if state.rubbing is None else state.rubbing.spin[:size]
            rows = slots.present, place, velocity, spin
            stored = contact_energy(model, slots, state)
            return *with_rows(blank, index, rows), stored

        return jax.lax.cond(active, solve, lambda: (*blank, nothing))

    total = times.shape[0]
    inside = (times[:, None] < last.began) & (last.row >= 0)
    columns = (jnp.maximum(last.row, 0), inside)
    lanes, called, any_inside = count, (), jnp.any(inside)
    if together is not None and log.facts.call is not None:
        # The last lane holds no isolated impact.
        lanes, none = count + 1, jnp.zeros((total, 1), int)
        columns = tuple(jnp.concatenate([x, none.astype(x.dtype)], axis=1) for x in columns)
        called = last_call(log, record.outcome.written, times)
        until, ends = rows_of((together.end.time, log.facts.call.ends), called[0])
        any_inside = any_inside | jnp.any(called[1] & ((times < until) | ~ends))
    given = (
        jnp.repeat(times, lanes),
        jnp.tile(jnp.arange(lanes), total),
        *(column.reshape(-1) for column in columns),
        *(jnp.repeat(one, lanes) for one in called),
    )
    solved = jax.lax.cond(
        any_inside,
        lambda: jax.lax.map(lane, given),
        lambda: jax.tree.map(
            lambda x: jnp.zeros((total * lanes, *x.shape), x.dtype), (*blank, nothing)
        ),
    )
    who, place, speed, spin, stored = jax.tree.map(
        lambda x: x.reshape(total, lanes, *x.shape[1:]), solved
    )

    def merge(old: Array, new: Array) -> Array:
        holds = who[..., None]
        return jnp.where(jnp.any(holds, axis=1), jnp.sum(jnp.where(holds, new, 0), axis=1), old)

    turned = None if here.spin is None else merge(here.spin, spin)
    moved = merge(here.position, place), merge(here.velocity, speed)
    there = Kinematics(*moved, jnp.sum(stored, 1), turned)
    if together is None:
        return there
    rest = at_rest(record, last, here, times, jnp.any(who, axis=1))
    return there._replace(stored=there.stored + rest)


def _as_known(there: Array, known: Any, found: Any) -> Any:
    """Return a tree with `known` values `there`, since a solve finds the rest at its end or not by
    rounding, and with the derivatives of `found`.
    """

    def value(known: Array, still: Array, found: Array) -> Array:
        if not jnp.issubdtype(found.dtype, jnp.inexact):
            return jnp.where(there, known, found)
        return found + jnp.where(there, known - still, 0)

    return jax.tree.map(value, *jax.lax.stop_gradient((known, found)), found)


def energy_at_ends(record: RunRecord, times: Float[Array, " T"]) -> Float[Array, " T"]:
    """Return the energy stored in contacts in progress, at times when one of their calls ended."""
    model, log = record.model, record.log
    rows, lasts = last_call(log, record.outcome.written, times)
    called, together = log.facts.call, log.figures.coupled
    assert called is not None and together is not None

    def energy(lane: tuple[Array, Array, Array]) -> Array:
        time, row, last = lane
        end, slots, ends = rows_of((together.end, called.decided.slots, called.ends), row)
        stored = contact_energy(model, slots, as_flags(end))
        return jnp.where(last & ~ends & (time == end.time), stored, 0)

    return jax.lax.map(energy, (times, rows, lasts))


def at_rest(
    record: RunRecord, last: Entries, here: Kinematics, times: Float[Array, " T"], elsewhere: Array
) -> Float[Array, " T"]:
    """Return the energy (T,) of spheres at rest on walls, except those `elsewhere` (T, N)."""
    model = record.model
    if not model.walls:
        return jnp.zeros(last.row.shape[0], model.dtype)

    def energy(i: Array, support: Array, place: Array, time: Array) -> Array:
        wall = jnp.maximum(support, 0)
        height = jnp.sum(place * model.normal[wall]) - model.walls_at(time, wall).offset
        contact = known_contact_of(model, i, model.spheres + wall)
        law = law_of(model, i, model.spheres + wall)
        depth = jnp.where(support >= 0, model.radius[i] - height, 0)
        return stored_energy(law, contact, depth, jnp.ones_like(depth))

    rests = jnp.where(elsewhere, -1, last.support)
    everyone = jnp.arange(model.spheres)
    each = jax.vmap(jax.vmap(energy, in_axes=(0, 0, 0, None)), in_axes=(None, 0, 0, 0))(
        everyone, rests, here.position, times
    )
    return jnp.sum(each, axis=1)


def _slots_of_two(model: SceneArrays, size: int, choice: Choice, before: Flying) -> Slots:
    """Return the places of the bodies of an isolated impact; the second may be a wall."""
    blank = empty_slots(model, size)
    if all_fit(model, size):
        present = (blank.who == choice.first) | (blank.who == choice.second)
        return blank._replace(present=present)
    count = model.spheres
    second = jnp.where(choice.second < count, choice.second, count)
    image = -choice.image
    two, shift = jnp.stack([choice.first, second]), jnp.stack([jnp.zeros_like(image), image])
    if in_line(model):
        # Neighbours in the order of the line.
        places = before.position - shift * model.period[None]
        turned = (places[1, 0] < places[0, 0]) & (second < count)
        two, shift = (jnp.where(turned, x[::-1], x) for x in (two, shift))
    rest = size - 2
    who = jnp.concatenate([two, jnp.full(max(rest, 0), count)])[:size]
    shift = jnp.concatenate([shift, jnp.zeros((max(rest, 0), model.dimensions), model.dtype)])
    return Slots(who, who < count, shift[:size])
