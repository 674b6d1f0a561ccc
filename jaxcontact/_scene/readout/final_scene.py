"""The final state of a run, and the start of another run from it."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from ..._program import quick
from ..arrays.arrays import SceneArrays
from ..engine.coupled import contact_energy
from ..engine.coupled_friction import without_halves
from ..engine.log import RunRecord, as_flags
from ..engine.slots import pace_of
from ..engine.state import Coupling, Slots
from ..pair_impact.friction import is_followed
from ..resume import Contacts, Start, Underway
from .states import Entries, last_impacts


@quick
def final_start(choice: None, record: RunRecord) -> Start:
    """Return the final state of a run as the start state of another one."""
    model, rules, time = record.model, record.rules, record.length
    figures, facts = record.log
    last = jax.tree.map(lambda x: x[0], last_impacts(record, time[None]))
    underway = _underway(record, last) if rules.soft else None
    start = Start(last.support, last.held, None, underway, rules.soft)
    calls = record.calls
    if calls is None or facts.call is None or figures.coupled is None:
        return start
    row = jnp.max(jnp.where(calls, jnp.arange(calls.shape[0]), -1))
    place = jnp.maximum(row, 0)
    last_call, decided, met = jax.tree.map(
        lambda x: x[place], (figures.coupled, facts.call.decided, facts.choice)
    )
    state, slots, zero = as_flags(last_call.end), decided.slots, jnp.zeros_like(last_call.end.lost)
    closing = jnp.max(jnp.where(state.closed, state.latched, 0))
    contacts = Contacts(
        active=(row >= 0) & ~facts.call.ends[place],
        who=slots.who,
        present=slots.present,
        shift=slots.shift,
        pace=pace_of(model, met, closing),
        reserve=contact_energy(model, slots, state),
        # The energy lost so far belongs to the finished run.
        state=state._replace(
            time=state.time - time,
            since=state.since - time,
            force_until=state.force_until - time,
            lost=zero,
            rubbing=None if state.rubbing is None else state.rubbing._replace(taken=zero),
        ),
    )
    return Start(last.support, last.held, contacts, underway, rules.soft)


def _underway(record: RunRecord, last: Entries) -> Underway:
    """Return the isolated impacts in progress at the end, with the states before them. Another run
    solves these impacts again from their touch.
    """
    model, log, time = record.model, record.log, record.length
    inside = (last.row >= 0) & (last.began > time)
    row = jnp.maximum(last.row, 0)
    choice, before = jax.tree.map(lambda x: x[row], (log.facts.choice, log.figures.before))
    everyone = jnp.arange(model.spheres)
    is_first = choice.first == everyone
    partner = jnp.where(is_first, choice.second, choice.first)
    mine = jax.tree.map(lambda x: x[everyone, jnp.where(is_first, 0, 1)], before)
    return Underway(
        partner=jnp.where(inside, partner, -1),
        touch=jnp.where(inside, choice.time - time, 0),
        position=mine.position,
        velocity=mine.velocity,
        time=jnp.where(inside, mine.time - time, 0),
        turning=mine.turning,
    )


def resume_cluster(model: SceneArrays, coupling: Coupling) -> Coupling:
    """Return the coupling at the start of a run, with the contacts in progress."""
    if model.start is None or model.start.contacts is None:
        return coupling
    contacts, rubbing = model.start.contacts, model.start.contacts.state.rubbing
    if rubbing is not None and is_followed(model):
        # The last run may have had a law with an impulse.
        rubbing = without_halves(rubbing)
    begun = coupling._replace(
        active=contacts.active,
        slots=Slots(contacts.who, contacts.present, contacts.shift),
        pace=contacts.pace,
        reserve=contacts.reserve,
        state=contacts.state._replace(rubbing=rubbing),
    )
    return jax.tree.map(lambda a, b: jnp.where(contacts.active, a, b), begun, coupling)
