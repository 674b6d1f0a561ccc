"""One swept array, stored over the dimensions that it depends on and expanded on access."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np


@dataclass(frozen=True, eq=False)
class SweepColumn:
    """An array over the dimensions of a sweep: `values` if all masks are true, else `otherwise`.

    `stored` has one axis for each of `dims`, in ascending order, followed by the axes of one lane's
    value. It is an array in memory, or one on disk that is read on access. A mask is a column of
    flags without masks.
    """

    dims: tuple[int, ...]
    stored: Any
    masks: tuple[SweepColumn, ...] = ()
    otherwise: Any = None

    @property
    def values(self) -> np.ndarray:
        """The stored numbers as an array."""
        return np.asarray(self.stored[...])

    @property
    def own_shape(self) -> tuple[int, ...]:
        """The shape of one lane's value."""
        return self.stored.shape[len(self.dims) :]

    def same(self, other: SweepColumn) -> bool:
        """Return whether another column stores the same numbers over the same dimensions."""
        return self.dims == other.dims and np.array_equal(self.values, other.values)

    def array(self, shape: Sequence[int]) -> np.ndarray:
        """Return the array over dimensions of given lengths, as a read-only view if possible."""
        dims = range(len(shape))
        full = np.broadcast_to(within(self.values, self.dims, dims), (*shape, *self.own_shape))
        if self.masks:
            full = self._apply_masks(full, dims, self.masks)
            full.flags.writeable = False
        return full

    def _apply_masks(
        self, array: np.ndarray, dims: Sequence[int], masks: Sequence[SweepColumn]
    ) -> np.ndarray:
        """Return a copy of `array` over `dims`, with `otherwise` where a mask is false."""
        result, keep = array.copy(), np.ones(array.shape[: len(dims)], bool)
        for mask in masks:
            keep &= within(mask.values, mask.dims, dims)
        result[~keep] = self.otherwise
        return result

    def simplify(self) -> SweepColumn:
        """Return the column without redundant masks, and with masks over its dimensions applied."""
        masks = [mask for mask in self.masks if not mask.values.all()]
        inside = [mask for mask in masks if set(mask.dims) <= set(self.dims)]
        if not inside:
            return replace(self, masks=tuple(masks))
        outside = tuple(mask for mask in masks if mask not in inside)
        return replace(
            self, stored=self._apply_masks(self.values, self.dims, inside), masks=outside
        )

    def take(self, dim: int, index: int) -> SweepColumn:
        """Return the column at one index of a dimension, without that dimension."""
        masks = tuple(mask.take(dim, index) for mask in self.masks)
        values = self.values
        if dim in self.dims:
            values = np.asarray(values.take(index, axis=self.dims.index(dim)))
        dims = tuple(d - (d > dim) for d in self.dims if d != dim)
        return SweepColumn(dims, values, masks, self.otherwise).simplify()

    def counts(self, shape: Sequence[int]) -> dict[Any, int]:
        """Count each value; the whole array is expanded only if parts share dimensions."""
        shape = tuple(shape)
        used = [d for part in (self, *self.masks) for d in part.dims]
        if len(used) > len(set(used)):
            kinds, numbers = np.unique(self.array(shape), return_counts=True)
            return dict(zip(kinds.tolist(), numbers.tolist(), strict=True))
        lanes = math.prod(shape)
        free = lanes // math.prod(shape[d] for d in used)
        kept = free * math.prod(int(np.count_nonzero(mask.values)) for mask in self.masks)
        kinds, numbers = np.unique(self.values, return_counts=True)
        counts = {k: kept * n for k, n in zip(kinds.tolist(), numbers.tolist(), strict=True)}
        bad = (lanes - kept * math.prod(shape[d] for d in self.dims)) * math.prod(self.own_shape)
        if bad:
            kind = np.asarray(self.otherwise).item()
            counts[kind] = counts.get(kind, 0) + bad
        return {kind: number for kind, number in counts.items() if number}


def within(array: np.ndarray, dims: Sequence[int], among: Sequence[int]) -> np.ndarray:
    """Return `array` over `dims`, with axes of length one for the other dimensions `among`."""
    lengths = [1] * len(among)
    for place, d in enumerate(dims):
        lengths[among.index(d)] = array.shape[place]
    return array.reshape(tuple(lengths) + array.shape[len(dims) :])
