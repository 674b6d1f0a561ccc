"""The result of a sweep: its table, with selection, export and a summary."""

from __future__ import annotations

import math
import os
from typing import TYPE_CHECKING, Any, BinaryIO, Self, TextIO

import numpy as np

from .._entry import require_choice, require_number, require_path
from .._impact import Status
from .._text.table import wrapped
from .._text.units import quantity
from .export import dataset, write_csv
from .table import SweepTable

if TYPE_CHECKING:
    import xarray

METHODS = ("nearest",)

_ROUNDINGS = 4
"""Rounding tolerance: a number from linspace may differ in the last bits from a typed one."""


class Sweep(SweepTable):
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
    is the fraction of the work that was already in the store.
    """

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
            require_choice("method", method, METHODS)
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
        return dataset(self)

    def to_csv(self, path: str | os.PathLike[str] | TextIO | BinaryIO) -> None:
        """Write a long table, one row per lane: its axes, then its fields.

        `path` names a file, which is written completely or not at all, or is an open file. The
        status is written by name. Every number is written so that it reads back exactly.
        """
        write_csv(self, path if hasattr(path, "write") else require_path("path", path))

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
            dims = {d for part in (column, *column.masks) for d in part.dims}
            over = ", ".join(self.dims[d] for d in sorted(dims))
            shape = f" {column.own_shape}" if column.own_shape else ""
            fields.append(f"{name}({over}){shape}")
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
