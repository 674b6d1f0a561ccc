"""The slots of a coupled solve: a number of spheres, all walls, and the pairs that can meet. If the
solve has slots for all spheres and no axis is periodic, each sphere has its own and joins or leaves
by a flag.

Otherwise the bodies near a contact are gathered into the slots. Those in contact come first. The
speed of each sphere is bounded by the total energy of the cluster. Spheres that the cluster could
reach within `pace` join it, nearest in time first, and add their energy. All other spheres stay in
closed-form flight, and the solve ends before it could meet one of them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..._contact import Contact
from ..._coupled.modes import Flag, Index, Number
from ..._coupled.rows import rows_of
from ..arrays.arrays import (
    Flying,
    SceneArrays,
    SceneLayout,
    at_once,
    known_contact_of,
    least_speed,
    nearest_image,
)
from ..bodies.bodies import side
from ..cluster.problem import ClusterPairs, ClusterState, norm
from ..pair_impact.instantaneous import Choice
from .reach import SpeedBounds, speed_bounds, time_to_cover
from .search import simultaneous
from .state import Coupling, RunState, Slots


def in_line(layout: SceneLayout) -> bool:
    """Return whether spheres keep their order, so that only neighbours meet."""
    return layout.dimensions == 1 and layout.visible == layout.spheres and not layout.driven


def all_fit(layout: SceneLayout, size: int) -> bool:
    """Return whether every sphere has a slot of its own."""
    return size == layout.spheres and not any(layout.periodic)


def slot_pairs(layout: SceneLayout, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the first and second slot of every pair that can meet, (P,) each; walls come last."""
    by_sphere = all_fit(layout, size) and not in_line(layout)
    fixed = np.zeros(size + layout.walls, bool)
    fixed[:size], fixed[size:] = layout.fixed if by_sphere else False, True
    first, second = np.triu_indices(size, 1, size + layout.walls)
    meet = ~(fixed[first] & fixed[second])
    if in_line(layout):
        meet &= (second >= size) | (second == first + 1)
    first, second = first[meet], second[meet]
    # A fixed sphere comes second.
    return np.where(fixed[first], second, first), np.where(fixed[first], first, second)


_TOUCHED = {1: 2, 2: 3, 3: 4}
"""About the largest number of contacts for each sphere of a cluster, by the dimensions."""


def most_pairs(model: SceneArrays, size: int) -> int | None:
    """Return the number of pairs that a call follows; None if it follows all."""
    most = _TOUCHED[model.dimensions] * size + model.walls
    few = 2 * most > slot_pairs(model, size)[0].size + model.walls
    return None if few or not keeps_energy(model) else most


def keeps_energy(model: SceneArrays) -> bool:
    """Return whether a call adds no energy to that at its start, beside that of gravity: no body is
    in prescribed motion, and no adhesion pulls.
    """
    belts = model.rotation is not None and model.rotation.drift is not None
    adhesive = any(law.ends_apart for law in model.laws)
    return not (model.driven or any(model.moving) or belts or adhesive)


def identity_slots(model: SceneArrays) -> Int[Array, " N"]:
    """Return the sphere of each slot if all spheres have one; in a line, by their order."""
    if in_line(model):
        return jnp.argsort(model.position[:, 0])
    return jnp.arange(model.spheres)


def empty_slots(model: SceneArrays, size: int) -> Slots:
    """Return slots with no sphere present."""
    who = jnp.full(size, model.spheres, int)
    if all_fit(model, size):
        who = identity_slots(model)
    return Slots(who, who < 0, jnp.zeros((size, model.dimensions), model.dtype))


def bodies_of(layout: SceneLayout, slots: Slots) -> tuple[Int[Array, "*K P"], Int[Array, "*K P"]]:
    """Return the first and second body of every pair, numbered as in the engine."""
    (first, second), who = slot_pairs(layout, slots.size), slots.who
    walls = jnp.broadcast_to(
        layout.spheres + jnp.arange(layout.walls), (*who.shape[:-1], layout.walls)
    )
    all_of_them = jnp.concatenate([jnp.minimum(who, layout.spheres - 1), walls], axis=-1)

    def body_at(which: np.ndarray) -> Array:
        return all_of_them.at[..., which].get(mode="promise_in_bounds", wrap_negative_indices=False)

    return body_at(first), body_at(second)


def pairs_of(model: SceneArrays, slots: Slots) -> ClusterPairs:
    """Return the pairs; those with an absent body are not used."""
    size = slots.size
    first, second = slot_pairs(model, size)
    one, other = bodies_of(model, slots)
    flat = second >= size
    radius = jnp.concatenate([model.radius, jnp.zeros(model.walls, model.dtype)])
    none = jnp.zeros((size, model.dimensions), model.dtype)
    inside = jnp.concatenate([slots.present, jnp.ones(model.walls, bool)])
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


class SlotChange(NamedTuple):
    """The change of the slots between two calls. `joined` (M,) marks slots with a new body, and
    `fresh` (P,) marks new pairs. `source` (M,) and `pair_source` (P,) are the previous slots of
    bodies and pairs that stay; None if none moves.
    """

    joined: Bool[Array, " M"]
    fresh: Bool[Array, " P"]
    source: Int[Array, " M"] | None
    pair_source: Int[Array, " P"] | None


def slot_change(layout: SceneLayout, old: Slots, new: Slots, starts: Flag) -> SlotChange:
    """Return the change between two calls; at a start all bodies join."""
    first, second = slot_pairs(layout, new.size)
    if all_fit(layout, new.size):
        joined = new.present & (starts | ~old.present)
        return joins(layout, joined)
    same = (new.who[:, None] == old.who[None]) & new.present[:, None] & old.present[None]
    stays = jnp.any(same, axis=1) & ~starts
    source = jnp.argmax(same, axis=1)
    walls = jnp.arange(layout.walls)
    there = jnp.concatenate([stays, walls >= 0])
    was = jnp.concatenate([source, new.size + walls])
    total = new.size + layout.walls
    numbered = np.full((total, total), -1)
    numbered[first, second] = numbered[second, first] = np.arange(first.size)
    pair = jnp.asarray(numbered)[was[first], was[second]]
    fresh = ~(there[first] & there[second]) | (pair < 0)
    return SlotChange(new.present & ~stays, fresh, source, jnp.maximum(pair, 0))


def joins(layout: SceneLayout, joined: Bool[Array, " M"]) -> SlotChange:
    """Return the change in which some bodies join and the others keep their slots."""
    size = joined.shape[0]
    first, second = slot_pairs(layout, size)
    walls = jnp.concatenate([joined, jnp.zeros(layout.walls, bool)])
    fresh = walls[first] | walls[second]
    if all_fit(layout, size):
        return SlotChange(joined, fresh, None, None)
    return SlotChange(joined, fresh, jnp.arange(size), jnp.arange(first.shape[0]))


def no_change(layout: SceneLayout, size: int) -> SlotChange:
    """Return the change in which all bodies stay."""
    return joins(layout, jnp.zeros(size, bool))


def in_place(change: SlotChange) -> SlotChange:
    """Return the change for a state that is already in the slots of this call."""
    return change._replace(source=None, pair_source=None)


def rearrange(state: ClusterState, change: SlotChange) -> ClusterState:
    """Return a state with its bodies and pairs in the slots of the next call."""
    if change.source is None:
        return state
    walls = jnp.arange(change.source.shape[0], state.position.shape[0])
    sources = jnp.concatenate([change.source, walls])
    state = map_pairs(lambda column: column[change.pair_source], state)
    position, velocity, rubbing = state.position[sources], state.velocity[sources], state.rubbing
    if rubbing is not None:
        rubbing = rubbing._replace(spin=rubbing.spin[sources])
    return state._replace(position=position, velocity=velocity, rubbing=rubbing)


def map_pairs(of: Callable[..., Array], state: ClusterState, *others: ClusterState) -> ClusterState:
    """Return the state with a function of its columns for pairs, and of those of other states."""

    def of_pairs(state: ClusterState) -> Any:
        rubbing = None if state.rubbing is None else state.rubbing._replace(spin=None)
        return state._replace(time=None, position=None, velocity=None, rubbing=rubbing)

    new = jax.tree.map(of, *map(of_pairs, (state, *others)))
    if state.rubbing is not None:
        new = new._replace(rubbing=new.rubbing._replace(spin=state.rubbing.spin))
    return new._replace(time=state.time, position=state.position, velocity=state.velocity)


def in_more_slots(layout: SceneLayout, old: Any, blank: Any, sizes: tuple[int, int]) -> Any:
    """Return the tree `old` of a coupled solve in the larger one of two numbers of slots, as that
    of `blank`. Both may be rows of a log.
    """
    few, many = sizes
    numbered = {pair: k for k, pair in enumerate(zip(*slot_pairs(layout, many), strict=True))}
    moves = np.concatenate([np.arange(few), many + np.arange(layout.walls)])
    of_pairs = (moves[slot] for slot in slot_pairs(layout, few))
    pairs = np.array([numbered[pair] for pair in zip(*of_pairs, strict=True)])
    # Axes of spheres, of all slots and of pairs differ in their lengths.
    targets = {few: moves[:few], moves.size: moves, pairs.size: pairs}

    def moved(path: Any, rows: Any, row: Any) -> np.ndarray:
        rows, row = np.asarray(rows), np.asarray(row)
        differs = [k for k in range(1, row.ndim + 1) if rows.shape[-k] != row.shape[-k]]
        axis = next((k for k in differs if rows.shape[-k] in targets), None)
        if axis is None:
            return rows
        where = targets[rows.shape[-axis]]
        if "pair_source" in jax.tree_util.keystr(path):
            rows = pairs[rows]
        shape = (*rows.shape[: rows.ndim - axis], *row.shape[row.ndim - axis :])
        there = np.broadcast_to(row, shape).copy()
        there[(..., where, *(slice(None),) * (axis - 1))] = rows
        return there

    return jax.tree_util.tree_map_with_path(moved, old, blank)


def masses(model: SceneArrays, slots: Slots) -> Float[Array, " M"]:
    """Return the masses of the spheres present; 0 for fixed ones."""
    inverse = rows_of(model.inverse_mass, jnp.minimum(slots.who, model.spheres - 1))
    free = slots.present & (inverse > 0)
    return jnp.where(free, 1 / jnp.where(free, inverse, 1), 0)


def resting_pairs(layout: SceneLayout, support: Int[Array, " M"]) -> Bool[Array, " P"]:
    """Return the pairs of a sphere and the wall on which it rests."""
    size = support.shape[0]
    first, second = slot_pairs(layout, size)
    return (support[first] == second - size) & (support[first] >= 0)


_CALLS = 64
"""The number of calls into which the first third of an impact may be divided. It matters if there
is no place for all spheres within reach in that time."""


class FilledSlots(NamedTuple):
    """The `slots` of a call, and its limits. The call may last for `alone` s before other spheres
    must be considered. `crowded`: whether there are too few slots, or another image of a sphere in
    them is within reach. `speeds` are those of all spheres, and `near` marks the pairs that the
    call follows; None where that is all of them.
    """

    slots: Slots
    alone: Number
    crowded: Flag
    speeds: SpeedBounds | None = None
    near: Bool[Array, " P"] | None = None


def pace_of_contact(contact: Contact, speed: Number) -> Number:
    """Return X/v at a closing speed, about a third of an impact's duration in s."""
    n = contact.exponent
    return (contact.mass / contact.stiffness / speed ** (n - 1)) ** (1 / (n + 1))


def pace_of(model: SceneArrays, choice: Choice, closing: Number) -> Number:
    """Return about a third of an impact's duration: X/v with X = (μ v²/K)^(1/(n+1)), in s."""
    contact = known_contact_of(model, choice.first, choice.second)
    return pace_of_contact(contact, jnp.maximum(closing, least_speed(model)))


def fill_slots(model: SceneArrays, state: RunState, now: Number) -> FilledSlots:
    """Return the slots of the next call of the coupled solve."""
    coupling, count = state.coupling, model.spheres
    assert coupling is not None
    size = coupling.slots.size
    ready = state.time <= now + simultaneous(model, now)
    shift = jnp.zeros((size, model.dimensions), model.dtype)
    if all_fit(model, size):
        who, speeds = identity_slots(model), None
        if most_pairs(model, size) is not None:
            there = at_once(model, jnp.arange(count), state.flying, state.support, now)[0]
            speeds = speed_bounds(model, coupling, there, now)
        slots, no = Slots(who, ready[who], shift), jnp.asarray(False)
        return FilledSlots(slots, jnp.full_like(now, jnp.inf), no, speeds)
    there, pull = at_once(model, jnp.arange(count), state.flying, state.support, now)
    core, speeds = _core(model, coupling), speed_bounds(model, coupling, there, now)
    given, moves = speeds.given, speeds.inverse > 0
    outside = speeds.flying + given, jnp.where(moves, speeds.weight, 0) + speeds.push

    def arrivals(who: Array, after: Array, filled: Array) -> Array:
        """Return the earliest times at which others may be reached, or reach a non-core body."""
        sure = jnp.minimum(who, count - 1)
        taken = jnp.arange(size) < filled
        apart = (there.position[sure][:, None] - there.position[None]).reshape(-1, model.dimensions)
        apart = nearest_image(model, apart)[0].reshape(size, count, model.dimensions)
        distance = model.radius[sure][:, None] + model.radius[None]
        gap = jnp.maximum(side(distance) * norm(apart) - distance, 0)
        # Up to the time `after` a body that is no part of the core moves as in flight.
        rate = there.velocity[sure][:, None] - there.velocity[None]
        closes = side(distance) * jnp.sum(apart * rate, axis=-1) < 0
        meeting = jnp.where(closes, norm(rate), 0)
        meeting = meeting + given[sure][:, None] + given[None]
        bend = jnp.zeros_like(gap)
        if model.has_gravity or model.shaken:
            bend = norm(pull[sure][:, None] - pull[None])
            bend = bend + speeds.push[sure][:, None] + speeds.push[None]
        free = jnp.where(core[sure][:, None], jnp.inf, time_to_cover(gap, meeting, bend))
        late = after[:, None]
        left = jnp.maximum(gap - (meeting + bend / 2 * late) * late, 0)
        both = zip(speeds.within(sure, taken), outside, strict=True)
        fast, gain = (mine[:, None] + theirs[None] for mine, theirs in both)
        # A fixed body transmits nothing.
        reached = late + time_to_cover(left, fast + gain * late, gain)
        reached = jnp.where(moves[sure][:, None], reached, jnp.inf)
        times = jnp.minimum(reached, free)
        times = jnp.where(taken[:, None], times, jnp.inf)
        inside = jnp.zeros(count, bool).at[jnp.where(taken, who, count)].set(True, mode="drop")
        return jnp.where(inside | ~ready, jnp.inf, jnp.min(times, axis=0))

    def one_more(k: Array, carry: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        who, after, filled = carry
        times = arrivals(who, after, filled)
        nearest = jnp.argmin(times)
        joins = (times[nearest] <= coupling.pace) & (filled < size)
        place = jnp.where(joins, filled, size)
        who = who.at[place].set(nearest, mode="drop")
        after = after.at[place].set(times[nearest], mode="drop")
        return who, after, filled + joins.astype(filled.dtype)

    first = jnp.flatnonzero(core, size=size, fill_value=count)
    filled = jnp.minimum(jnp.sum(core), size)
    start = (first, jnp.zeros(size, model.dtype), filled)
    who, after, filled = jax.lax.fori_loop(0, size - 1, one_more, start)
    alone = jnp.min(arrivals(who, after, filled))
    crowded = (jnp.sum(core) > size) | (alone <= coupling.pace / _CALLS)
    slots, wide = _assign_slots(model, there, coupling, who, filled)
    if any(model.periodic):
        # Only the nearest image of a pair, at half a period or less, may touch. No other image
        # comes as near before two bodies have covered the rest of that half.
        half = jnp.min(jnp.where(jnp.asarray(model.periodic), model.period, jnp.inf)) / 2
        radius = model.radius[jnp.minimum(slots.who, count - 1)]
        room = half - 2 * jnp.max(jnp.where(slots.present, jnp.abs(radius), 0))
        sure = jnp.minimum(slots.who, count - 1)
        fast, gain = map(jnp.max, speeds.within(sure, slots.present))
        alone = jnp.minimum(alone, time_to_cover(jnp.maximum(room / 2, 0), fast, gain))
    return FilledSlots(slots, alone, crowded | wide, speeds)


def _core(layout: SceneLayout, coupling: Coupling) -> Bool[Array, " N"]:
    """Return which spheres are in contact."""
    count = layout.spheres
    first, second = bodies_of(layout, coupling.slots)
    closed = coupling.state.closed & ~coupling.starts
    core = jnp.zeros(count, bool)
    for body in (first, second):
        core = core.at[jnp.where(closed, body, count)].set(True, mode="drop")
    choice = coupling.choice
    for body in (choice.first, choice.second):
        core = core.at[jnp.where(coupling.touches, body, count)].set(True, mode="drop")
    return core


def _assign_slots(
    model: SceneArrays, there: Flying, coupling: Coupling, who: Int[Array, " M"], filled: Index
) -> tuple[Slots, Flag]:
    """Return the slots of the spheres, in neighbouring images; in a line by their order. The flag
    is True if those in a line span more than half a period: the last might then meet the first.
    """
    count, size = model.spheres, who.shape[0]
    present = jnp.arange(size) < filled
    sure = jnp.minimum(who, count - 1)
    position = there.position[sure]
    shift = jnp.zeros_like(position)
    wide = jnp.asarray(False)
    if any(model.periodic):
        old = coupling.slots
        same = (who[:, None] == old.who[None]) & old.present[None] & present[:, None]
        stays = jnp.any(same, axis=1) & ~coupling.starts
        before = old.shift[jnp.argmax(same, axis=1)]
        # Next to a member that stays, or to the first one.
        anchor = jnp.argmax(stays)
        base = position[anchor] - jnp.where(stays[anchor], before[anchor], 0) * model.period
        near = nearest_image(model, position - base[None])[1]
        shift = jnp.where(stays[:, None], before, near)
    if in_line(model):
        place = (position - shift * model.period[None])[:, 0]
        if any(model.periodic):
            low = jnp.min(jnp.where(present, place, jnp.inf))
            high = jnp.max(jnp.where(present, place, -jnp.inf))
            reach = 2 * jnp.max(jnp.where(present, model.radius[sure], 0))
            wide = high - low + reach > model.period[0] / 2
        order = jnp.argsort(jnp.where(present, place, jnp.inf))
        who, present, shift = who[order], present[order], shift[order]
    return Slots(jnp.where(present, who, count), present, shift), wide
