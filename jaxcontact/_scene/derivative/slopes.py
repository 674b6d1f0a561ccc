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

from ..._coupled.modes import Flag, Number
from ..._coupled.rows import rows_of
from ..arrays.arrays import Flying, SceneArrays, SceneLayout
from ..arrays.movers import Rotation, Turning
from ..cluster.problem import ClusterState
from ..cluster.solve import MOST_STEPS
from ..engine.coupled import call, walls_under, work_of_walls
from ..engine.log import Log, LogDecisions, LogNumbers, as_flags, as_numbers
from ..engine.rest import or_roll, rest_on_walls, with_friction_at_rest
from ..engine.search import in_branch
from ..engine.slots import in_place, slot_pairs
from ..engine.state import Rules, index_of
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


def row_hit(
    layout: SceneLayout,
    rules: Rules,
    values: LogNumbers,
    facts: LogDecisions,
    counts: Flag,
    tolerance: Number,
    by_formula: bool = False,
) -> tuple[Callable[[SceneArrays, Flying], ImpactOutcome], Flying]:
    """Return the impact of a row as a function, and the bodies before it. Rows without an impact
    use two approaching bodies.
    """
    choice = facts.choice
    place = two_that_meet(layout, choice.time)
    before = jax.tree.map(lambda a, b: jnp.where(counts, a, b), values.before, place)

    def strike(model: SceneArrays, before: Flying) -> ImpactOutcome:
        if rules.soft:
            outcome = soft(model, before, choice, tolerance, counts, by_formula)
        else:
            outcome = hit(model, before, choice)
        if model.frictions is None:
            return outcome
        outcome = or_roll(model, before, choice, outcome, rules.soft)
        return with_friction_at_rest(model, choice, outcome, facts.support)[0]

    return strike, before


def row_call(
    rules: Rules, values: LogNumbers, facts: LogDecisions, counts: Flag, tolerance: Number
) -> tuple[Callable[[SceneArrays, Entering], Done], Entering]:
    """Return the call of a row as a function, and its input."""
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
            decided.where(counts), tolerance, rules.v0, max_steps=2 * MOST_STEPS,
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
    """The numbers of a scene on which a row depends. These are the numbers of its spheres, and
    shared ones: walls, gravity, laws. The positions of shaken fixed spheres are also shared. The
    numbers of rotation are None without friction.
    """

    radius: Float[Array, " M"]
    inverse_mass: Float[Array, " M"]
    compliance: Float[Array, " M"] | None
    of_walls: Float[Array, " W"] | None
    shaken: Float[Array, "K D"] | None
    inverse_inertia: Float[Array, " M"] | None
    shear: tuple[Float[Array, " M"], Float[Array, " W"]] | None
    rest: SceneArrays


def row_numbers(model: SceneArrays, who: Int[Array, " M"]) -> RowNumbers:
    """Return the numbers of some spheres; zeros for empty slots."""

    def at(all: Array) -> Array:
        return all.at[who].get(mode="fill", fill_value=0)

    compliance, shaken = model.compliance, None
    if model.shaken:
        shaken = model.position[jnp.asarray(model.shaken)]
    spheres, rotation = model.spheres, model.rotation
    shear = None if rotation is None else rotation.shear_compliance
    return RowNumbers(
        at(model.radius),
        at(model.inverse_mass[:spheres]),
        None if compliance is None else at(compliance[:spheres]),
        None if compliance is None else compliance[spheres:],
        shaken,
        None if rotation is None else at(rotation.inverse_inertia[:spheres]),
        None if shear is None else (at(shear[:spheres]), shear[spheres:]),
        dataclasses.replace(
            eqx.filter(model, eqx.is_inexact_array),
            position=None, velocity=None, radius=None, inverse_mass=None, compliance=None,
            start=None, rotation=_shared(rotation),
        ),
    )  # fmt: skip


def _shared(rotation: Rotation | None) -> Rotation | None:
    """Return the numbers of friction that belong to no sphere."""
    if rotation is None:
        return None
    floats = eqx.filter(rotation, eqx.is_inexact_array)
    return dataclasses.replace(floats, spin=None, inverse_inertia=None, shear_compliance=None)


def with_own(model: SceneArrays, who: Int[Array, " M"], own: RowNumbers) -> SceneArrays:
    """Return the numbers of a scene with those of a row inserted."""

    def put(all: Array, new: Array) -> Array:
        return all.at[who].set(new, mode="drop", unique_indices=True)

    spheres, position, compliance = model.spheres, model.position, model.compliance
    if own.shaken is not None:
        position = position.at[jnp.asarray(model.shaken)].set(own.shaken)
    inverse = model.inverse_mass
    inverse = jnp.concatenate([put(inverse[:spheres], own.inverse_mass), inverse[spheres:]])
    if compliance is not None and own.compliance is not None and own.of_walls is not None:
        compliance = jnp.concatenate([put(compliance[:spheres], own.compliance), own.of_walls])
    rotation = model.rotation
    if rotation is not None and own.inverse_inertia is not None:
        turns, shear = rotation.inverse_inertia, rotation.shear_compliance
        turns = jnp.concatenate([put(turns[:spheres], own.inverse_inertia), turns[spheres:]])
        if shear is not None and own.shear is not None:
            shear = jnp.concatenate([put(shear[:spheres], own.shear[0]), own.shear[1]])
        rotation = dataclasses.replace(rotation, inverse_inertia=turns, shear_compliance=shear)
    kept = dataclasses.replace(
        model,
        position=position,
        radius=put(model.radius, own.radius),
        inverse_mass=inverse,
        compliance=compliance,
        rotation=rotation,
    )
    return eqx.combine(own.rest, kept)


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
    def is_state(node: Any) -> bool:
        return isinstance(node, ClusterState)

    def plain(node: Any) -> Any:
        return node._replace(closed=None, rising=None) if is_state(node) else node

    return jax.tree.map(plain, tree, is_leaf=is_state)


class Kept(NamedTuple):
    """Rows of one kind, padded: their numbers in the log, and a mask of the valid ones."""

    row: Int[Array, " R"]
    counts: Bool[Array, " R"]


def matrices(
    model: SceneArrays,
    rules: Rules,
    log: Log,
    hits: Kept | None,
    calls: Kept | None,
    slot: Int[Array, " K"],
    tolerance: Number,
    by_formula: bool,
) -> Matrices:
    """Return the matrices of all rows, each with respect to its own inputs."""

    def of(values: LogNumbers, facts: LogDecisions, counts: Array, is_call: bool) -> Array:
        entry: Any
        if is_call:
            row, entry = row_call(rules, values, facts, counts, tolerance)
            assert facts.call is not None
            who = index_of(model, facts.call.decided.slots)
        else:
            row, entry = row_hit(model, rules, values, facts, counts, tolerance, by_formula)
            who = two_of(model, facts)
        start, unravel = ravel_pytree(_without_flags((row_numbers(model, who), entry)))

        def outcome(vector: Array) -> Array:
            mine, entering = unravel(vector)
            if is_call:
                flags = entry.before
                before = entering.before._replace(closed=flags.closed, rising=flags.rising)
                entering = entering._replace(before=before)
            return flat(row(with_own(model, who, mine), entering))

        return jax.jacfwd(outcome)(start)

    def each(kept: Kept | None, is_call: bool) -> Array | None:
        if kept is None:
            return None

        def matrix_of_row(k: Array, counts: Array) -> Array:
            values, facts = rows_of(log, k)
            return in_branch(counts, lambda: of(values, facts, counts, is_call))

        return jax.lax.map(lambda rows: matrix_of_row(*rows), kept)

    return Matrices(each(hits, False), each(calls, True), slot)
