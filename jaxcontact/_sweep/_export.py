"""A sweep for other tools: an xarray dataset, or a table in a text file."""

from __future__ import annotations

import csv
import importlib.metadata
import math
import os
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, TextIO

import numpy as np

from .._impact import Status
from .._units import meaning
from ._table import Table

if TYPE_CHECKING:
    import xarray

_ROWS = 1 << 14
"""Rows that are turned into text at once."""


def dataset(sweep: Table) -> xarray.Dataset:
    """The sweep as an `xarray.Dataset`. Raises ImportError without xarray."""
    try:
        import xarray
    except ImportError as error:
        raise ImportError(
            "to_xarray needs xarray, which comes with `pip install 'jaxcontact[data]'`"
        ) from error
    arrays = {}
    for name, column in (sweep.columns() | {"status": sweep.status_column}).items():
        own = [f"{name}_{k}" for k in range(len(column.own_shape))]
        arrays[name] = ([*sweep.dims, *own], column.array(sweep.shape), attributes_of(name))
    along = sweep.dims_of_axes()
    coordinates: dict[str, Any] = {
        name: ([along[name]], values, attributes_of(name)) for name, values in sweep.axes.items()
    }
    attributes: dict[str, Any] = {
        "source": f"jaxcontact {version()}",
        "function": sweep.function,
        "complete": int(sweep.complete),
    }
    for name, value in sweep.fixed.items():
        if isinstance(value, np.generic):
            coordinates[name] = ((), value, attributes_of(name))
        else:
            attributes[name] = str(value)
    for name in sweep.fields:
        if name not in arrays and isinstance(sweep[name], str | int | float):
            attributes[name] = sweep[name]
    return xarray.Dataset(arrays, coordinates, attributes)


def version() -> str:
    """The version of this library, as it is installed."""
    try:
        return importlib.metadata.version("jaxcontact")
    except importlib.metadata.PackageNotFoundError:
        return "(not installed)"


def attributes_of(name: str) -> dict[str, Any]:
    """What the attributes of a dataset say of an axis or a field."""
    if name == "status":
        return {
            "long_name": "status",
            "flag_values": [int(status) for status in Status],
            "flag_meanings": " ".join(status.name.lower() for status in Status),
        }
    words, unit = meaning(name)
    return {"long_name": words, "units": unit or "1"} if unit or words != name else {}


def write_csv(sweep: Table, file: str | os.PathLike | TextIO) -> None:
    """Write a long table, one row for each lane."""
    if isinstance(file, str | os.PathLike):
        with open(file, "w", newline="", encoding="utf-8") as opened:
            return write_csv(sweep, opened)
    columns = {name: column.array(sweep.shape) for name, column in sweep.columns().items()}
    columns.setdefault("status", sweep.status)
    header = [*sweep.axes]
    for name, array in columns.items():
        for place in np.ndindex(array.shape[len(sweep.shape) :]):
            header.append(name + (f"[{','.join(map(str, place))}]" if place else ""))
    along = [sweep.dims.index(dim) for dim in sweep.dims_of_axes().values()]
    lanes = math.prod(sweep.shape)
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(header)
    for start in range(0, lanes, _ROWS):
        rows = np.arange(start, min(start + _ROWS, lanes))
        where = np.unravel_index(rows, sweep.shape) if sweep.shape else ()
        cells = [
            _texts(values[where[dim]])
            for dim, values in zip(along, sweep.axes.values(), strict=True)
        ]
        for name, array in columns.items():
            part = array[where].reshape(len(rows), -1)
            cells += [_texts(part[:, k], name) for k in range(part.shape[1])]
        writer.writerows(zip(*cells, strict=True))


def _texts(values: np.ndarray, name: str = "") -> Iterator[str]:
    if name == "status" and set(np.unique(values)) <= set(Status):
        return (Status(code).name for code in values.tolist())
    # The shortest text that reads back to the same number, in its own precision.
    return iter(values.astype(str))
