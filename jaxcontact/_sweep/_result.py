"""What a sweep returns: its table, with selection, export and a summary."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any, Self, TextIO

import numpy as np

from ._export import dataset, write_csv
from ._summary import shown
from ._table import Table

if TYPE_CHECKING:
    import xarray

METHODS = (None, "nearest")

_ROUNDINGS = 4
"""A number of an axis made by linspace differs from the same one typed by a rounding or two."""


class Sweep(Table):
    """What `sweep` returns: every field of the function's output over the grid of the axes.

    A field is read as an attribute, `table.restitution`, or as `table["restitution"]`; an output
    without names is `table.value`. It is a numpy array of the shape `table.shape`, followed by the
    shape the function gave it. What does not depend on an axis is stored once and repeated as a
    read-only view.

    `axes` maps the names of the axes (or samples) to their numbers, in order; `fixed` what was held
    fixed; `dims` and `shape` are the names and lengths of the dimensions; `status` is that of the
    output, and if it has none: INVALID_INPUT where a parameter is out of its range, NOT_CONVERGED
    where a number is NaN for valid parameters, SEPARATED elsewhere. `complete` is False after an
    interrupt: lanes that were not computed are then NaN, and NOT_CONVERGED.
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
        """The sweep at one number of one or more axes, which are then no dimensions.

        A number must be one of the axis, to rounding; `method="nearest"` takes the nearest.
        Samples are selected by their number: `sample=3`. Raises ValueError for a number that is
        not on the axis or a name that is not a dimension.
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
            found = found.taken(name, _place(self.coordinates(name), name, number, method))
        return found

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
            f"{', '.join(f'{value:.9g}' for value in near)} (or pass method='nearest')."
        )
    return place
