"""The result of a sweep: its fields over the grid, for Python, for xarray, and as text."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Self

import jax
import numpy as np

from .._entry import require_choice, require_number
from .._impact import Status
from .._text import columns
from .._text.columns import File, in_words, numbered
from .._text.units import quantity
from .._text.words import wrapped
from .planning.axes import SweepGrid
from .planning.signature import version
from .table import OutputField, SweepColumn, attributes_of, dims_in, within

if TYPE_CHECKING:
    import xarray

_ROUNDINGS = 4
"""Rounding tolerance: a number from linspace may differ in the last bits from a typed one."""

_ROWS = 1 << 14
"""Rows that are converted to text at once."""

_REPEATED = 4
"""Numbers that occur in this many rows, on average, are converted once."""


class Sweep:
    """The result of `sweep`: every field of the function's output over the grid of the axes.

    A field is read as an attribute, `table.restitution`, or as `table["restitution"]`. An output
    without names is `table.value`. A field is a numpy array of the shape `table.shape`, followed by
    the shape of one lane's value. A field that does not depend on an axis is stored once and
    repeated as a read-only view.

    `axes` maps the names of the axes (or samples) to their numbers, in order; `fixed` holds the
    fixed arguments; `dims` and `shape` are the names and lengths of the dimensions. `status` is
    that of the output. If the output has no status, it is INVALID_INPUT for a parameter out of its
    range, NOT_CONVERGED for a NaN from valid parameters, and SEPARATED otherwise. `complete` is
    False after an interrupt; lanes that were not computed are then NaN and NOT_CONVERGED. `resumed`
    is the fraction of the work that was already in the store, and `done` that which was done.
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

    @functools.cached_property
    def status(self) -> np.ndarray:
        """Outcome of every lane: the values of `Status`."""
        return self.status_column.array(self.shape)

    def __getitem__(self, name: str) -> Any:
        if name not in self._fields:
            raise KeyError(f"{name!r} is not a field; the fields are {', '.join(self._fields)}")
        if name not in self._made:
            field = self._fields[name]
            columns = self._columns | ({"status": self.status_column} if name == "status" else {})
            arrays = [columns[array].array(self.shape) for array in field.arrays]
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

    def __getattr__(self, name: str) -> Any:
        # Unpickling looks up attributes before they are set.
        if name.startswith("_") or name not in self._fields:
            fields = ", ".join(self.__dict__.get("_fields", ()))
            raise AttributeError(f"this sweep has no field {name!r}; its fields: {fields}")
        return self[name]

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self._fields]

    def select(self, /, *, method: str | None = None, **where: float) -> Self:
        """Return the sweep at one number of one or more axes, without those dimensions.

        A number must be one of the axis, to rounding; `method="nearest"` takes the nearest. Samples
        are selected by their number: `sample=3`. Raises ValueError for a number that is not on the
        axis or a name that is not a dimension.
        """
        if method is not None:
            require_choice("method", method, ("nearest",))
        table = self
        for name, number in where.items():
            if name not in self.dims:
                raise ValueError(
                    f"Argument `{name}` must be a dimension of the sweep, but those are: "
                    f"{', '.join(self.dims) or 'none'}."
                )
            number = require_number(name, number)
            table = table.taken(name, _place(self.coordinates(name), name, number, method))
        return table

    def to_xarray(self) -> xarray.Dataset:
        """Return the sweep as an `xarray.Dataset`, with units and its origin as attributes.

        Raises ImportError without xarray, which comes with `pip install 'jaxcontact[data]'`.
        """
        arrays = {}
        for name, column in (self.columns() | {"status": self.status_column}).items():
            own_dims = [f"{name}_{k}" for k in range(len(column.own_shape))]
            arrays[name] = [*self.dims, *own_dims], column.array(self.shape)
        along = self.dims_of_axes()
        coordinates: dict[str, Any] = {
            name: ([along[name]], values) for name, values in self.axes.items()
        }
        attributes: dict[str, Any] = {
            "source": f"jaxcontact {version()}",
            "function": self.function,
            "complete": int(self.complete),
        }
        for name, value in self.fixed.items():
            if isinstance(value, np.generic):
                coordinates[name] = (), value
            else:
                attributes[name] = str(value)
        for name in self.fields:
            if name not in arrays and isinstance(self[name], str | int | float):
                attributes[name] = self[name]
        return columns.dataset(arrays, coordinates, attributes, attributes_of)

    def to_csv(self, path: File) -> None:
        """Write a long table, one row per lane: its axes, then its fields.

        `path` names a file, which is written completely or not at all, or is an open file. The
        status is written by name. Every number is written so that it reads back exactly.
        """
        along, lanes = self.dims_of_axes(), math.prod(self.shape)
        # A result may have the name of an axis.
        listed = [
            (name, SweepColumn((self.dims.index(along[name]),), values))
            for name, values in self.axes.items()
        ]
        listed += (self.columns() | {"status": _named(self.status_column)}).items()
        heads = [head for name, c in listed for head, _ in numbered(name, c.own_shape)]
        texts = [
            column.converted(in_words)
            if _REPEATED * math.prod(column.stored.shape) <= lanes
            else column
            for _, column in listed
        ]

        def blocks() -> Iterator[list[np.ndarray]]:
            for start in range(0, lanes, _ROWS):
                rows = np.arange(start, min(start + _ROWS, lanes))
                where = np.unravel_index(rows, self.shape) if self.shape else ()
                parts = (column.at(where, len(rows)) for column in texts)
                yield [number for part in parts for number in part.reshape(len(rows), -1).T]

        columns.write_csv(path, heads, blocks())

    def __repr__(self) -> str:
        lengths = " × ".join(f"{name} {n}" for name, n in zip(self.dims, self.shape, strict=True))
        lines = [
            f"Sweep of {self.function}: {lengths or 'no axes'}, {math.prod(self.shape):,} lanes"
        ]
        for name, values in self.axes.items():
            lines += _entry(name, quantity(name, _range(values)))
        if self.fixed:
            fixed = ", ".join(f"{k} = {_number(value)}" for k, value in self.fixed.items())
            lines += _entry("fixed", fixed)
        fields = []
        for name, column in self.columns().items():
            dims = sorted(set(dims_in(column, *column.masks)))
            over = ", ".join(map(self.dims.__getitem__, dims))
            fields.append(f"{name}({over}) {column.own_shape}".removesuffix(" ()"))
        lines += _entry("fields", ", ".join(fields) or "none")
        counts = ", ".join(f"{n:,} {_status(code)}" for code, n in self.status_counts().items())
        lines += _entry("status", counts)
        if self.resumed:
            was = f"{100 * self.resumed:.0f} % of the work was in the store"
            lines += _entry("resumed", was)
        if not self.complete:
            lines += _entry(
                "stopped", f"{100 * self.done:.0f} % of the work is done; the other lanes are NaN"
            )
        return "\n".join(lines)


def _place(values: np.ndarray, name: str, number: float, method: str | None) -> int:
    distance = np.abs(values - number)
    # Of two zeros, the one with the same sign.
    other = np.signbit(values) != np.signbit(number)
    place = int(np.lexsort((other, np.where(np.isnan(distance), np.inf, distance)))[0])
    digits = np.finfo(values.dtype).eps if values.dtype.kind == "f" else 0
    exact = distance[place] <= _ROUNDINGS * digits * abs(number)
    if method is None and not exact:
        near = np.unique(values[np.argsort(distance, kind="stable")[:3]])
        raise ValueError(
            f"Argument `{name}` must be a number of the axis, but is {number!r}; near it are "
            f"{', '.join(f'{value:.9g}' for value in near)} (or pass method='nearest')."
        )
    return place


def _status(code: int) -> str:
    return Status(code).name.lower() if code in set(Status) else f"of status {code}"


def _range(values: np.ndarray) -> str:
    finite = values[np.isfinite(values)]
    if not finite.size:
        return "none finite"
    if len(values) <= 4:
        return ", ".join(f"{value:.6g}" for value in values)
    return f"{finite.min():.6g} to {finite.max():.6g}"


def _number(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, np.floating) else str(value)


def _entry(head: str, text: str) -> list[str]:
    return wrapped(head, text, indent=10, lead="  ")


def _named(status: SweepColumn) -> SweepColumn:
    """Return the names of statuses, or the numbers as text if one of them has no name."""
    kinds = {*np.unique(status.values).tolist(), *np.ravel(status.otherwise).tolist()} - {None}
    if not kinds <= set(Status):
        return status.converted(in_words)
    names = np.array([one.name for one in sorted(Status)], object)
    # Statuses of one's own may be flags or floats.
    return status.converted(lambda codes: np.array(names[codes.astype(int)], object))
