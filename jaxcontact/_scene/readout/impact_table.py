"""The table of impacts, from the log of a run."""

from __future__ import annotations

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..._coupled.modes import Index
from ..._coupled.rows import rows_of
from ..arrays.arrays import SceneArrays
from ..cluster.friction import HALF
from ..cluster.problem import ClusterState
from ..engine.coupled_friction import contact_points, speeds_of
from ..engine.log import ClusterDecisions, ClusterNumbers, RunRecord
from ..engine.rest import begins_to_roll
from ..engine.slots import Slots, bodies_of, pairs_of, slot_pairs
from ..pair_impact.friction import has_impulse, is_followed
from ..result import Ending, Impacts, SolvedBy, nan_unless


def table_of(
    record: RunRecord, status: Index, rows: int | None
) -> tuple[Impacts, tuple[Array, Array], Index, Array | None]:
    """Return the impacts in order of time, without names, padded to `rows`.

    The second value holds the smallest time between rivals and the smallest closing speed, see
    `Margin`. The third is the number of impacts, the fourth the energy in J that friction takes in
    coupled contacts that are not in the table. Without `rows` there is one row for every row of the
    log and every pair of a coupled solve.
    """
    table, model, beside = _isolated_impacts(record), record.model, None
    if record.calls is not None and record.log.figures.coupled is not None:
        contacts, together = _coupled_contacts(record), record.log.figures.coupled
        table = jax.tree.map(lambda *parts: jnp.concatenate(parts), table, contacts)
        if together.end.rubbing is not None:
            listed = jnp.where(contacts.valid, together.end.rubbing.taken.reshape(-1), 0)
            taken = jnp.sum(jnp.where(record.counts, together.rubbed, 0))
            beside = taken - jnp.sum(listed)
    total = jnp.sum(table.valid)
    order = jnp.argsort(jnp.where(table.valid, table.time, jnp.inf), stable=True)[:rows]
    table = rows_of(table, order)
    bad = status == int(Ending.INVALID_INPUT)
    valid = table.valid & ~bad
    usable = valid & (status != int(Ending.TOO_MANY_IMPACTS))
    body, face = jnp.asarray(model.body), jnp.asarray(model.face)
    named = body[table.first], body[table.second], face[table.second]
    table = eqx.tree_at(lambda rows: (rows.first, rows.second, rows.face), table, named)

    def flag(column: Array) -> Array:
        if column.dtype == bool:
            return column & valid
        if jnp.issubdtype(column.dtype, jnp.floating):
            return nan_unless(column, usable)
        return jnp.where(valid, column, -1)

    rival = jnp.where(record.counts, record.log.facts.rival, jnp.inf)
    nearest = jnp.min(rival, initial=jnp.inf)
    slowest = jnp.min(jnp.where(usable, table.closing_speed, jnp.inf), initial=jnp.inf)
    impacts = jax.tree.map(flag, table)
    return impacts, (nearest, slowest), total, beside


def _began_in(together: ClusterNumbers, counts: Bool[Array, " K"]) -> Int[Array, "K P"]:
    """Return the row of the call in which a contact began: the first one at that time."""
    began = jnp.where(counts, together.began.time, -jnp.inf)
    row = jnp.searchsorted(jax.lax.cummax(began), together.end.since)
    return jnp.minimum(row, began.shape[0] - 1)


def _doubt(
    together: ClusterNumbers, counts: Bool[Array, " K"], since: Int[Array, "K P"]
) -> Float[Array, "K P"]:
    """Return the summed errors of all calls of a contact, from touch to end, in m/s."""
    error = jnp.where(counts, jax.lax.stop_gradient(together.error), 0)
    before = jnp.cumsum(error) - error
    return (before + error)[:, None] - before[since]


def _was_at_rest(
    model: SceneArrays, called: ClusterDecisions, together: ClusterNumbers, since: Int[Array, "K P"]
) -> Bool[Array, "K P"]:
    """Return whether a sphere already rested on the wall before the contact, and was not hit.

    A coupled solve also includes spheres that rest nearby; their contacts are not impacts. Their
    energy loss is rounding, relative to the kinetic energy in the call plus the losses of all
    contacts.
    """
    slots, lost = called.decided.slots, jax.lax.stop_gradient(together.end.lost)
    size = slots.who.shape[1]
    first, second = slot_pairs(model, size)
    at_walls = np.flatnonzero(second >= size)
    sphere, wall = slots.who[:, first[at_walls]], second[at_walls] - size
    then = since[:, at_walls]
    lay = slots.present[then] & (called.support[then] == wall[None, :, None])
    lay = jnp.any(lay & (slots.who[then] == sphere[..., None]), axis=-1)
    square = jnp.sum(jnp.square(together.began.velocity[:, :size]), axis=-1)
    inverse = model.inverse_mass[jnp.minimum(slots.who, model.spheres - 1)]
    free = slots.present & (inverse > 0)
    motion = jnp.sum(jnp.where(free, square / jnp.where(free, 2 * inverse, 1), 0), axis=1)
    rounding = math.sqrt(jnp.finfo(lost.dtype).eps)
    scale = jax.lax.stop_gradient(motion)[then] + jnp.sum(lost, axis=1, keepdims=True)
    idle = lay & (lost[:, at_walls] <= rounding * scale)
    return jnp.zeros(lost.shape, bool).at[:, at_walls].set(idle)


def _isolated_impacts(record: RunRecord) -> Impacts:
    """Return the impacts outside of coupled solves, with the engine's numbers of bodies."""
    outcome, facts, valid = record.log.figures.outcome, record.log.facts, record.counts
    if record.calls is not None:
        valid = valid & ~record.calls
    if record.model.frictions is not None:
        # The end of sliding on a wall is not an impact.
        rolls = begins_to_roll(record.model, facts.choice)
        valid = valid & ~rolls
    choice, way = facts.choice, outcome.solved_by.astype(int)
    return Impacts(
        outcome.time, choice.first, choice.second, choice.second, outcome.closing,
        outcome.restitution, outcome.duration, outcome.max_force, outcome.energy_loss,
        outcome.turn, way, outcome.error, facts.tied, valid, (), *(outcome.sliding or (None, None)),
    )  # fmt: skip


def _coupled_contacts(record: RunRecord) -> Impacts:
    """Return the contacts that ended or came to rest in coupled solves, without lasting rest."""
    model, is_call = record.model, record.calls
    called, together = record.log.facts.call, record.log.figures.coupled
    assert called is not None and together is not None and is_call is not None
    slots = called.decided.slots
    rows = slots.who.shape[0]
    body, other = bodies_of(model, slots)
    # A fixed sphere comes second.
    turned = (other < model.spheres) & (model.inverse_mass[body] == 0)
    body, other = jnp.where(turned, other, body), jnp.where(turned, body, other)
    counts = is_call[:, None]
    began, end = together.began, together.end
    since = _began_in(together, is_call)
    opened = (began.closed > 0.5) & ~(end.closed > 0.5)
    rests = (end.closed > 0.5) & called.rest[:, None]
    # At the end of the run a contact may still be in progress.
    last = (jnp.arange(rows) == record.outcome.written - 1) & ~called.ends
    lasts = (end.closed > 0.5) & last[:, None]
    closing = jnp.where(end.latched > 0, end.latched, 1)
    e = jnp.where(rests, 0, end.parting / closing)
    duration = jnp.where(rests, jnp.inf, end.force_until - end.since)
    e, duration = (jnp.where(lasts, jnp.nan, x) for x in (e, duration))
    lost, sliding, way = end.lost, (None, None), jnp.full(opened.shape, int(SolvedBy.COUPLED))
    if end.rubbing is not None:
        lost = lost + end.rubbing.taken
        if not is_followed(model):
            springs = has_impulse(model, body, other) & (end.rubbing.slides != HALF)
            way = jnp.where(springs, int(SolvedBy.SPRING), way)

        def sliding_at(slots: Slots, state: ClusterState) -> Array:
            pairs = pairs_of(model, slots)
            bodies = bodies_of(model, slots)
            return contact_points(model, bodies, pairs, state)[2]

        at_start, at_end = (jax.vmap(sliding_at)(slots, state) for state in (began, end))
        # The call in which a contact began starts at its touch, with the same slots.
        at_touch = at_start[since, jnp.arange(since.shape[1])[None]]
        sliding = speeds_of(at_touch, at_end)
    shape = opened.shape
    nothing = jnp.zeros(shape, model.dtype)
    doubt = _doubt(together, is_call, since) / closing
    stays = (rests | lasts) & ~_was_at_rest(model, called, together, since)
    columns = Impacts(
        end.since, body, other, other, end.latched, e, duration, end.max_force, lost, nothing, way,
        doubt, jnp.zeros(shape, bool), counts & (opened | stays), (), *sliding,
    )  # fmt: skip
    return jax.tree.map(lambda x: x.reshape(-1), columns)
