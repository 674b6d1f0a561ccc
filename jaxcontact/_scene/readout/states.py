"""The state of all spheres at any time, read from the log of a run."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from ..._coupled.modes import Flag
from ..._coupled.rows import rows_of
from ..._functions import ratio
from ..._program import derived, quick
from ..arrays.arrays import SceneLayout, accelerations
from ..arrays.movers import Turning
from ..engine.log import Log, RunRecord, last_call
from ..engine.rest import flying_at_start
from ..engine.slots import slot_pairs
from ..pair_impact.friction import is_followed
from ..result import States, nan_unless, traced
from .inside_contacts import Entries, Kinematics, at_rest, energy_at_ends, in_contacts

_LEAST, _FEW = 512, 128
"""The least number of times in a program, and the largest number of spheres for which it applies.
With it a run, its plots and its animations share one program."""


def states_at(record: RunRecord, times: Float[Array, " T"]) -> States:
    """Return the states at given times; motion inside contacts is compiled only if needed."""
    return derived(_states_at, record, times, traced(times), decide=_states_by_choice)


def _states_by_choice(record: RunRecord, times: Array, moves: bool) -> tuple[States, bool]:
    now, inside = states_in_log_as_numpy(record, times)
    cut = bool(np.any(inside))
    now = jax.device_put(states_as_numpy(record, times) if cut else now)
    return now, cut or (moves and has_forces_at(record, times))


def states_in_log_as_numpy(record: RunRecord, times: ArrayLike) -> tuple[States, np.ndarray]:
    """Return `states_in_log` as NumPy arrays, with one program for all small numbers of times."""
    least = _LEAST if record.model.spheres <= _FEW else 1
    return _by_room(states_in_log, record, times, least)


def states_as_numpy(record: RunRecord, times: ArrayLike) -> States:
    """Return `states_of` as NumPy arrays."""
    return _by_room(states_of, record, times, 1)


def _by_room(
    read: Callable[[RunRecord, Array], Any], record: RunRecord, times: ArrayLike, least: int
) -> Any:
    model = np.asarray(times, record.model.dtype)
    count = model.shape[0]
    padded = np.zeros(max(least, 1 << (count - 1).bit_length()), model.dtype)
    padded[:count] = model
    result = read(record, jax.device_put(padded))
    return jax.tree.map(lambda x: np.asarray(x)[:count], result)


def has_forces_at(record: RunRecord, times: Float[Array, " T"]) -> bool:
    """Return whether one of the times is inside a contact, or at the end of a run inside one. The
    log has the state there, but not its derivative by time.
    """
    return bool(any_inside(record, times, True))


def _states_at(inside: bool | None, record: RunRecord, times: Array, moves: bool) -> States:
    if record.rules.soft if inside is None else inside:
        return states_of(record, times)
    return states_in_log(record, times)[0]


@quick
def states_in_log(record: RunRecord, times: Float[Array, " T"]) -> tuple[States, Bool[Array, " T"]]:
    """Return the states outside of contacts, and which of the times are inside one."""
    times = times.astype(record.model.dtype)
    states, inside = kinematics_in_log(record, times)
    return _states(record, times, states), inside


@quick
def states_of(record: RunRecord, times: Float[Array, " T"]) -> States:
    """Return the states at any times, including inside contacts."""
    times = times.astype(record.model.dtype)
    return _states(record, times, kinematics_at(record, times))


def _states(record: RunRecord, times: Array, states: Kinematics) -> States:
    position, velocity, stored, spin = states
    energy = _energy_of(record, position, velocity) + stored
    valid = (times >= 0) & (times <= record.ending()[1])
    if spin is not None and record.model.rotation is not None:
        energy = energy + jnp.sum(record.model.rotation.energy(spin), axis=-1)
        spin = nan_unless(spin[:, : record.model.visible], valid)
        spin = spin[..., 0] if record.model.dimensions == 2 else spin
    position, velocity = (x[:, : record.model.visible] for x in (position, velocity))
    position, velocity, energy = (nan_unless(x, valid) for x in (position, velocity, energy))
    return States(times, position, velocity, energy, spin)


def kinematics_at(record: RunRecord, times: Float[Array, " T"]) -> Kinematics:
    """Return the states at given times; at an instantaneous impact those after it. The last impact
    of each sphere is found by binary search in a list sorted by sphere and time. This avoids an
    array of times, spheres and impacts. Inside a contact the motion is solved from the touch.
    """
    if not record.rules.soft:
        return kinematics_in_log(record, times)[0]
    last = last_impacts(record, times)
    here = _in_flight(record, times, last)
    followed = is_followed(record.model)
    if followed or record.rules.slots:
        here = _with_prescribed(record, times, in_contacts(record, times, last, here))
    if followed:
        return here
    # The motion within an isolated contact whose friction is a formula is not solved.
    outside = (times[:, None] >= last.began) | (last.row < 0)
    whole = jnp.all(outside, axis=1)
    return jax.tree.map(lambda x: nan_unless(x, outside if x.ndim > 1 else whole), here)


def kinematics_in_log(
    record: RunRecord, times: Float[Array, " T"]
) -> tuple[Kinematics, Bool[Array, " T"]]:
    """Return the states outside of contacts, and which of the times are inside one. At the end time
    of a coupled call the state is in the log.
    """
    last = last_impacts(record, times)
    here = _in_flight(record, times, last)
    if not record.rules.soft:
        return here, times < -jnp.inf
    inside = _inside(record, times, last)
    if not record.rules.slots:
        return here, inside
    resting = at_rest(record, last, here, times, jnp.zeros(last.support.shape, bool))
    return here._replace(stored=energy_at_ends(record, times) + resting), inside


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
    model, log = record.model, record.log
    count, rows = model.spheres, log.facts.tied.shape[0]
    figures, facts = log
    number = jnp.arange(1, rows + 1)
    blank = number > record.outcome.written
    is_call = jnp.zeros(rows, bool) if facts.call is None else facts.call.is_call
    first = jnp.where(blank | is_call, count, facts.choice.first)
    second = jnp.where(blank | is_call, count, jnp.minimum(facts.choice.second, count))
    start, none = flying_at_start(model), jnp.full(count, -1)
    after = figures.outcome.after
    bodies = [jnp.arange(count), first, second]
    numbered = [jnp.zeros(count, int), number, number]
    place = [start.position, after.position[:, 0], after.position[:, 1]]
    speed = [start.velocity, after.velocity[:, 0], after.velocity[:, 1]]
    began = [start.time, after.time[:, 0], after.time[:, 1]]
    support = [none, facts.support[:, 0], facts.support[:, 1]]
    held = [start.time] + [jnp.zeros(rows, model.dtype)] * 2
    if model.start is not None:
        support[0], held[0] = model.start.support, model.start.held
    pairs = [none, number - 1, number - 1]
    if facts.call is not None and figures.coupled is not None:
        end, slots = figures.coupled.end, facts.call.decided.slots
        resting, latched = _resting(model, log)
        for k in range(slots.who.shape[1]):
            counts = is_call & ~blank & slots.present[:, k]
            bodies.append(jnp.where(counts, slots.who[:, k], count))
            numbered.append(number)
            place.append(end.position[:, k] + slots.shift[:, k] * model.period[None])
            speed.append(end.velocity[:, k])
            began.append(end.time)
            support.append(resting[:, k])
            held.append(latched[:, k])
            pairs.append(jnp.full(rows, -1))
    keys = jnp.concatenate(bodies) * (rows + 1) + jnp.concatenate(numbered)
    order = jnp.argsort(keys)
    happened = jnp.where(blank, jnp.inf, figures.outcome.time)
    passed = jnp.searchsorted(
        happened, times, side="left" if record.rules.soft else "right"
    ).astype(int)
    wanted = jnp.arange(count)[None] * (rows + 1) + passed[:, None]
    rank = jnp.searchsorted(keys[order], wanted.reshape(-1), side="right") - 1
    entry = order[rank].reshape(wanted.shape)
    turning = start.turning
    if turning is not None:
        trees = [after.turning, None if figures.coupled is None else figures.coupled.turning]
        parts = [turning, *itertools.chain(*map(_by_slot, filter(None, trees)))]
        turning = rows_of(jax.tree.map(lambda *column: jnp.concatenate(column), *parts), entry)
    columns = tuple(map(jnp.concatenate, (place, speed, began, support, pairs, held)))
    there, fast, since, on, row, v0 = rows_of(columns, entry)
    return Entries(there, fast, since, on, row, v0, turning)


def _by_slot(turning: Turning) -> list[Turning]:
    numbers = range(turning.until.shape[1])
    return [jax.tree.map(lambda x, k=k: x[:, k], turning) for k in numbers]


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
