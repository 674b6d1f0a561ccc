"""The results of a run, read from its log: status, states at given times, impacts and work.

Isolated impacts that cross the start or the end of a run count by their share in it.
"""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..._coupled.energies import stored_energy
from ..._coupled.modes import Index, Number
from ..._coupled.rows import rows_of
from ..._functions import ratio
from ..._program import derived, quick
from ..arrays.arrays import Flying, accelerations, known_contact_of, law_of
from ..arrays.movers import spin_energy
from ..bodies.bodies import side
from ..engine.log import RunRecord
from ..engine.rest import begins_to_roll, footing, give_way
from ..pair_impact.instantaneous import Choice, meeting_of, second_velocity, two_that_meet
from ..result import Ending, Impacts, States, nan_unless, traced
from .impact_table import table_of
from .states import (
    has_forces_at,
    last_impacts,
    states_as_numpy,
    states_at,
    states_of,
)


class RunContents(NamedTuple):
    """The contents of a `Run`; `total` is the number of impacts."""

    status: Index
    reached: Number
    now: States
    impacts: Impacts
    nearest: tuple[Array, Array]
    total: Index
    work: Number
    sliding_loss: Number | None


def read_run(
    record: RunRecord, times: Float[Array, " T"], rows: int | None, moves: bool
) -> RunContents:
    """Return the results, with the table of impacts padded to so many `rows`. With concrete numbers
    the table has no blank rows. Motion inside contacts is compiled only if one of the times needs
    it. `moves`: whether the times may have tangents.
    """
    reading = derived(_by_choice, record, times, rows, moves, decide=_from_log)
    if traced(reading.total):
        return reading
    total = int(reading.total)
    if not traced(reading.impacts):
        table = jax.tree.map(lambda x: np.asarray(x)[:total], reading.impacts)
        return reading._replace(impacts=jax.device_put(table))
    return reading._replace(impacts=_first(reading.impacts, total))


@eqx.filter_jit
def _first(impacts: Impacts, total: int) -> Impacts:
    return jax.tree.map(lambda column: column[:total], impacts)


def _from_log(
    record: RunRecord, times: Array, rows: int | None, moves: bool
) -> tuple[RunContents, tuple[bool, bool]]:
    """Return the results from Python, with two flags for `_by_choice`. They say whether a requested
    time, and whether an end of the run, is inside a contact.
    """
    count, length = times.shape[0], np.asarray(record.length)
    ends = np.stack([np.zeros_like(length), length])
    every, flags = states_as_numpy(record, np.concatenate([np.asarray(times), ends]), False)
    inside, cut = bool(np.any(flags[:count])), bool(np.any(flags[count:]))
    now = jax.tree.map(lambda x: x[:count], every)
    if inside:
        now = states_as_numpy(record, times, True)[0]
    if cut:
        record = clip_to_run(record, jax.device_put(states_as_numpy(record, ends, True)[0]))
    inside = inside or (moves and has_forces_at(record, times))
    return _without_states(record)._replace(now=jax.device_put(now)), (inside, cut)


def _by_choice(
    choice: tuple[bool, bool] | None,
    record: RunRecord,
    times: Array,
    rows: int | None,
    moves: bool,
) -> RunContents:
    """Return the results from one program with the parts chosen, or with all parts."""
    if choice is not None:
        inside, cut = choice
        if cut:
            record = clip_to_run(record, states_at(record, record.ends))
        return _contents(record, states_of(record, times, inside)[0], None)
    if not record.rules.soft:
        return _contents(record, states_at(record, times), rows)
    # One program for all times.
    every, count = states_at(record, jnp.concatenate([times, record.ends])), times.shape[0]
    now, there = (
        jax.tree.map(lambda x, k=k: x[k], every) for k in (slice(count), slice(count, None))
    )
    return _contents(clip_to_run(record, there), now, rows)


def _contents(record: RunRecord, now: Any, rows: int | None) -> RunContents:
    status, reached = record.ending()
    impacts, nearest, total, beside = table_of(record, status, rows)
    work, sliding_loss = work_of(record, status, reached), None
    if record.model.frictions is not None:
        carried, lost = friction_at_rest(record, reached)
        lost = lost if beside is None else lost + beside
        work, sliding_loss = work + carried, lost + 0 * work
    return RunContents(status, reached, now, impacts, nearest, total, work, sliding_loss)


@quick
def _without_states(record: RunRecord) -> RunContents:
    """Return everything but the states."""
    return _contents(record, None, None)


@quick
def clip_to_run(record: RunRecord, ends: States) -> RunRecord:
    """Return a run with the energy loss and wall work of its impacts limited to the run.

    Impacts that cross the start lose the part before it. Impacts that cross the end count up to it;
    the states there are `ends`. At a time τ after touch a pair has lost E(0) + W - E(τ) - ∫ F dδ. E
    is kinetic energy plus weight, and W = V·(m Δv - m g τ) is the work of a body that moves at V.
    """
    model, log = record.model, record.log
    last = last_impacts(record, ends.time)
    rows, everyone = log.facts.tied.shape[0], jnp.arange(model.visible)
    row, began = last.row[:, : model.visible], last.began[:, : model.visible]
    is_first = log.facts.choice.first[jnp.maximum(row, 0)] == everyone[None]
    inside = (row >= 0) & is_first & (ends.time[:, None] < began)
    inside = inside & (ends.time <= record.ending()[1])[:, None]

    def loss_and_work(
        k: Array, on: Array, time: Array, position: Array, velocity: Array, spin: Array | None
    ) -> Array:
        choice, before = jax.tree.map(
            lambda x: x[jnp.maximum(k, 0)], (log.facts.choice, log.figures.before)
        )
        safe = two_that_meet(model, choice.time)
        before = jax.tree.map(lambda a, b: jnp.where(on, a, b), before, safe)
        meeting = meeting_of(model, before, choice)
        second = jnp.minimum(choice.second, model.spheres - 1)
        who, is_wall = jnp.stack([choice.first, second]), choice.second >= model.spheres
        touch, passed = meeting.flying, time - meeting.time
        inverse = jnp.where(jnp.stack([~on, is_wall | ~on]), 0, model.inverse_mass[who])
        free, mass = inverse > 0, ratio(1.0, inverse)
        seen = jnp.minimum(who, model.visible - 1)
        here = Flying(
            jnp.where(free[:, None], position[seen], touch.position + touch.velocity * passed),
            jnp.where(free[:, None], velocity[seen], touch.velocity),
            touch.time,
        )

        def energy(state: Flying) -> Array:
            weight = jnp.sum(state.position * model.gravity[None], axis=-1)
            return jnp.sum(mass * (jnp.sum(jnp.square(state.velocity), axis=-1) / 2 - weight))

        carried, lost_spin = meeting.driven * meeting.normal, 0.0
        if model.rotation is not None and touch.turning is not None and spin is not None:
            carried = second_velocity(model, choice, meeting)
            turned = spin.reshape(-1, touch.turning.spin.shape[-1])[seen]
            turns = jnp.where(free, model.rotation.inverse_inertia[who], 0)
            both = spin_energy(turns, jnp.stack([touch.turning.spin, turned]))
            lost_spin = jnp.sum(both[0] - both[1])
        drives = jnp.where(is_wall, carried, touch.velocity[1])
        drives = jnp.where(is_wall | ~free[1], drives, 0)
        pull = accelerations(model, who[:1], choice.support[:1])[0]
        gained = mass[0] * (here.velocity[0] - touch.velocity[0] - pull * passed)
        work = jnp.sum(gained * drives)
        apart = here.position[0] - here.position[1] - choice.image * model.period
        distance = model.radius[choice.first] + model.radius[second]
        length = jnp.sqrt(jnp.sum(jnp.square(jnp.where(on & ~is_wall, apart, 1))))
        depth = distance - side(distance) * length
        if model.walls:
            wall = jnp.clip(choice.second - model.spheres, 0)
            height = jnp.sum(model.normal[wall] * here.position[0])
            height = height - model.walls_at(time, wall).offset
            depth = jnp.where(is_wall, model.radius[choice.first] - height, depth)
        contact = known_contact_of(model, choice.first, choice.second)
        law = law_of(model, choice.first, choice.second)
        stored = stored_energy(law, contact, jnp.where(on, depth, 0), meeting.closing)
        lost = energy(touch) + work - energy(here) - stored + lost_spin
        if law.remembers:
            # How much a contact that unloads has kept depends on a depth that the log lacks.
            moves = here.velocity[0] - jnp.where(is_wall, carried, here.velocity[1])
            outwards = jnp.where(is_wall, meeting.normal, side(distance) * apart)
            lost = jnp.where(jnp.sum(moves * outwards) > 0, jnp.nan, lost)
        return jnp.where(on, jnp.stack([lost, work]), 0)

    each = jax.vmap(jax.vmap(loss_and_work, in_axes=(0, 0, None, None, None, None)))
    done = each(row, inside, ends.time, ends.position, ends.velocity, ends.spin)
    place = jnp.where(inside, row, rows)
    outcome = log.figures.outcome
    full = jnp.stack([outcome.energy_loss, outcome.wall_work], axis=1)
    part = full.at[place[1]].set(done[1], mode="drop").at[place[0]].add(-done[0], mode="drop")
    outcome = outcome._replace(energy_loss=part[:, 0], wall_work=part[:, 1])
    log = log._replace(figures=log.figures._replace(outcome=outcome))
    return dataclasses.replace(record, outcome=record.outcome._replace(log=log))


def work_of(record: RunRecord, status: Index, reached: Number) -> Number:
    """Return the work of moving walls in a run in J; NaN if the impacts are not all known."""
    figures, counts = record.log.figures, record.counts
    work = jnp.sum(jnp.where(counts, figures.outcome.wall_work, 0))
    if figures.coupled is not None:
        work = work + jnp.sum(jnp.where(counts, figures.coupled.work, 0))
    if record.model.has_gravity and any(record.model.moving):
        work = work + _work_at_rest(record, reached)
    complete = (status != int(Ending.INVALID_INPUT)) & (status != int(Ending.TOO_MANY_IMPACTS))
    return nan_unless(work, complete)


def _at_rest_on_walls(record: RunRecord, reached: Number) -> tuple[Flying, Any, Any, Any, Any]:
    """Return all spheres before each of their events, and at the end of the run, along one axis.
    The values are their state, who they are, the walls on which they rest, how long, and a mask of
    those that do.
    """
    model, (figures, facts) = record.model, record.log
    choice, before, together = facts.choice, figures.before, figures.coupled
    # A wall has no row of its own.
    who = jnp.stack([choice.first, choice.second], axis=1)
    counts = record.counts[:, None] & (who < model.spheres)
    lasted = figures.outcome.time[:, None] - before.time
    parts: list[Any] = []
    if facts.call is not None and together is not None:
        # Members of a coupled solve, until they join it.
        called = facts.call
        slots = called.decided.slots
        joins = called.decided.change.joined | called.decided.starts[:, None]
        joins = joins & (record.counts & called.is_call)[:, None] & slots.present
        waited = together.began.time[:, None] - together.spheres.time
        parts.append((together.spheres, slots.who, called.support, waited, joins))
        counts = counts & ~called.is_call[:, None]
    last, everyone = last_impacts(record, reached[None]), jnp.arange(model.spheres)[None]
    now = Flying(last.position, last.velocity, last.began, last.turning)
    parts.append((now, everyone, last.support, reached - last.began, jnp.ones_like(everyone, bool)))

    def joined(*columns: Array) -> Array:
        return jnp.concatenate([x.reshape(-1, *x.shape[2:]) for x in columns])

    of_rows = before, who, choice.support, lasted, counts
    flying, who, support, lasted, counts = jax.tree.map(joined, of_rows, *parts)
    rests = counts & (support >= 0)
    return flying, jnp.minimum(who, model.spheres - 1), jnp.maximum(support, 0), lasted, rests


def _work_at_rest(record: RunRecord, reached: Number) -> Number:
    """Return the work on spheres at rest on walls: the power -m (g·n) w times the duration."""
    model = record.model
    assert model.motion is not None
    mass = ratio(1.0, model.inverse_mass[: model.spheres])
    power = -jnp.sum(model.normal * model.gravity[None], axis=-1) * model.motion.speed
    _, who, on, lasted, rests = _at_rest_on_walls(record, reached)
    return jnp.sum(jnp.where(rests, power[on] * mass[who] * lasted, 0))


def friction_at_rest(record: RunRecord, reached: Number) -> tuple[Number, Number]:
    """Return the work of walls by friction on spheres at rest on them, and the energy lost by
    sliding on them, in J.

    A friction a = F/m gives a sphere the power m a·(u + w). The wall, which moves at w along
    itself, does m a·w of it, and -m a·u is lost. The slip u changes at a constant rate until the
    next event.
    """
    model, (figures, facts) = record.model, record.log
    if not model.walls or not (model.settles or record.rules.slots):
        zero = jnp.zeros((), model.dtype)
        return zero, zero
    flying, who, on, lasted, rests = _at_rest_on_walls(record, reached)
    assert flying.turning is not None
    inverse = rows_of(model.inverse_mass, who)
    rests = rests & (inverse > 0)
    foot, drag = footing(model, who, on, flying), flying.turning.drag
    lasted = jnp.where(rests, lasted, 0)[:, None]
    force = drag / jnp.where(inverse > 0, inverse, 1)[:, None]
    way = foot.slip * lasted + foot.slip_rate(drag) * jnp.square(lasted) / 2
    work = jnp.sum(jnp.where(rests[:, None], force * foot.drift * lasted, 0))
    loss = jnp.sum(jnp.where(rests[:, None], -force * way, 0))
    if record.rules.soft and model.has_gravity:
        rolls = record.counts & begins_to_roll(model, facts.choice)
        rolls = rolls if record.calls is None else rolls & ~record.calls
        first = jax.tree.map(lambda x: x[:, 0], figures.before)
        loss = loss + jnp.sum(jnp.where(rolls, _fallen(record, first, facts.choice), 0))
    return work, loss


def _fallen(record: RunRecord, sliding: Flying, choice: Choice) -> Array:
    """Return the energies in J that soft balls lose as they give way at the end of sliding."""
    model, support = record.model, choice.support[:, 0]
    way = give_way(model, choice.first, support, sliding)
    inverse = rows_of(model.inverse_mass, choice.first)
    slope = rows_of(model.pull, jnp.maximum(support, 0) + 1)
    return jnp.sum(slope * way, axis=1) / jnp.where(inverse > 0, inverse, 1)
