"""The places of a coupled solve: so many spheres, all walls, and the pairs of them that can meet.

Where the solve has room for all spheres and no axis is periodic, everyone has a place of its own
and comes and goes by flags. Else the bodies near a contact are gathered into the places.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..arrays.arrays import Layout, Numbers
from ..arrays.rows import rows_of, with_rows
from ..cluster.equations import ClusterState, Pairs


class Seats(NamedTuple):
    """Who sits where: spheres `who` (M,), of which those are in the solve that are `present`; how
    many periods each of them is away from the image that is solved, `shift` (M, D).
    """

    who: Int[Array, " M"]
    present: Bool[Array, " M"]
    shift: Float[Array, "M D"]


def in_line(layout: Layout) -> bool:
    """Whether spheres keep their order, so that only neighbours meet."""
    return layout.dimensions == 1 and layout.visible == layout.spheres and not layout.driven


def everyone(layout: Layout, members: int) -> bool:
    """Whether every sphere has a place of its own."""
    return members == layout.spheres and not any(layout.periodic)


def places(layout: Layout, members: int) -> tuple[np.ndarray, np.ndarray]:
    """First and second place of every pair that can meet, (P,) each; walls come after spheres."""
    own = everyone(layout, members) and not in_line(layout)
    fixed = layout.fixed if own else (False,) * members
    pairs = [
        (i, j)
        for i in range(members)
        for j in range(i + 1, members + layout.walls)
        if j >= members or not in_line(layout) or j == i + 1
        if not (fixed[i] and (j >= members or fixed[j]))
    ]
    # A fixed sphere comes second.
    turned = [(j, i) if fixed[i] and j < members else (i, j) for i, j in pairs]
    first, second = np.array(turned, int).reshape(-1, 2).T
    return first, second


def own_places(layout: Layout, numbers: Numbers) -> Int[Array, " N"]:
    """Who sits where if everyone has a place: in a line, by the order in it."""
    if in_line(layout):
        return jnp.argsort(numbers.position[:, 0])
    return jnp.arange(layout.spheres)


def empty_seats(layout: Layout, numbers: Numbers, members: int) -> Seats:
    """Nobody is present."""
    who = jnp.full(members, layout.spheres)
    if everyone(layout, members):
        who = own_places(layout, numbers)
    return Seats(who, who < 0, jnp.zeros((members, layout.dimensions), numbers.dtype))


def index_of(layout: Layout, seats: Seats) -> Int[Array, " M"]:
    """The sphere in each place, and some number from N on in those where nobody is present: where
    to put what the places hold, each number once.
    """
    members = seats.who.shape[0]
    return jnp.where(seats.present, seats.who, layout.spheres + jnp.arange(members))


def put(all: Array, index: Int[Array, " M"], new: Array) -> Array:
    """What the places hold, at their spheres."""
    return with_rows(all, index, new)


def bodies_of(
    layout: Layout, members: int, who: Int[Array, "*K M"]
) -> tuple[Int[Array, "*K P"], Int[Array, "*K P"]]:
    """First and second body of every pair, numbered as those of the engine."""
    first, second = places(layout, members)
    walls = jnp.broadcast_to(
        layout.spheres + jnp.arange(layout.walls), (*who.shape[:-1], layout.walls)
    )
    all_of_them = jnp.concatenate([jnp.minimum(who, layout.spheres - 1), walls], axis=-1)

    def named(which: np.ndarray) -> Array:
        return all_of_them.at[..., which].get(mode="promise_in_bounds", wrap_negative_indices=False)

    return named(first), named(second)


def pairs_of(layout: Layout, numbers: Numbers, members: int, seats: Seats) -> Pairs:
    """The pairs; those of bodies that are elsewhere are not used."""
    first, second = places(layout, members)
    one, other = bodies_of(layout, members, seats.who)
    flat = second >= members
    radius = jnp.concatenate([numbers.radius, jnp.zeros(layout.walls, numbers.dtype)])
    none = jnp.zeros((members, layout.dimensions), numbers.dtype)
    inside = jnp.concatenate([seats.present, jnp.ones(layout.walls, bool)])
    moves = numbers.inverse_mass > 0
    return Pairs(
        first=jnp.asarray(first),
        second=jnp.asarray(second),
        distance=rows_of(radius, one) + rows_of(radius, other),
        normal=rows_of(jnp.concatenate([none, numbers.normal]), second),
        flat=jnp.asarray(flat),
        used=rows_of(inside, first)
        & rows_of(inside, second)
        & (rows_of(moves, one) | rows_of(moves, other)),
    )


class Change(NamedTuple):
    """From one call to the next: which places hold a body that `joined` (M,), which pairs are
    `fresh` (P,), and where a body and a pair that stay were before, `source` (M,) and
    `pair_source` (P,); None where all stay where they were.
    """

    joined: Bool[Array, " M"]
    fresh: Bool[Array, " P"]
    source: Int[Array, " M"] | None
    pair_source: Int[Array, " P"] | None


def change_of(
    layout: Layout, members: int, old: Seats, new: Seats, starts: Bool[Array, ""]
) -> Change:
    """What changes between two calls; at a start all bodies join."""
    first, second = places(layout, members)
    if everyone(layout, members):
        joined = new.present & (starts | ~old.present)
        return joining(layout, members, joined)
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
    return Change(new.present & ~stays, fresh, jnp.argmax(same, axis=1), jnp.argmax(pair, axis=1))


def joining(layout: Layout, members: int, joined: Bool[Array, " M"]) -> Change:
    """Some join, and the others keep their places."""
    first, second = places(layout, members)
    walls = jnp.concatenate([joined, jnp.zeros(layout.walls, bool)])
    fresh = walls[first] | walls[second]
    if everyone(layout, members):
        return Change(joined, fresh, None, None)
    return Change(joined, fresh, jnp.arange(members), jnp.arange(first.shape[0]))


def unchanged(layout: Layout, members: int) -> Change:
    """Nobody moves."""
    return joining(layout, members, jnp.zeros(members, bool))


def in_place(change: Change) -> Change:
    """The same for a state that is in the places of this call already."""
    return change._replace(source=None, pair_source=None)


def rearranged(state: ClusterState, change: Change, members: int) -> ClusterState:
    """A state with its bodies and pairs in the places of the next call."""
    if change.source is None:
        return state
    walls = jnp.arange(members, state.position.shape[0])
    slots = jnp.concatenate([change.source, walls])
    vectors = {"position": state.position[slots], "velocity": state.velocity[slots]}
    kept = {"time": state.time, **vectors}
    pairs = {
        name: value[change.pair_source]
        for name, value in state._asdict().items()
        if name not in kept
    }
    return ClusterState(**kept, **pairs)
