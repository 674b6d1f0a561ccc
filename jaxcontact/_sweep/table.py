"""The columns of a sweep, each stored over the dimensions that it depends on and expanded on
access, the fields that they make up, and their attributes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .._impact import Status
from .._text.columns import flag_attributes
from .._text.units import meaning


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

    def converted(self, convert: Callable[[np.ndarray], np.ndarray]) -> SweepColumn:
        """Return the column with other numbers, or texts, in place of its own."""
        otherwise = None if self.otherwise is None else convert(np.asarray(self.otherwise))
        return replace(self, stored=convert(self.values), otherwise=otherwise)

    def at(self, lanes: Sequence[np.ndarray], count: int) -> np.ndarray:
        """Return the numbers in `count` lanes, given by their index along each dimension."""
        values = np.broadcast_to(self._read(lanes), (count, *self.own_shape))
        keep = np.ones(count, bool)
        for mask in self.masks:
            keep &= mask._read(lanes)
        if keep.all():
            return values
        keep = within(keep, (0,), range(values.ndim))
        return np.where(keep, values, np.asarray(self.otherwise, values.dtype))

    def _read(self, lanes: Sequence[np.ndarray]) -> np.ndarray:
        """Return the stored numbers in some lanes; from disk, read only the part that has them."""
        if not self.dims:
            return self.values
        first, *others = (lanes[dim] for dim in self.dims)
        low, high = int(first.min()), int(first.max())
        return np.asarray(self.stored[low : high + 1])[(first - low, *others)]

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

    def is_nan(self) -> np.ndarray:
        """Return where a lane holds a NaN, along the column's dimensions."""
        nan = np.isnan(self.values)
        return np.asarray(nan.any(tuple(range(len(self.dims), nan.ndim))))

    def counts(self, shape: Sequence[int]) -> dict[Any, int]:
        """Count each value; the whole array is expanded only if parts share dimensions."""
        shape = tuple(shape)
        used = dims_in(self, *self.masks)
        if len(used) > len(set(used)):
            kinds, numbers = np.unique(self.array(shape), return_counts=True)
            return dict(zip(kinds.tolist(), numbers.tolist(), strict=True))
        lanes = math.prod(shape)
        free = lanes // math.prod(map(shape.__getitem__, used))
        kept = free * math.prod(int(np.count_nonzero(mask.values)) for mask in self.masks)
        kinds, numbers = np.unique(self.values, return_counts=True)
        counts = {k: kept * n for k, n in zip(kinds.tolist(), numbers.tolist(), strict=True)}
        bad = (lanes - kept * math.prod(shape[d] for d in self.dims)) * math.prod(self.own_shape)
        if bad:
            kind = np.asarray(self.otherwise).item()
            counts[kind] = counts.get(kind, 0) + bad
        return {kind: number for kind, number in counts.items() if number}


def dims_in(*columns: SweepColumn) -> list[int]:
    """Return the dimensions of columns, in order."""
    return [dim for column in columns for dim in column.dims]


def within(array: np.ndarray, dims: Sequence[int], among: Sequence[int]) -> np.ndarray:
    """Return `array` over `dims`, with axes of length one for the other dimensions `among`."""
    lengths = [1] * len(among)
    for place, d in enumerate(dims):
        lengths[among.index(d)] = array.shape[place]
    return array.reshape(tuple(lengths) + array.shape[len(dims) :])


@dataclass(frozen=True, eq=False)
class OutputField:
    """One field of an output: the names of its arrays, or a constant without arrays."""

    name: str
    arrays: tuple[str, ...] = ()
    """The name of the field itself if it is one array."""
    structure: Any = None
    """Structure of the field in terms of its arrays."""
    constant: Any = None


def attributes_of(name: str) -> dict[str, Any]:
    """Return the dataset attributes of an axis or a field."""
    if name == "status":
        return flag_attributes("status", Status)
    words, unit = meaning(name)
    return {"long_name": words, "units": unit or "1"} if unit or words != name else {}
