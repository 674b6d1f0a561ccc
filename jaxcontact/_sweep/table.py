"""The named arrays of a sweep, each stored over the dimensions that it depends on and expanded on
access: plain data, and quantities derived from it.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import jax
import numpy as np

from .._impact import Status
from .planning.axes import SweepGrid


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


class SweepTable:
    """All fields over a grid, each array stored over the dimensions that it depends on.

    The attributes are those of `Sweep`, and `function`, the name of the swept function. `done` is
    the fraction of the work that was done: 1, or less after an interrupt. `resumed` is the fraction
    that was found in the store.
    """

    def __init__(
        self,
        grid: SweepGrid,
        fields: Sequence[OutputField],
        columns: Mapping[str, SweepColumn],
        checks: Sequence[SweepColumn] = (),
        computed: Sequence[SweepColumn] = (),
        *,
        done: float = 1.0,
        resumed: float = 0.0,
        function: str = "",
    ):
        self.dims: tuple[str, ...] = grid.dims
        self.shape: tuple[int, ...] = grid.shape
        self.axes: dict[str, np.ndarray] = {
            i.name: i.values for i in grid.inputs if i.dim is not None
        }
        fixed = {i.name: i.values[()] for i in grid.inputs if i.dim is None}
        self.fixed: dict[str, Any] = fixed | dict(grid.static)
        self.function: str = function
        self.done: float = done
        self.resumed: float = resumed
        self.complete: bool = done == 1
        self._grid = grid
        self._fields = {field.name: field for field in fields}
        self._columns = {name: column.simplify() for name, column in columns.items()}
        self._checks, self._computed = checks, computed
        self._made: dict[str, Any] = {}

    @property
    def fields(self) -> tuple[str, ...]:
        """The names of the fields."""
        return tuple(self._fields)

    @property
    def status(self) -> np.ndarray:
        """Outcome of every lane: the values of `Status`."""
        if "status" not in self._made:
            self._made["status"] = self.status_column.array(self.shape)
        return self._made["status"]

    def __getitem__(self, name: str) -> Any:
        if name not in self._fields:
            raise KeyError(f"{name!r} is not a field; the fields are {', '.join(self._fields)}")
        if name not in self._made:
            field = self._fields[name]
            arrays = [self._columns[array].array(self.shape) for array in field.arrays]
            made = jax.tree.unflatten(field.structure, arrays) if arrays else field.constant
            self._made[name] = made
        return self._made[name]

    def columns(self) -> dict[str, SweepColumn]:
        """Return every array by its name, as compactly as it is stored."""
        return self._columns

    @functools.cached_property
    def status_column(self) -> SweepColumn:
        """The status, as compactly as it is stored."""
        status = self._columns.get("status")
        if status is not None:
            return self._mark_interrupted(status) if self._computed else status
        floats = [c for c in self._columns.values() if np.issubdtype(c.stored.dtype, np.inexact)]
        checks = tuple(mask for mask in self._checks if not mask.values.all())
        masks = [mask for c in floats for mask in c.masks if not any(map(mask.same, checks))]
        masks += self._computed
        dims = tuple(sorted(set(dims_in(*floats, *masks))))
        lost = np.zeros(tuple(map(self.shape.__getitem__, dims)), bool)
        for column in floats:
            lost |= within(column.is_nan(), column.dims, dims)
        for mask in masks:
            lost |= ~within(mask.values, mask.dims, dims)
        codes = np.where(lost, int(Status.NOT_CONVERGED), int(Status.SEPARATED)).astype(np.int32)
        return SweepColumn(dims, codes, checks, int(Status.INVALID_INPUT)).simplify()

    def _mark_interrupted(self, column: SweepColumn) -> SweepColumn:
        """Return the status from the function, adjusted in lanes that lack any other result."""
        dims = tuple(range(len(self.shape)))
        status = np.array(column.array(self.shape))
        for flags in self._computed:
            lost = ~np.broadcast_to(within(flags.values, flags.dims, dims), self.shape)
            status[lost & (status != Status.INVALID_INPUT)] = Status.NOT_CONVERGED
        return SweepColumn(dims, status)

    def status_counts(self) -> dict[int, int]:
        """Count the lanes by outcome, the values of `Status`."""
        return dict(sorted(self.status_column.counts(self.shape).items()))

    def coordinates(self, dim: str) -> np.ndarray:
        """Return the numbers along a dimension: its axis, or the count of the samples."""
        return self.axes.get(dim, np.arange(self.shape[self.dims.index(dim)]))

    def dims_of_axes(self) -> dict[str, str]:
        """Return the dimension along which every axis, or sample, varies."""
        return {i.name: self.dims[i.dim] for i in self._grid.inputs if i.dim is not None}

    def taken(self, name: str, place: int) -> Self:
        """Return the table at one index of a dimension, without that dimension."""
        dim = self.dims.index(name)
        return type(self)(
            self._grid.take(dim, place),
            tuple(self._fields.values()),
            {name: column.take(dim, place) for name, column in self._columns.items()},
            [mask.take(dim, place) for mask in self._checks],
            [flags.take(dim, place) for flags in self._computed],
            done=self.done,
            resumed=self.resumed,
            function=self.function,
        )
