"""The labelled result of a sweep."""

from __future__ import annotations

import functools
import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, TextIO

import jax
import numpy as np

from .._impact import Status
from ._axes import Grid, Input
from ._column import Column, Mask, within
from ._export import dataset, write_csv
from ._fields import Field
from ._summary import shown

if TYPE_CHECKING:
    import xarray

METHODS = (None, "nearest")

_ROUNDINGS = 4
"""An axis made by linspace and the number one types differ by a rounding or two."""


class Sweep:
    """What `sweep` returns: every field of the function's output over the grid of the axes.

    A field is read as an attribute, `table.restitution`, or as `table["restitution"]`; an output
    without names is `table.value`. It is a numpy array of the shape `table.shape`, followed by the
    shape the function gave it. What does not depend on an axis is stored once and repeated as a
    read-only view.

    `axes` maps the names of the axes (or samples) to their numbers, in order; `fixed` what was held
    fixed; `dims` and `shape` are the names and lengths of the dimensions; `status` is that of the
    output, and if it has none: INVALID_INPUT where a parameter is out of its range, NOT_CONVERGED
    where a number is NaN all the same, SEPARATED elsewhere. `complete` is False after an interrupt:
    lanes that were not computed are then NaN, and NOT_CONVERGED.
    """

    def __init__(
        self,
        grid: Grid,
        fields: Sequence[Field],
        columns: Sequence[Column],
        checks: Sequence[Mask] = (),
        *,
        done: float = 1.0,
        function: str = "",
    ):
        self._grid = grid
        self._fields = {field.name: field for field in fields}
        self._columns = tuple(column.settled() for column in columns)
        self._checks = tuple(checks)
        self._done = done
        self._function = function
        self._made: dict[str, Any] = {}

    @property
    def axes(self) -> dict[str, np.ndarray]:
        """The numbers of every axis, or of every sample, by name."""
        return {i.name: i.values for i in self._grid.inputs if i.dim is not None}

    @property
    def fixed(self) -> dict[str, Any]:
        """What was held fixed, by name."""
        numbers = {i.name: i.values[()] for i in self._grid.inputs if i.dim is None}
        return numbers | dict(self._grid.static)

    @property
    def dims(self) -> tuple[str, ...]:
        """The names of the dimensions."""
        return self._grid.dims

    @property
    def shape(self) -> tuple[int, ...]:
        """The lengths of the dimensions."""
        return self._grid.shape

    @property
    def fields(self) -> tuple[str, ...]:
        """The names of the fields."""
        return tuple(self._fields)

    @property
    def complete(self) -> bool:
        """Whether every lane was computed."""
        return self._done == 1

    @property
    def status(self) -> np.ndarray:
        """How every lane ended: the values of `Status`."""
        if "status" not in self._made:
            self._made["status"] = self.status_column.array(self.shape)
        return self._made["status"]

    def __getattr__(self, name: str) -> Any:
        # Also asked for what a half-made object does not have yet, while it is being unpickled.
        if name.startswith("_") or name not in self._fields:
            fields = ", ".join(self.__dict__.get("_fields", ()))
            raise AttributeError(f"this sweep has no field {name!r}; its fields: {fields}")
        return self[name]

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self._fields]

    def __getitem__(self, name: str) -> Any:
        if name not in self._fields:
            raise KeyError(f"{name!r} is no field; there are {', '.join(self._fields)}")
        if name not in self._made:
            self._made[name] = self._make(self._fields[name])
        return self._made[name]

    def _make(self, field: Field) -> Any:
        if not field.leaves:
            return field.constant
        arrays = [self._columns[leaf].array(self.shape) for leaf in field.leaves]
        return arrays[0] if field.structure is None else jax.tree.unflatten(field.structure, arrays)

    def columns(self) -> dict[str, Column]:
        """Every array, by the name of its field, as small as it is stored."""
        return {
            name: self._columns[leaf]
            for field in self._fields.values()
            for name, leaf in zip(field.leaf_names(), field.leaves, strict=True)
        }

    @functools.cached_property
    def status_column(self) -> Column:
        """The status, as small as it is stored."""
        given = self.columns().get("status")
        if given is not None:
            return given
        floats = [c for c in self._columns if np.issubdtype(c.stored.dtype, np.inexact)]
        checks = tuple(mask for mask in self._checks if not mask.good.all())
        masks = [mask for c in floats for mask in c.masks if not any(map(mask.same, checks))]
        dims = tuple(sorted({d for part in (*floats, *masks) for d in part.dims}))
        lost = np.zeros(tuple(self.shape[d] for d in dims), bool)
        for column in floats:
            nan = np.isnan(column.values)
            own = tuple(range(len(column.dims), nan.ndim))
            lost |= within(np.asarray(nan.any(own)), column.dims, dims)
        for mask in masks:
            lost |= ~within(mask.good, mask.dims, dims)
        codes = np.where(lost, int(Status.NOT_CONVERGED), int(Status.SEPARATED)).astype(np.int32)
        return Column(dims, codes, checks, int(Status.INVALID_INPUT)).settled()

    def status_counts(self) -> dict[int, int]:
        """How many lanes ended in which way, by the values of `Status`."""
        return dict(sorted(self.status_column.counts(self.shape).items()))

    def select(self, /, *, method: str | None = None, **where: float) -> Sweep:
        """The sweep at one number of one or more axes, which are no dimensions any more.

        A number must be one of the axis, to rounding; `method="nearest"` takes the nearest. Of
        samples, select by their number: `sample=3`. Raises ValueError for a number that is not on
        the axis or a name that is none.
        """
        if method not in METHODS:
            raise ValueError(f"Argument `method` must be one of {METHODS}, but is {method!r}.")
        found = self
        for name, number in where.items():
            if name not in self.dims:
                raise ValueError(
                    f"Argument `{name}` must be a dimension of the sweep, but those are: "
                    f"{', '.join(self.dims) or 'none'}."
                )
            found = found._at(name, _place(self.coordinates(name), name, number, method))
        return found

    def coordinates(self, dim: str) -> np.ndarray:
        """The numbers along a dimension: its axis, or the count of the samples."""
        return self.axes.get(dim, np.arange(self.shape[self.dims.index(dim)]))

    def _at(self, name: str, place: int) -> Sweep:
        dim = self.dims.index(name)

        def moved(given: Input) -> Input:
            if given.dim is None or given.dim < dim:
                return given
            if given.dim == dim:
                return Input(given.name, given.values[place], None)
            return Input(given.name, given.values, given.dim - 1)

        grid = Grid(
            dims=self.dims[:dim] + self.dims[dim + 1 :],
            shape=self.shape[:dim] + self.shape[dim + 1 :],
            inputs=tuple(map(moved, self._grid.inputs)),
            static=self._grid.static,
        )
        return Sweep(
            grid,
            tuple(self._fields.values()),
            [column.taken(dim, place) for column in self._columns],
            [mask.taken(dim, place) for mask in self._checks],
            done=self._done,
            function=self._function,
        )

    def to_xarray(self) -> xarray.Dataset:
        """The sweep as an `xarray.Dataset`, with units and where it comes from as attributes.

        Raises ImportError without xarray, which comes with `pip install 'jaxcontact[data]'`.
        """
        return dataset(self)

    def to_csv(self, path: str | os.PathLike | TextIO) -> None:
        """Write a long table, one row for each lane: its axes, then its fields.

        `path` names a file, or is an open one. The status is written by name.
        """
        write_csv(self, path)

    def dims_of_axes(self) -> dict[str, str]:
        """The dimension along which every axis, or sample, varies."""
        return {i.name: self.dims[i.dim] for i in self._grid.inputs if i.dim is not None}

    @property
    def function(self) -> str:
        """The name of the function that was swept."""
        return self._function

    @property
    def done(self) -> float:
        """The part of the work that was done: 1, or less after an interrupt."""
        return self._done

    def __repr__(self) -> str:
        return shown(self)


def _place(values: np.ndarray, name: str, number: float, method: str | None) -> int:
    distance = np.abs(values - number)
    place = int(np.argmin(np.where(np.isnan(distance), np.inf, distance)))
    digits = np.finfo(values.dtype).eps if values.dtype.kind == "f" else 0
    exact = distance[place] <= _ROUNDINGS * digits * abs(number)
    if method is None and not exact:
        near = np.unique(values[np.argsort(distance, kind="stable")[:3]])
        raise ValueError(
            f"Argument `{name}` must be a number of the axis, but is {number!r}; near it are "
            f"{', '.join(f'{value:.9g}' for value in near)} (or ask with method='nearest')."
        )
    return place
