"""The states of all spheres at any time, from the log of a run; within a contact solved again from
its touch.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from ..._coupled.energies import stored_energy
from ..._coupled.modes import Flag, Index, Number
from ..._coupled.rows import rows_of, with_rows
from ..._functions import ratio
from ..._program import derived, quick
from ..arrays.arrays import (
    Flying,
    SceneArrays,
    SceneLayout,
    accelerations,
    known_contact_of,
    law_of,
)
from ..arrays.movers import Turning
from ..cluster.problem import ClusterState
from ..engine.coupled import contact_energy
from ..engine.coupled_call import call, meets
from ..engine.log import Call, Log, RunRecord, as_flags, blank_state, last_call
from ..engine.rest import flying_at_start
from ..engine.slots import (
    Slots,
    all_fit,
    empty_slots,
    in_line,
    joins,
    most_pairs,
    no_change,
    slot_pairs,
)
from ..engine.state import index_of
from ..pair_impact.friction import is_followed
from ..pair_impact.instantaneous import Choice
from ..result import States, nan_unless, traced

_LEAST, _FEW = 512, 128
"""The least number of times in a program, and the largest number of spheres for which it applies.
With it a run, its plots and its animations share one program."""


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


def states_at(record: RunRecord, times: Float[Array, " T"]) -> States:
    """Return the states at given times; motion inside contacts is compiled only if needed."""
    return derived(_states_at, record, times, traced(times), decide=_states_by_choice)


def _states_by_choice(record: RunRecord, times: Array, moves: bool) -> tuple[States, bool]:
    now, inside = states_as_numpy(record, times, False)
    cut = bool(np.any(inside))
    if cut:
        now = states_as_numpy(record, times, True)[0]
    return jax.device_put(now), cut or (moves and has_forces_at(record, times))


def _states_at(inside: bool | None, record: RunRecord, times: Array, moves: bool) -> States:
    return states_of(record, times, record.rules.soft if inside is None else inside)[0]


def states_as_numpy(record: RunRecord, times: ArrayLike, followed: bool) -> tuple[States, Any]:
    """Return `states_of` as NumPy arrays. All small numbers of times share one program if the
    motion inside contacts is not `followed`.
    """
    model = np.asarray(times, record.model.dtype)
    count = model.shape[0]
    least = _LEAST if record.model.spheres <= _FEW and not followed else 1
    padded = np.zeros(max(least, 1 << (count - 1).bit_length()), model.dtype)
    padded[:count] = model
    result = states_of(record, jax.device_put(padded), followed)
    return jax.tree.map(lambda x: np.asarray(x)[:count], result)


def has_forces_at(record: RunRecord, times: Float[Array, " T"]) -> bool:
    """Return whether one of the times is inside a contact, or at the end of a run inside one. The
    log has the state there, but not its derivative by time.
    """
    return bool(any_inside(record, times, True))


@quick
def states_of(
    record: RunRecord, times: Float[Array, " T"], followed: bool
) -> tuple[States, Bool[Array, " T"] | None]:
    """Return the values of `kinematics_at` as public states."""
    times = times.astype(record.model.dtype)
    (position, velocity, stored, spin), inside = kinematics_at(record, times, followed)
    energy = _energy_of(record, position, velocity) + stored
    valid = (times >= 0) & (times <= record.ending()[1])
    if spin is not None and record.model.rotation is not None:
        energy = energy + jnp.sum(record.model.rotation.energy(spin), axis=-1)
        spin = nan_unless(spin[:, : record.model.visible], valid)
        spin = spin[..., 0] if record.model.dimensions == 2 else spin
    position, velocity = (x[:, : record.model.visible] for x in (position, velocity))
    position, velocity, energy = (nan_unless(x, valid) for x in (position, velocity, energy))
    return States(times, position, velocity, energy, spin), inside


def kinematics_at(
    record: RunRecord, times: Float[Array, " T"], followed: bool
) -> tuple[Kinematics, Bool[Array, " T"] | None]:
    """Return the states at given times; at an instantaneous impact those after it. If `followed`,
    those inside contacts are solved. Otherwise only the states outside of contacts, and at the end
    of a coupled call, are right; the second value flags the times inside.

    The last impact of each sphere is found by binary search in a list sorted by sphere and time.
    This avoids an array of times, spheres and impacts.
    """
    last = last_impacts(record, times)
    here = _in_flight(record, times, last)
    if not record.rules.soft:
        return here, None if followed else times < -jnp.inf
    if not followed:
        inside = _inside(record, times, last)
        if record.rules.slots:
            resting = _at_rest(record, last, here, times, jnp.zeros(last.support.shape, bool))
            here = here._replace(stored=_energy_at_ends(record, times) + resting)
        return here, inside
    solved = is_followed(record.model)
    if solved or record.rules.slots:
        here = _with_prescribed(record, times, _in_contacts(record, times, last, here))
    if not solved:
        # The motion within an isolated contact whose friction is a formula is not solved.
        outside = (times[:, None] >= last.began) | (last.row < 0)
        whole = jnp.all(outside, axis=1)
        here = jax.tree.map(lambda x: nan_unless(x, outside if x.ndim > 1 else whole), here)
    return here, None


def _in_flight(record: RunRecord, times: Float[Array, " T"], last: Entries) -> Kinematics:
    """Return the states of spheres in flight or at rest."""
    model = record.model
    count, dimensions = model.spheres, model.dimensions
    who = jnp.tile(jnp.arange(count), times.shape[0])
    pull, spin = accelerations(model, who, last.support.reshape(-1)), None
    since = (times[:, None] - last.began)[..., None]
    pull = pull.reshape(times.shape[0], count, dimensions)
    if last.turning is not None:
        pull = pull + last.turning.drag
        spin = last.turning.spin + last.turning.twist * since
    velocity = last.velocity + pull * since
    position = last.position + (last.velocity + velocity) / 2 * since
    states = Kinematics(position, velocity, jnp.zeros_like(times), spin)
    return _with_prescribed(record, times, states)


def _with_prescribed(
    record: RunRecord, times: Float[Array, " T"], states: Kinematics
) -> Kinematics:
    """Return the states, with accelerated fixed spheres placed by their motion."""
    model = record.model
    if not model.shaken:
        return states
    place, rate = jax.vmap(lambda time: model.shaken_at(time))(times)
    rows = np.array(model.shaken)
    return states._replace(
        position=states.position.at[:, rows].set(place),
        velocity=states.velocity.at[:, rows].set(rate),
    )


@quick
def any_inside(record: RunRecord, times: Float[Array, " T"], or_cut: bool = False) -> Flag:
    """Return whether any of the times lies inside a contact of finite duration. `or_cut` includes
    the end of a run that ends in a coupled contact.
    """
    return jnp.any(_inside(record, times, last_impacts(record, times), or_cut))


def _inside(
    record: RunRecord, times: Float[Array, " T"], found: Entries, or_cut: bool = False
) -> Bool[Array, " T"]:
    inside, log = jnp.any((times[:, None] < found.began) & (found.row >= 0), axis=1), record.log
    if log.facts.call is None or log.figures.coupled is None:
        return inside
    row, last = last_call(log, record.outcome.written, times)
    until, ends = rows_of((log.figures.coupled.end.time, log.facts.call.ends), row)
    return inside | (last & ((times < until) | (~ends & or_cut)))


def last_impacts(record: RunRecord, times: Float[Array, " T"]) -> Entries:
    """Return the last events of all spheres; a soft impact counts only after its touch."""
    model, (figures, facts) = record.model, record.log
    count, rows = model.spheres, facts.tied.shape[0]
    number, counts = jnp.arange(rows), record.counts
    is_call = jnp.zeros(rows, bool) if record.calls is None else record.calls

    def each(of_row: Array, like: Array) -> Array:
        return jnp.broadcast_to(of_row[:, None], like.shape)

    start, none = flying_at_start(model), jnp.full(count, -1)
    support, held = none, start.time
    if model.start is not None:
        support, held = model.start.support, model.start.held
    begins = start.position, start.velocity, start.time, support, none, held, start.turning
    choice, after = facts.choice, figures.outcome.after
    pair = jnp.stack([choice.first, jnp.minimum(choice.second, count)], axis=1)
    who = jnp.where((counts & ~is_call)[:, None], pair, count)
    hits = (
        *(after.position, after.velocity, after.time, facts.support),
        *(each(number, who), jnp.zeros(who.shape, model.dtype), after.turning),
    )
    parts = [(jnp.arange(count)[None], Entries(*begins)), (who, Entries(*hits))]
    if facts.call is not None and figures.coupled is not None:
        end, slots = figures.coupled.end, facts.call.decided.slots
        size = slots.who.shape[1]
        resting, latched = _resting(model, record.log)
        calls = (
            end.position[:, :size] + slots.shift * model.period[None, None],
            *(end.velocity[:, :size], each(end.time, slots.who), resting),
            *(jnp.full(slots.who.shape, -1), latched, figures.coupled.turning),
        )
        who = jnp.where(is_call[:, None] & slots.present, slots.who, count)
        parts.append((who, Entries(*calls)))
    # Sorted by sphere, then by the number of the row; the start comes first.
    keys = [parts[0][0] * (rows + 1)]
    keys += [who * (rows + 1) + number[:, None] + 1 for who, _ in parts[1:]]
    keys = jnp.concatenate([key.reshape(-1) for key in keys])
    order = jnp.argsort(keys)
    happened = jnp.where(counts, figures.outcome.time, jnp.inf)
    passed = jnp.searchsorted(
        happened, times, side="left" if record.rules.soft else "right"
    ).astype(int)
    wanted = jnp.arange(count)[None] * (rows + 1) + passed[:, None]
    rank = jnp.searchsorted(keys[order], wanted.reshape(-1), side="right") - 1

    def joined(first: Array, *others: Array) -> Array:
        return jnp.concatenate([first, *(x.reshape(-1, *x.shape[2:]) for x in others)])

    entries = jax.tree.map(joined, *(entries for _, entries in parts))
    return rows_of(entries, order[rank].reshape(wanted.shape))


def _resting(layout: SceneLayout, log: Log) -> tuple[Int[Array, "K M"], Float[Array, "K M"]]:
    """Return the walls that spheres rest on after a call, or -1, and the v0 held."""
    called, together = log.facts.call, log.figures.coupled
    assert called is not None and together is not None
    rows, size = called.decided.slots.who.shape
    first, second = slot_pairs(layout, size)
    wall = second - size
    closed = (together.end.closed > 0.5) & called.rest[:, None] & jnp.asarray(wall >= 0)[None]
    none, end = jnp.full((rows, size), -1), together.end
    zero = jnp.zeros((rows, size), end.latched.dtype)
    held = zero.at[:, first].max(jnp.where(closed, end.latched, 0))
    return none.at[:, first].max(jnp.where(closed, jnp.asarray(wall)[None], -1)), held


def _energy_of(
    record: RunRecord, position: Float[Array, "T N D"], velocity: Float[Array, "T N D"]
) -> Float[Array, " T"]:
    """Return kinetic energy plus weight of all free spheres, ½ m v² - m g·x, in J."""
    model = record.model
    mass = ratio(1.0, model.inverse_mass[: record.model.spheres])
    kinetic = jnp.sum(jnp.square(velocity), axis=-1) / 2
    weight = jnp.sum(position * model.gravity[None, None], axis=-1)
    return jnp.sum(mass[None] * (kinetic - weight), axis=-1)


def _in_contacts(
    record: RunRecord, times: Float[Array, " T"], last: Entries, here: Kinematics
) -> Kinematics:
    """Return the states, including spheres in isolated impacts and in coupled solves.

    Each time has N lanes for the isolated impacts, each assigned to its first body. One more lane
    holds the solve in progress, if the run has any.
    """
    model, (figures, facts) = record.model, record.log
    count, together = model.spheres, figures.coupled
    away, nothing = jnp.zeros((count, model.dimensions), model.dtype), jnp.zeros_like(times[0])
    unturned = None if here.spin is None else jnp.zeros_like(here.spin[0])
    blank = jnp.zeros(count, bool), away, away, unturned
    lanes = []
    if is_followed(model):
        row = jnp.maximum(last.row, 0)
        is_first = rows_of(facts.choice.first, row) == jnp.arange(count)[None]
        lanes.append((row, (times[:, None] < last.began) & (last.row >= 0) & is_first))
    if facts.call is not None and together is not None:
        row, active = last_call(record.log, record.outcome.written, times)
        until, ends = rows_of((together.end.time, facts.call.ends), row)
        lanes.append((row[:, None], (active & ((times < until) | ~ends))[:, None]))
    rows, active = (jnp.concatenate(column, axis=1) for column in zip(*lanes, strict=True))

    def lane(columns: tuple[Array, Array, Array]) -> tuple:
        time, row, active = columns

        def solve() -> tuple:
            slots, state = resume_impact(record, row, time, active)
            size, late = slots.who.shape[0], time - state.time
            velocity = state.velocity[:size]
            place = state.position[:size] + slots.shift * model.period[None] + velocity * late
            spin = None if state.rubbing is None else state.rubbing.spin[:size]
            new = with_rows(blank, index_of(model, slots), (slots.present, place, velocity, spin))
            return *new, contact_energy(model, slots, state)

        return jax.lax.cond(active, solve, lambda: (*blank, nothing))

    given = jnp.repeat(times, rows.shape[1]), rows.reshape(-1), active.reshape(-1)
    solved = jax.lax.cond(
        jnp.any(active),
        lambda: jax.lax.map(lane, given),
        lambda: jax.tree.map(
            lambda x: jnp.zeros((rows.size, *x.shape), x.dtype), (*blank, nothing)
        ),
    )
    who, place, speed, spin, stored = jax.tree.map(
        lambda x: x.reshape(*rows.shape, *x.shape[1:]), solved
    )

    def merge(old: Array, new: Array) -> Array:
        holds = who[..., None]
        return jnp.where(jnp.any(holds, axis=1), jnp.sum(jnp.where(holds, new, 0), axis=1), old)

    turned = None if here.spin is None else merge(here.spin, spin)
    moved = merge(here.position, place), merge(here.velocity, speed)
    there = Kinematics(*moved, jnp.sum(stored, 1), turned)
    if together is None:
        return there
    rest = _at_rest(record, last, here, times, jnp.any(who, axis=1))
    return there._replace(stored=there.stored + rest)


def resume_impact(
    record: RunRecord, row: Index, until: Number, needed: Flag
) -> tuple[Slots, ClusterState]:
    """Return the slots of the bodies of an impact and their state at a time, solved again. An
    isolated impact starts at its touch, a coupled one at the start of the call of that row. Both
    are calls of the coupled solve, so that it is compiled once. No slot is filled unless `needed`.
    """
    model, (figures, facts) = record.model, record.log
    size, yes = record.rules.slots or min(2, model.spheres), jnp.asarray(True)
    choice, before, called, run = rows_of(
        (facts.choice, figures.before, facts.call, figures.coupled), row
    )
    slots = _slots_of_two(model, size, choice, before)
    is_first, is_second = slots.who == choice.first, slots.who == choice.second

    def placed(pair: Array) -> Array:
        shape = (size,) + (1,) * (pair.ndim - 1)
        one, other = is_first.reshape(shape), is_second.reshape(shape)
        return jnp.where(one, pair[:1], jnp.where(other, pair[1:], jnp.zeros_like(pair[:1])))

    change, closed = joins(model, slots.present), meets(model, slots, choice)
    near = None if most_pairs(model, size) is None else closed
    decided = Call(yes, choice, slots, change, closed, until, ~yes, near)
    none, held = jnp.full(size, -1), jnp.zeros(size, model.dtype)
    blank = blank_state(model, size)
    entering: Any = jax.tree.map(placed, before), none, held, blank, decided
    if called is not None and run is not None:
        again = called.decided._replace(
            starts=~yes, choice=choice, change=no_change(model, size), until=until
        )
        if model.frictions is None:
            # By rounding this solve may find its spheres at rest before the end of the call.
            again = again._replace(to_the_end=until <= run.end.time)
        of_call = run.spheres, called.support, run.held, as_flags(run.began), again
        entering = jax.tree.map(lambda a, b: jnp.where(called.is_call, a, b), of_call, entering)
    spheres, support, held, began, decided = entering
    state = call(
        model, spheres, support, held, began, decided.where(needed),
        record.tolerance, record.rules.v0,
    )[1].state  # fmt: skip
    if called is not None and run is not None:
        ended = called.is_call & (until == run.end.time)
        state = _as_known(ended, as_flags(run.end), state)
    return decided.slots, state


def _as_known(there: Array, known: Any, found: Any) -> Any:
    """Return a tree with `known` values `there`, since a solve finds the rest at its end or not by
    rounding, and with the derivatives of `found`.
    """

    def value(known: Array, still: Array, found: Array) -> Array:
        if not jnp.issubdtype(found.dtype, jnp.inexact):
            return jnp.where(there, known, found)
        return found + jnp.where(there, known - still, 0)

    return jax.tree.map(value, *jax.lax.stop_gradient((known, found)), found)


def _energy_at_ends(record: RunRecord, times: Float[Array, " T"]) -> Float[Array, " T"]:
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


def _at_rest(
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
