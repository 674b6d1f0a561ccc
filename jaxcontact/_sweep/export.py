"""A sweep for other tools: an xarray dataset, or text, one row per lane, a few thousand rows at a
time.
"""

from __future__ import annotations

import importlib.metadata
import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from .._impact import Status
from .._text import columns
from .._text.columns import File, flag_attributes, in_words, numbered
from .._text.units import meaning
from .table import SweepColumn, SweepTable

if TYPE_CHECKING:
    import xarray


def dataset(sweep: SweepTable) -> xarray.Dataset:
    """Return the sweep as an `xarray.Dataset`. Raises ImportError without xarray."""
    arrays = {}
    for name, column in (sweep.columns() | {"status": sweep.status_column}).items():
        own_dims = [f"{name}_{k}" for k in range(len(column.own_shape))]
        arrays[name] = [*sweep.dims, *own_dims], column.array(sweep.shape)
    along = sweep.dims_of_axes()
    coordinates: dict[str, Any] = {
        name: ([along[name]], values) for name, values in sweep.axes.items()
    }
    attributes: dict[str, Any] = {
        "source": f"jaxcontact {version()}",
        "function": sweep.function,
        "complete": int(sweep.complete),
    }
    for name, value in sweep.fixed.items():
        if isinstance(value, np.generic):
            coordinates[name] = (), value
        else:
            attributes[name] = str(value)
    for name in sweep.fields:
        if name not in arrays and isinstance(sweep[name], str | int | float):
            attributes[name] = sweep[name]
    return columns.dataset(arrays, coordinates, attributes, attributes_of)


def version() -> str:
    """Return the installed version of this library."""
    try:
        return importlib.metadata.version("jaxcontact")
    except importlib.metadata.PackageNotFoundError:
        return "(not installed)"


def attributes_of(name: str) -> dict[str, Any]:
    """Return the dataset attributes of an axis or a field."""
    if name == "status":
        return flag_attributes("status", Status)
    words, unit = meaning(name)
    return {"long_name": words, "units": unit or "1"} if unit or words != name else {}


_ROWS = 1 << 14
"""Rows that are converted to text at once."""

_REPEATED = 4
"""Numbers that occur in this many rows, on average, are converted once."""


def write_csv(table: SweepTable, path: File) -> None:
    """Write a long table, one row per lane; a named file is written completely or not at all."""
    along, lanes = table.dims_of_axes(), math.prod(table.shape)
    # A result may have the name of an axis.
    listed = [
        (name, SweepColumn((table.dims.index(along[name]),), values))
        for name, values in table.axes.items()
    ]
    listed += (table.columns() | {"status": _named(table.status_column)}).items()
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
            where = np.unravel_index(rows, table.shape) if table.shape else ()
            parts = (column.at(where, len(rows)) for column in texts)
            yield [number for part in parts for number in part.reshape(len(rows), -1).T]

    columns.write_csv(path, heads, blocks())


def _named(status: SweepColumn) -> SweepColumn:
    """Return the names of statuses, or the numbers as text if one of them has no name."""
    kinds = {*np.unique(status.values).tolist(), *np.ravel(status.otherwise).tolist()} - {None}
    if not kinds <= set(Status):
        return status.converted(in_words)
    names = np.array([one.name for one in sorted(Status)], object)
    # Statuses of one's own may be flags or floats.
    return status.converted(lambda codes: np.array(names[codes.astype(int)], object))
