"""The derivative of a run: its impacts replayed in order, for tangents only.

The search is never differentiated. A rule that is linear in the tangents acts on its log. Row by
row it maps the tangents before an impact, and those of the scene's numbers, to the tangents after
it. Since it is linear it transposes, so that one search serves both modes. It uses the recorded
states and therefore does not drift from them, even in a chaotic scene.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Int

from ..._coupled.modes import Flag, Index
from ..._coupled.rows import rows_of, with_rows
from ..arrays.arrays import Flying, SceneArrays, where_each
from ..cluster.problem import ClusterState
from ..engine.log import ClusterNumbers, LogDecisions, LogNumbers, RunRecord
from ..engine.near_pairs import PairList
from ..engine.rest import flying_at_start
from ..engine.slots import rearrange, slot_pairs
from ..engine.state import index_of
from ..pair_impact.instantaneous import ImpactOutcome
from .slopes import Done, Entering, Matrices, flat, row_function, row_numbers, two_of, unflat


class _ReplayedRow(NamedTuple):
    """A row of the log; whether it `counts`, and the `slot` of its matrix."""

    values: LogNumbers
    facts: LogDecisions
    counts: Flag
    slot: Index


_Way = Callable[[_ReplayedRow, Any], Any]
"""A map of the tangents before a row to those of its outcome."""


def push_tangents(record: RunRecord, along: SceneArrays) -> LogNumbers:
    """Return the tangents of the figures; each row is solved again for its own."""
    leaves, rest = eqx.partition(record.model, eqx.is_inexact_array)

    def way(is_call: bool) -> _Way:
        def moved(row: _ReplayedRow, entering: Any) -> Any:
            solve, place, _ = row_function(record, *row[:3], is_call)

            def of(leaves: Any, entering: Any) -> Any:
                return solve(eqx.combine(leaves, rest), entering)

            return jax.jvp(of, (leaves, place), (along, entering))[1]

        return moved

    slot = jnp.arange(record.log.facts.tied.shape[0])
    has_calls = record.log.facts.call is not None
    return _chain(record, along, way(False), way(True) if has_calls else None, slot)


def chain_matrices(record: RunRecord, matrices: Matrices, along: SceneArrays) -> LogNumbers:
    """Return the tangents of the figures by the matrices of the rows."""

    def hit(row: _ReplayedRow, before: Flying) -> ImpactOutcome:
        assert matrices.hits is not None
        start = flat((row_numbers(along, two_of(along, row.facts)), before))
        return unflat(matrices.hits[row.slot] @ start, row.values.outcome)

    def coupled(row: _ReplayedRow, entering: Entering) -> Done:
        called, at = row.facts.call, row.values.coupled
        assert matrices.calls is not None and called is not None and at is not None
        own = row_numbers(along, index_of(along, called.decided.slots))
        followed = PairList(record.model, record.rules.slots, called.decided.near)
        start = flat((own, entering.followed(followed)))
        place = entering.spheres.position
        like = Done(at.began, at.end, at.work, place, at.turning, at.rubbed)
        return unflat(matrices.calls[row.slot] @ start, like)

    ways = None if matrices.hits is None else hit, None if matrices.calls is None else coupled
    return _chain(record, along, *ways, matrices.slot)


class _Tangents(NamedTuple):
    """Tangents of the spheres, and of the coupled solve in progress."""

    spheres: Flying
    coupled: ClusterState | None
    held: Array


def _chain(
    record: RunRecord,
    along: SceneArrays,
    hit: _Way | None,
    call: _Way | None,
    slot: Int[Array, " K"],
) -> LogNumbers:
    """Return the tangents of the figures by the maps of isolated impacts and of calls; None if
    there are no such rows.
    """
    model, size = record.model, record.rules.slots

    def impact(carry: _Tangents, row: _ReplayedRow) -> tuple[_Tangents, LogNumbers]:
        assert hit is not None
        values, facts, counts, _ = row
        first, second = facts.choice.first, jnp.minimum(facts.choice.second, model.spheres - 1)
        is_sphere = facts.choice.second < model.spheres
        who = jnp.stack([first, jnp.where(is_sphere, second, first)])
        before = rows_of(carry.spheres, who)
        outcome, before = jax.tree.map(
            lambda x: jnp.where(counts, x, jnp.zeros_like(x)), (hit(row, before), before)
        )

        rows = jnp.stack([counts, counts & is_sphere])
        rows = jnp.where(rows, who, model.spheres + jnp.arange(2))
        moved = with_rows(carry.spheres, rows, outcome.after)
        together = jax.tree.map(jnp.zeros_like, values.coupled)
        return carry._replace(spheres=moved), LogNumbers(before, outcome, together)

    def together(carry: _Tangents, row: _ReplayedRow) -> tuple[_Tangents, LogNumbers]:
        assert call is not None and carry.coupled is not None
        called, values, at = row.facts.call, row.values, row.values.coupled
        assert called is not None and at is not None
        slots = called.decided.slots
        who, index = jnp.minimum(slots.who, model.spheres - 1), index_of(model, slots)
        # In the slots of this call; before it they may have held other bodies.
        before = rearrange(carry.coupled, called.decided.change)
        spheres, held = rows_of((carry.spheres, carry.held), who)
        done = call(row, Entering(spheres, held, before))
        began, end, work = done.began, done.end, done.work

        time, velocity = jnp.broadcast_to(end.time, (size,)), end.velocity[:size]
        after = Flying(done.place, velocity, time, done.turning)
        first, second = slot_pairs(model, size)
        on_wall = (at.end.closed > 0.5) & (second >= size) & called.rest
        latched = jnp.zeros_like(held).at[first].add(jnp.where(on_wall, end.latched, 0))
        nothing = jax.tree.map(jnp.zeros_like, values)
        figures = nothing._replace(
            outcome=nothing.outcome._replace(time=began.time),
            coupled=ClusterNumbers(
                spheres, held, began, end, work, jnp.zeros_like(work), done.turning, done.rubbed
            ),
        )
        moved, held = with_rows((carry.spheres, carry.held), index, (after, latched))
        return _Tangents(moved, end, held), figures

    def nothing(carry: _Tangents, row: _ReplayedRow) -> tuple[_Tangents, LogNumbers]:
        return carry, jax.tree.map(jnp.zeros_like, row.values)

    def pass_row(carry: _Tangents, row: _ReplayedRow) -> tuple[_Tangents, LogNumbers]:
        other = nothing if hit is None else impact
        if call is None:
            return other(carry, row)
        assert row.facts.call is not None
        is_call = row.facts.call.is_call & row.counts
        this, that = row._replace(counts=is_call), row._replace(counts=row.counts & ~is_call)
        return jax.lax.cond(is_call, lambda: together(carry, this), lambda: other(carry, that))

    rows = _ReplayedRow(*record.log, record.counts, slot)
    return jax.lax.scan(pass_row, _initial_tangents(record, along), rows)[1]


def _initial_tangents(record: RunRecord, along: SceneArrays) -> _Tangents:
    model, log = record.model, record.log
    leaves, rest = eqx.partition(model, eqx.is_inexact_array)

    def begun(leaves: Any) -> Flying:
        return flying_at_start(eqx.combine(leaves, rest))

    start = jax.jvp(begun, (leaves,), (along,))[1]
    held = jnp.zeros(model.spheres, along.position.dtype)
    coupled = None
    if log.figures.coupled is not None:
        coupled = jax.tree.map(lambda x: jnp.zeros_like(x[0]), log.figures.coupled.end)
    if model.start is not None and along.start is not None:
        underway, moves = model.start.underway, along.start.underway
        if underway is not None and moves is not None:
            led = Flying(moves.position, moves.velocity, moves.time, moves.turning)
            start = where_each(underway.counts, led, start)
        held = along.start.held
        if coupled is not None and along.start.contacts is not None:
            began = along.start.contacts.state._asdict()
            # Flags have no derivative.
            coupled = coupled._replace(**{k: x for k, x in began.items() if x is not None})
    return _Tangents(start, coupled, held)
