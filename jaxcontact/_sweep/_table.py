"""The arrays of a sweep with their names: plain data, and what follows from it."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any, Self

import jax
import numpy as np

from .._impact import Status
from ._axes import Grid, Input
from ._column import Column, Mask, within
from ._fields import Field


class Table:
    """All fields over a grid, each array stored over the dimensions that it depends on."""

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

    def __getitem__(self, name: str) -> Any:
        if name not in self._fields:
            raise KeyError(f"{name!r} is not a field; the fields are {', '.join(self._fields)}")
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

    def coordinates(self, dim: str) -> np.ndarray:
        """The numbers along a dimension: its axis, or the count of the samples."""
        return self.axes.get(dim, np.arange(self.shape[self.dims.index(dim)]))

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

    def taken(self, name: str, place: int) -> Self:
        """The same at one index of a dimension, without that dimension."""
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
        return type(self)(
            grid,
            tuple(self._fields.values()),
            [column.taken(dim, place) for column in self._columns],
            [mask.taken(dim, place) for mask in self._checks],
            done=self._done,
            function=self._function,
        )
