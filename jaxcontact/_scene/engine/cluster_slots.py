"""The slots of a coupled solve: a number of spheres, all walls, and the pairs that can meet. If the
solve has room for all spheres and no axis is periodic, each sphere has its own slot and joins or
leaves by a flag. Otherwise the bodies near a contact are gathered into the slots.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..._coupled.modes import Flag
from ..._coupled.rows import rows_of
from ..arrays.arrays import SceneArrays, SceneLayout
from ..cluster.equations import ClusterPairs, ClusterState
from ..cluster.friction import Rubbing


class Slots(NamedTuple):
    """The assignment of slots. `who` (M,) holds the spheres, of which those `present` are in the
    solve. `shift` (M, D) is the number of periods between each sphere and its solved image.
    """

    who: Int[Array, " M"]
    present: Bool[Array, " M"]
    shift: Float[Array, "M D"]


def in_line(layout: SceneLayout) -> bool:
    """Return whether spheres keep their order, so that only neighbours meet."""
    return layout.dimensions == 1 and layout.visible == layout.spheres and not layout.driven


def all_fit(layout: SceneLayout, members: int) -> bool:
    """Return whether every sphere has a slot of its own."""
    return members == layout.spheres and not any(layout.periodic)


def slot_pairs(layout: SceneLayout, members: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the first and second slot of every pair that can meet, (P,) each; walls come last."""
    by_sphere = all_fit(layout, members) and not in_line(layout)
    fixed = np.zeros(members + layout.walls, bool)
    fixed[:members], fixed[members:] = layout.fixed if by_sphere else False, True
    first, second = np.triu_indices(members, 1, members + layout.walls)
    meet = ~(fixed[first] & fixed[second])
    if in_line(layout):
        meet &= (second >= members) | (second == first + 1)
    first, second = first[meet], second[meet]
    # A fixed sphere comes second.
    return np.where(fixed[first], second, first), np.where(fixed[first], first, second)


def identity_slots(model: SceneArrays) -> Int[Array, " N"]:
    """Return the sphere of each slot if all spheres have one; in a line, by their order."""
    if in_line(model):
        return jnp.argsort(model.position[:, 0])
    return jnp.arange(model.spheres)


def empty_slots(model: SceneArrays, members: int) -> Slots:
    """Return seats with no sphere present."""
    who = jnp.full(members, model.spheres, int)
    if all_fit(model, members):
        who = identity_slots(model)
    return Slots(who, who < 0, jnp.zeros((members, model.dimensions), model.dtype))


def index_of(layout: SceneLayout, seats: Slots) -> Int[Array, " M"]:
    """Return the sphere in each slot, or a unique number from N on for empty slots. Each number
    occurs once, so that it can index a write.
    """
    members = seats.who.shape[0]
    return jnp.where(seats.present, seats.who, layout.spheres + jnp.arange(members))


def bodies_of(
    layout: SceneLayout, members: int, who: Int[Array, "*K M"]
) -> tuple[Int[Array, "*K P"], Int[Array, "*K P"]]:
    """Return the first and second body of every pair, numbered as in the engine."""
    first, second = slot_pairs(layout, members)
    walls = jnp.broadcast_to(
        layout.spheres + jnp.arange(layout.walls), (*who.shape[:-1], layout.walls)
    )
    all_of_them = jnp.concatenate([jnp.minimum(who, layout.spheres - 1), walls], axis=-1)

    def body_at(which: np.ndarray) -> Array:
        return all_of_them.at[..., which].get(mode="promise_in_bounds", wrap_negative_indices=False)

    return body_at(first), body_at(second)


def pairs_of(model: SceneArrays, members: int, seats: Slots) -> ClusterPairs:
    """Return the pairs; those with an absent body are not used."""
    first, second = slot_pairs(model, members)
    one, other = bodies_of(model, members, seats.who)
    flat = second >= members
    radius = jnp.concatenate([model.radius, jnp.zeros(model.walls, model.dtype)])
    none = jnp.zeros((members, model.dimensions), model.dtype)
    inside = jnp.concatenate([seats.present, jnp.ones(model.walls, bool)])
    moves = model.inverse_mass > 0
    return ClusterPairs(
        first=jnp.asarray(first),
        second=jnp.asarray(second),
        distance=rows_of(radius, one) + rows_of(radius, other),
        normal=rows_of(jnp.concatenate([none, model.normal]), second),
        flat=jnp.asarray(flat),
        used=rows_of(inside, first)
        & rows_of(inside, second)
        & (rows_of(moves, one) | rows_of(moves, other)),
    )


class MemberChange(NamedTuple):
    """The change of members between two calls. `joined` (M,) marks slots with a new body, and
    `fresh` (P,) marks new pairs. `source` (M,) and `pair_source` (P,) are the previous slots of
    bodies and pairs that stay; None if none moves.
    """

    joined: Bool[Array, " M"]
    fresh: Bool[Array, " P"]
    source: Int[Array, " M"] | None
    pair_source: Int[Array, " P"] | None


def member_change(
    layout: SceneLayout, members: int, old: Slots, new: Slots, starts: Flag
) -> MemberChange:
    """Return the change between two calls; at a start all bodies join."""
    first, second = slot_pairs(layout, members)
    if all_fit(layout, members):
        joined = new.present & (starts | ~old.present)
        return joins(layout, members, joined)
    same = (new.who[:, None] == old.who[None]) & new.present[:, None] & old.present[None]
    stays = jnp.any(same, axis=1) & ~starts
    one, other = bodies_of(layout, members, new.who)
    was_one, was_other = bodies_of(layout, members, old.who)
    straight = (one[:, None] == was_one[None]) & (other[:, None] == was_other[None])
    turned = (one[:, None] == was_other[None]) & (other[:, None] == was_one[None])
    walls = jnp.ones(layout.walls, bool)
    before, now = (jnp.concatenate([seats.present, walls]) for seats in (old, new))
    pair = (straight | turned) & (before[first] & before[second])[None]
    pair = pair & (now[first] & now[second])[:, None]
    fresh = starts | ~jnp.any(pair, axis=1)
    return MemberChange(
        new.present & ~stays, fresh, jnp.argmax(same, axis=1), jnp.argmax(pair, axis=1)
    )


def joins(layout: SceneLayout, members: int, joined: Bool[Array, " M"]) -> MemberChange:
    """Return the change in which some bodies join and the others keep their slots."""
    first, second = slot_pairs(layout, members)
    walls = jnp.concatenate([joined, jnp.zeros(layout.walls, bool)])
    fresh = walls[first] | walls[second]
    if all_fit(layout, members):
        return MemberChange(joined, fresh, None, None)
    return MemberChange(joined, fresh, jnp.arange(members), jnp.arange(first.shape[0]))


def no_change(layout: SceneLayout, members: int) -> MemberChange:
    """Return the change in which all bodies stay."""
    return joins(layout, members, jnp.zeros(members, bool))


def in_place(change: MemberChange) -> MemberChange:
    """Return the change for a state that is already in the slots of this call."""
    return change._replace(source=None, pair_source=None)


def rearrange(state: ClusterState, change: MemberChange, members: int) -> ClusterState:
    """Return a state with its bodies and pairs in the slots of the next call."""
    if change.source is None:
        return state
    walls = jnp.arange(members, state.position.shape[0])
    slots = jnp.concatenate([change.source, walls])
    vectors = {"position": state.position[slots], "velocity": state.velocity[slots]}
    kept: dict[str, Any] = {"time": state.time, **vectors, "rubbing": None}
    pairs = {
        name: value[change.pair_source]
        for name, value in state._asdict().items()
        if name not in kept and value is not None
    }
    if state.rubbing is not None:
        spin, *springs = state.rubbing
        kept["rubbing"] = Rubbing(spin[slots], *(x[change.pair_source] for x in springs))
    return ClusterState(**kept, **pairs)


def in_places(layout: SceneLayout, old: Any, blank: Any, members: tuple[int, int]) -> Any:
    """Return the tree `old` of a coupled solve in the larger one of two numbers of `members`, as
    that of `blank`. Both may be rows of a log.
    """
    few, many = members
    numbered = {pair: k for k, pair in enumerate(zip(*slot_pairs(layout, many), strict=True))}
    slots = np.concatenate([np.arange(few), many + np.arange(layout.walls)])
    of_pairs = (slots[slot] for slot in slot_pairs(layout, few))
    pairs = np.array([numbered[pair] for pair in zip(*of_pairs, strict=True)])
    # Axes of spheres, of all slots and of pairs differ in their lengths.
    places = {few: slots[:few], slots.size: slots, pairs.size: pairs}

    def moved(path: Any, rows: Any, row: Any) -> np.ndarray:
        rows, row = np.asarray(rows), np.asarray(row)
        differs = [k for k in range(1, row.ndim + 1) if rows.shape[-k] != row.shape[-k]]
        axis = next((k for k in differs if rows.shape[-k] in places), None)
        if axis is None:
            return rows
        where = places[rows.shape[-axis]]
        if "pair_source" in jax.tree_util.keystr(path):
            rows = pairs[rows]
        shape = (*rows.shape[: rows.ndim - axis], *row.shape[row.ndim - axis :])
        there = np.broadcast_to(row, shape).copy()
        there[(..., where, *(slice(None),) * (axis - 1))] = rows
        return there

    return jax.tree_util.tree_map_with_path(moved, old, blank)


def masses(model: SceneArrays, seats: Slots) -> Float[Array, " M"]:
    """Return the masses of the spheres present; 0 for fixed ones."""
    inverse = rows_of(model.inverse_mass, jnp.minimum(seats.who, model.spheres - 1))
    free = seats.present & (inverse > 0)
    return jnp.where(free, 1 / jnp.where(free, inverse, 1), 0)


def resting_pairs(
    layout: SceneLayout, members: int, support: Int[Array, " M"]
) -> Bool[Array, " P"]:
    """Return the pairs of a sphere and the wall on which it rests."""
    first, second = slot_pairs(layout, members)
    return (support[first] == second - members) & (support[first] >= 0)
