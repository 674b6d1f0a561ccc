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

from ..._coupled.modes import Flag, Index, Number
from ..._coupled.rows import rows_of, with_rows
from ..arrays.arrays import Flying, SceneArrays, where_each
from ..cluster.problem import ClusterState
from ..engine.log import ClusterNumbers, Log, LogDecisions, LogNumbers
from ..engine.rest import flying_at_start
from ..engine.slots import rearrange, slot_pairs
from ..engine.state import Rules, index_of
from ..pair_impact.instantaneous import ImpactOutcome
from .slopes import Done, Entering, Matrices, flat, row_call, row_hit, row_numbers, two_of, unflat


class _ReplayedRow(NamedTuple):
    """A row of the log; whether it `counts`, and the `slot` of its matrix."""

    values: LogNumbers
    facts: LogDecisions
    counts: Flag
    slot: Index


class _Ways(NamedTuple):
    """The maps of tangents through a row; None if there are no such rows. `hit` maps the tangents
    of the bodies before an impact to those of its outcome. `call` maps those of a call's input to
    its output.
    """

    hit: Callable[[_ReplayedRow, Flying], ImpactOutcome] | None
    call: Callable[[_ReplayedRow, Entering], Done] | None


def push_tangents(
    model: SceneArrays,
    rules: Rules,
    log: Log,
    written: Index,
    tolerance: Number,
    along: SceneArrays,
) -> LogNumbers:
    """Return the tangents of the figures; each row is solved again for its own."""
    leaves, rest = eqx.partition(model, eqx.is_inexact_array)

    def hit(row: _ReplayedRow, before: Flying) -> ImpactOutcome:
        strike, place = row_hit(model, rules, *row[:3], tolerance)

        def of(leaves: Any, before: Flying) -> ImpactOutcome:
            return strike(eqx.combine(leaves, rest), before)

        return jax.jvp(of, (leaves, place), (along, before))[1]

    def coupled(row: _ReplayedRow, entering: Entering) -> Done:
        solve, place = row_call(rules, *row[:3], tolerance)

        def of(leaves: Any, entering: Entering) -> Done:
            return solve(eqx.combine(leaves, rest), entering)

        return jax.jvp(of, (leaves, place), (along, entering))[1]

    ways = _Ways(hit, None if log.facts.call is None else coupled)
    slot = jnp.arange(log.facts.tied.shape[0])
    return _chain(model, rules, log, written, along, ways, slot)


def chain_matrices(
    model: SceneArrays,
    rules: Rules,
    log: Log,
    written: Index,
    matrices: Matrices,
    along: SceneArrays,
) -> LogNumbers:
    """Return the tangents of the figures by the matrices of the rows."""
    hits, calls = matrices.hits, matrices.calls

    def hit(row: _ReplayedRow, before: Flying) -> ImpactOutcome:
        assert hits is not None
        start = flat((row_numbers(along, two_of(model, row.facts)), before))
        return unflat(hits[row.slot] @ start, row.values.outcome)

    def coupled(row: _ReplayedRow, entering: Entering) -> Done:
        called, at = row.facts.call, row.values.coupled
        assert calls is not None and called is not None and at is not None
        start = flat((row_numbers(along, index_of(model, called.decided.slots)), entering))
        place = entering.spheres.position
        like = Done(at.began, at.end, at.work, place, at.turning, at.rubbed)
        return unflat(calls[row.slot] @ start, like)

    ways = _Ways(None if hits is None else hit, None if calls is None else coupled)
    return _chain(model, rules, log, written, along, ways, matrices.slot)


class _Tangents(NamedTuple):
    """Tangents of the spheres, and of the coupled solve in progress."""

    spheres: Flying
    coupled: ClusterState | None
    held: Array


def _chain(
    model: SceneArrays,
    rules: Rules,
    log: Log,
    written: Index,
    along: SceneArrays,
    ways: _Ways,
    slot: Int[Array, " K"],
) -> LogNumbers:
    def impact(carry: _Tangents, row: _ReplayedRow) -> tuple[_Tangents, LogNumbers]:
        assert ways.hit is not None
        values, facts, counts, _ = row
        first, second = facts.choice.first, jnp.minimum(facts.choice.second, model.spheres - 1)
        is_sphere = facts.choice.second < model.spheres
        who = jnp.stack([first, jnp.where(is_sphere, second, first)])
        before = rows_of(carry.spheres, who)
        outcome, before = jax.tree.map(
            lambda x: jnp.where(counts, x, jnp.zeros_like(x)), (ways.hit(row, before), before)
        )

        rows = jnp.stack([counts, counts & is_sphere])
        rows = jnp.where(rows, who, model.spheres + jnp.arange(2))
        moved = with_rows(carry.spheres, rows, outcome.after)
        together = jax.tree.map(jnp.zeros_like, values.coupled)
        return carry._replace(spheres=moved), LogNumbers(before, outcome, together)

    def together(carry: _Tangents, row: _ReplayedRow) -> tuple[_Tangents, LogNumbers]:
        assert ways.call is not None and carry.coupled is not None
        values, size = row.values, rules.slots
        called, at = row.facts.call, values.coupled
        assert called is not None and at is not None
        slots = called.decided.slots
        who, index = jnp.minimum(slots.who, model.spheres - 1), index_of(model, slots)
        # In the slots of this call; before it they may have held other bodies.
        before = rearrange(carry.coupled, called.decided.change)
        spheres, held = rows_of((carry.spheres, carry.held), who)
        done = ways.call(row, Entering(spheres, held, before))
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
        other = nothing if ways.hit is None else impact
        if ways.call is None:
            return other(carry, row)
        assert row.facts.call is not None
        is_call = row.facts.call.is_call & row.counts
        this, that = row._replace(counts=is_call), row._replace(counts=row.counts & ~is_call)
        return jax.lax.cond(is_call, lambda: together(carry, this), lambda: other(carry, that))

    rows = _ReplayedRow(*log, jnp.arange(log.facts.tied.shape[0]) < written, slot)
    return jax.lax.scan(pass_row, _initial_tangents(model, log, along), rows)[1]


def _start_of_spheres(model: SceneArrays, along: SceneArrays) -> Flying:
    """Return the tangents of all spheres at the start of a run."""
    leaves, rest = eqx.partition(model, eqx.is_inexact_array)

    def of(leaves: Any) -> Flying:
        return flying_at_start(eqx.combine(leaves, rest))

    return jax.jvp(of, (leaves,), (along,))[1]


def _initial_tangents(model: SceneArrays, log: Log, along: SceneArrays) -> _Tangents:
    held = jnp.zeros(model.spheres, along.position.dtype)
    start = _start_of_spheres(model, along)
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
