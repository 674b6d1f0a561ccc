"""The rows of a log as differentiable functions: isolated impacts and coupled calls. Each depends
only on the numbers of the scene and on its own bodies. Its matrix is therefore small, however large
the scene.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float, Int

from ..._coupled.modes import Flag
from ..._coupled.rows import rows_of
from ..arrays.arrays import Flying, SceneArrays, SceneLayout
from ..arrays.movers import Turning
from ..cluster.problem import ClusterState
from ..cluster.solve import MOST_STEPS
from ..engine.coupled import work_of_walls
from ..engine.coupled_call import call, walls_under
from ..engine.log import LogDecisions, LogNumbers, RunRecord, as_flags, as_numbers
from ..engine.near_pairs import PairList
from ..engine.rest import or_roll, rest_on_walls, with_friction_at_rest
from ..engine.search import in_branch
from ..engine.slots import in_place, map_pairs, slot_pairs
from ..engine.state import index_of
from ..pair_impact.instantaneous import ImpactOutcome, hit, two_that_meet
from ..pair_impact.soft import soft


class Done(NamedTuple):
    """The output of a call: first and last state, the work of moving walls, and positions. With
    friction also the rotation after it, and the energy taken.
    """

    began: ClusterState
    end: ClusterState
    work: Array
    place: Array
    turning: Turning | None = None
    rubbed: Array | None = None


class Entering(NamedTuple):
    """The input of a call: its spheres, the v0 held by those at rest, and the previous state."""

    spheres: Flying
    held: Array
    before: ClusterState

    def followed(self, followed: PairList) -> Entering:
        """Return it with the pairs that the call follows, on which alone its end depends."""
        return self._replace(before=map_pairs(followed.columns, self.before))


def row_function(
    record: RunRecord,
    values: LogNumbers,
    facts: LogDecisions,
    counts: Flag,
    is_call: bool,
    by_formula: bool = False,
) -> tuple[Callable[[SceneArrays, Any], Any], Any, Int[Array, " M"]]:
    """Return a row as a function of the numbers of the scene and of its input; this input, and the
    spheres of the row, N or more where there is none.
    """
    if is_call:
        assert facts.call is not None
        who = index_of(record.model, facts.call.decided.slots)
        return *_row_call(record, values, facts, counts), who
    return *_row_hit(record, values, facts, counts, by_formula), two_of(record.model, facts)


def _row_hit(
    record: RunRecord, values: LogNumbers, facts: LogDecisions, counts: Flag, by_formula: bool
) -> tuple[Callable[[SceneArrays, Flying], ImpactOutcome], Flying]:
    """Return the impact of a row as a function, and the bodies before it. Rows without an impact
    use two approaching bodies.
    """
    model, rules = record.model, record.rules
    choice = facts.choice
    place = two_that_meet(model, choice.time)
    before = jax.tree.map(lambda a, b: jnp.where(counts, a, b), values.before, place)

    def strike(model: SceneArrays, before: Flying) -> ImpactOutcome:
        if rules.soft:
            outcome = soft(model, before, choice, record.tolerance, counts, by_formula)
        else:
            outcome = hit(model, before, choice)
        if model.frictions is None:
            return outcome
        outcome = or_roll(model, before, choice, outcome, rules.soft)
        return with_friction_at_rest(model, choice, outcome, facts.support)[0]

    return strike, before


def _row_call(
    record: RunRecord, values: LogNumbers, facts: LogDecisions, counts: Flag
) -> tuple[Callable[[SceneArrays, Entering], Done], Entering]:
    """Return the call of a row as a function, and its input."""
    rules = record.rules
    row, at, size = facts.call, values.coupled, rules.slots
    assert row is not None and at is not None
    # The time of rest, and that of the last step, depend on rounding. This solve would stop at
    # another time, so it runs to the known one.
    stops = row.rest | row.paused
    decided = row.decided._replace(
        choice=facts.choice,
        change=in_place(row.decided.change),
        until=jnp.where(stops, at.end.time, row.decided.until),
        to_the_end=stops,
    )

    def solve(model: SceneArrays, entering: Entering) -> Done:
        spheres, held, before = entering
        began, done = call(
            model, spheres, row.support, held, as_flags(before),
            decided.where(counts), record.tolerance, rules.v0, max_steps=2 * MOST_STEPS,
        )  # fmt: skip
        on_wall = (at.end.closed > 0.5) & row.rest & (slot_pairs(model, size)[1] >= size)
        support = walls_under(model, size, on_wall)
        done, turning, _ = rest_on_walls(model, decided.slots, done, support)
        work = work_of_walls(model, decided.slots, began, done)
        place = done.state.position[:size] + decided.slots.shift * model.period[None]
        states = as_numbers(began), as_numbers(done.state)
        return Done(*states, work, place, turning, done.rubbed)

    return solve, Entering(at.spheres, at.held, at.began)


def two_of(layout: SceneLayout, facts: LogDecisions) -> Int[Array, "2"]:
    """Return the spheres of an impact, N for a wall."""
    second = facts.choice.second
    return jnp.stack([facts.choice.first, jnp.minimum(second, layout.spheres)])


class RowNumbers(NamedTuple):
    """The numbers of a scene on which a row depends. `own` are those of its spheres, one array for
    each of `_by_body`. Others are shared: `walls` for the same arrays, the positions of `shaken`
    fixed spheres, and the `rest`, such as gravity and laws.
    """

    own: list[Float[Array, " M"] | None]
    walls: list[Float[Array, " W"] | None]
    shaken: Float[Array, "K D"] | None
    rest: SceneArrays


def _by_body(model: SceneArrays) -> list[Any]:
    """Return the arrays with a number for each sphere, most also for each wall; None if missing."""
    turns, rotation = [], model.rotation
    # `tree_at` wraps a missing rotation.
    if model.frictions is not None and rotation is not None:
        turns = [rotation.inverse_inertia, rotation.shear_compliance]
    return [model.radius, model.inverse_mass, model.compliance, *turns]


_VARY_BY_WALL = False, False, True, False, True
"""For the arrays of `_by_body`, if the numbers of walls vary: the compliances do."""


def _without_bodies(model: SceneArrays) -> SceneArrays:
    """Return the floats that belong to no sphere."""
    floats, rotation = eqx.filter(model, eqx.is_inexact_array), model.rotation
    blank: dict[str, Any] = dict.fromkeys(
        ("position", "velocity", "radius", "inverse_mass", "compliance", "start")
    )
    if rotation is not None:
        turns = dict.fromkeys(("spin", "inverse_inertia", "shear_compliance"))
        blank["rotation"] = dataclasses.replace(floats.rotation, **turns)
    return dataclasses.replace(floats, **blank)


def row_numbers(model: SceneArrays, who: Int[Array, " M"]) -> RowNumbers:
    """Return the numbers of some spheres; zeros for empty slots."""

    def at(all: Array | None) -> Array | None:
        return None if all is None else all[:spheres].at[who].get(mode="fill", fill_value=0)

    spheres, shaken, columns = model.spheres, None, _by_body(model)
    if model.shaken:
        shaken = model.position[jnp.asarray(model.shaken)]
    walls = [
        all[spheres:] if varies and all is not None else None
        for all, varies in zip(columns, _VARY_BY_WALL, strict=False)
    ]
    return RowNumbers(list(map(at, columns)), walls, shaken, _without_bodies(model))


def with_own(model: SceneArrays, who: Int[Array, " M"], own: RowNumbers) -> SceneArrays:
    """Return the numbers of a scene with those of a row inserted."""
    spheres, position = model.spheres, model.position
    if own.shaken is not None:
        position = position.at[jnp.asarray(model.shaken)].set(own.shaken)

    def put(all: Array | None, mine: Array | None, walls: Array | None) -> Array | None:
        if all is None or mine is None:
            return all
        new = all[:spheres].at[who].set(mine, mode="drop", unique_indices=True)
        return jnp.concatenate([new, all[spheres:] if walls is None else walls])

    columns = map(put, _by_body(model), own.own, own.walls)
    kept = eqx.tree_at(_by_body, model, list(columns), is_leaf=lambda leaf: leaf is None)
    return eqx.combine(own.rest, dataclasses.replace(kept, position=position))


class Matrices(NamedTuple):
    """The derivatives of rows as matrices, for impacts and for calls; None if there are none.
    `slot` is the index of a row's matrix within its kind.
    """

    hits: Float[Array, "H outcomes inputs"] | None
    calls: Float[Array, "C outcomes inputs"] | None
    slot: Int[Array, " K"]


def flat(tree: Any) -> Float[Array, " size"]:
    """Return the floats of a tree as one vector, without the flags of states."""
    return ravel_pytree(_without_flags(tree))[0]


def unflat(vector: Float[Array, " size"], like: Any) -> Any:
    """Return the inverse of `flat`, with zeros for flags."""
    moved = ravel_pytree(_without_flags(like))[1](vector)

    def number(moved: Array | None, like: Array | None) -> Array | None:
        # None is a flag, or a number that the scene does not have.
        return jnp.zeros_like(like) if moved is None and like is not None else moved

    return jax.tree.map(number, moved, like, is_leaf=lambda x: x is None)


def _without_flags(tree: Any) -> Any:
    def plain(node: Any) -> Any:
        return node._replace(closed=None, rising=None) if isinstance(node, ClusterState) else node

    return jax.tree.map(plain, tree, is_leaf=lambda x: isinstance(x, ClusterState))


class Kept(NamedTuple):
    """Rows of one kind, padded: their numbers in the log, and a mask of the valid ones."""

    row: Int[Array, " R"]
    counts: Bool[Array, " R"]


def matrices(
    record: RunRecord,
    hits: Kept | None,
    calls: Kept | None,
    slot: Int[Array, " K"],
    by_formula: bool,
) -> Matrices:
    """Return the matrices of all rows, each with respect to its own inputs."""
    model = record.model

    def of(values: LogNumbers, facts: LogDecisions, counts: Array, is_call: bool) -> Array:
        row, entry, who = row_function(record, values, facts, counts, is_call, by_formula)
        some = entry
        if is_call:
            assert facts.call is not None
            followed = PairList(model, record.rules.slots, facts.call.decided.near)
            some = entry.followed(followed)
        start, unravel = ravel_pytree(_without_flags((row_numbers(model, who), some)))

        def outcome(vector: Array) -> Array:
            mine, entering = unravel(vector)
            if is_call:
                flags = some.before
                before = entering.before._replace(closed=flags.closed, rising=flags.rising)
                entering = entering._replace(before=followed.put(before, entry.before))
            return flat(row(with_own(model, who, mine), entering))

        return jax.jacfwd(outcome)(start)

    def each(kept: Kept | None, is_call: bool) -> Array | None:
        if kept is None:
            return None

        def matrix_of_row(k: Array, counts: Array) -> Array:
            values, facts = rows_of(record.log, k)
            return in_branch(counts, lambda: of(values, facts, counts, is_call))

        return jax.lax.map(lambda rows: matrix_of_row(*rows), kept)

    return Matrices(each(hits, False), each(calls, True), slot)
