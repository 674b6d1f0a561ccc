"""The pairs that a call of the coupled solve follows: those in contact, and the nearest others. It
ends before any other of the M²/2 pairs of M spheres could touch.
"""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..._coupled.rows import rows_of
from ..arrays.arrays import SceneArrays
from ..cluster.problem import ClusterPairs, ClusterState
from .reach import time_to_cover
from .slots import FilledSlots, map_pairs, most_pairs, slot_pairs


def with_near_pairs(
    model: SceneArrays,
    filled: FilledSlots,
    used: Bool[Array, " P"],
    closed: Bool[Array, " P"],
    gap: Float[Array, " P"],
) -> FilledSlots:
    """Return the slots with the pairs that a call follows, first the `closed` ones."""
    slots, speeds = filled.slots, filled.speeds
    most = most_pairs(model, slots.size)
    if most is None or speeds is None:
        return filled
    first, second = slot_pairs(model, slots.size)
    bounds = speeds.within(jnp.minimum(slots.who, model.spheres - 1), slots.present)
    each = (jnp.concatenate([x, jnp.zeros(model.walls, x.dtype)]) for x in bounds)
    time = time_to_cover(jnp.maximum(gap, 0), *(x[first] + x[second] for x in each))
    time = jnp.where(closed, -1, jnp.where(used, time, jnp.inf))
    order = jnp.argsort(time)
    near = jnp.zeros(time.shape, bool).at[order[:most]].set(True)
    next_one = time[order[most]]
    crowded = filled.crowded | (next_one < 0)  # More touch than are followed.
    return filled._replace(alone=jnp.minimum(filled.alone, next_one), crowded=crowded, near=near)


class PairList:
    """The places of the pairs that a call follows among all pairs; all of them without `near`."""

    def __init__(self, model: SceneArrays, size: int, near: Bool[Array, " P"] | None) -> None:
        self._near = near
        if near is not None:
            most, self._all = most_pairs(model, size), near.size
            self._place = jnp.flatnonzero(near, size=most, fill_value=self._all)
            self._sure = jnp.minimum(self._place, self._all - 1)

    def columns(self, tree: Any) -> Any:
        """Return the columns of the pairs in the list."""
        return tree if self._near is None else rows_of(tree, self._sure)

    def pairs(self, pairs: ClusterPairs) -> ClusterPairs:
        """Return the pairs in the list; those beyond their number are not used."""
        if self._near is None:
            return pairs
        some = self.columns(pairs)
        return some._replace(used=some.used & (self._place < self._all))

    def whole(self, some: ClusterState, before: ClusterState, pairs: ClusterPairs) -> ClusterState:
        """Return the state of all pairs. The others are as `before`, with their gaps of now."""
        if self._near is None:
            return some
        apart = pairs.between(some.position)
        depth = jnp.minimum(-pairs.gaps(apart, jnp.zeros_like(apart))[0], 0)
        depth = jnp.where(self._near | ~pairs.used, before.indentation, depth)
        return self.put(some, before._replace(indentation=depth))

    def put(self, some: ClusterState, others: ClusterState) -> ClusterState:
        """Return the state of all pairs, with that of `others` where they are not in the list."""
        if self._near is None:
            return some
        return map_pairs(lambda new, old: old.at[self._place].set(new, mode="drop"), some, others)
