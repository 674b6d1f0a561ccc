"""A sweep for other tools: an xarray dataset, or text, one row per lane, a few thousand rows at a
time.
"""

from __future__ import annotations

import csv
import functools
import importlib.metadata
import io
import math
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, TextIO, cast

import numpy as np

from .._impact import Status
from .._text.files import write_all
from .._text.units import meaning
from .table import SweepColumn, SweepTable, within

if TYPE_CHECKING:
    import xarray


def dataset(sweep: SweepTable) -> xarray.Dataset:
    """Return the sweep as an `xarray.Dataset`. Raises ImportError without xarray."""
    try:
        import xarray
    except ImportError as error:
        raise ImportError(
            "to_xarray needs xarray, which comes with `pip install 'jaxcontact[data]'`"
        ) from error
    arrays = {}
    for name, column in (sweep.columns() | {"status": sweep.status_column}).items():
        own_dims = [f"{name}_{k}" for k in range(len(column.own_shape))]
        arrays[name] = ([*sweep.dims, *own_dims], column.array(sweep.shape), attributes_of(name))
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
    """Return the installed version of this library."""
    try:
        return importlib.metadata.version("jaxcontact")
    except importlib.metadata.PackageNotFoundError:
        return "(not installed)"


def attributes_of(name: str) -> dict[str, Any]:
    """Return the dataset attributes of an axis or a field."""
    if name == "status":
        return {
            "long_name": "status",
            "flag_values": [int(status) for status in Status],
            "flag_meanings": " ".join(status.name.lower() for status in Status),
        }
    words, unit = meaning(name)
    return {"long_name": words, "units": unit or "1"} if unit or words != name else {}


def write_csv(sweep: SweepTable, file: str | os.PathLike[str] | TextIO | BinaryIO) -> None:
    """Write a long table, one row per lane; a named file is written completely or not at all."""
    if isinstance(file, str | os.PathLike):
        write_all({Path(file): functools.partial(write_csv, sweep)})
        return
    binary = isinstance(file, io.BufferedIOBase | io.RawIOBase)
    for rows in rows_of(sweep):
        cast(Any, file).write(rows.encode() if binary else rows)


_ROWS = 1 << 14
"""Rows that are converted to text at once."""

_REPEATED = 4
"""Numbers that occur in this many rows, on average, are converted once."""

Lanes = Sequence[np.ndarray]
"""The index of some lanes along each dimension."""


def rows_of(table: SweepTable) -> Iterator[str]:
    """Yield the header of the table, then its rows."""
    along = table.dims_of_axes()
    columns = [
        (name, SweepColumn((table.dims.index(along[name]),), values))
        for name, values in table.axes.items()
    ]
    columns += (table.columns() | {"status": table.status_column}).items()
    head = io.StringIO()
    csv.writer(head, lineterminator="\n").writerow(
        f"{name}[{','.join(map(str, place))}]".removesuffix("[]")
        for name, column in columns
        for place in np.ndindex(column.own_shape)
    )
    yield head.getvalue()
    lanes = math.prod(table.shape)
    ready = [
        _texts(name, column.values) if _REPEATED * math.prod(column.stored.shape) <= lanes else None
        for name, column in columns
    ]
    for start in range(0, lanes, _ROWS):
        rows = np.arange(start, min(start + _ROWS, lanes))
        where = np.unravel_index(rows, table.shape) if table.shape else ()
        cells = [
            text
            for (name, column), texts in zip(columns, ready, strict=True)
            for text in _cells(name, column, texts, where, len(rows))
        ]
        yield "\n".join(map(",".join, zip(*cells, strict=True))) + "\n"


def _cells(
    name: str, column: SweepColumn, ready: np.ndarray | None, lanes: Lanes, count: int
) -> Iterator[list[str]]:
    """Yield the texts in some lanes, one list for each of the column's numbers per lane."""
    texts = _texts(name, _read(column, lanes)) if ready is None else ready[_place(column, lanes)]
    texts = np.broadcast_to(texts, (count, *column.own_shape))
    keep = np.ones(count, bool)
    for mask in column.masks:
        keep &= _read(mask, lanes)
    if not keep.all():
        keep = within(keep, (0,), range(texts.ndim))
        texts = np.where(keep, texts, _texts(name, np.asarray(column.otherwise)))
    texts = texts.reshape(count, -1)
    return (texts[:, k].tolist() for k in range(texts.shape[1]))


def _texts(name: str, values: np.ndarray) -> np.ndarray:
    """Convert each number to the shortest text that restores it in its own precision."""
    plain = values.reshape(-1)
    if name == "status" and set(np.unique(plain)) <= set(Status):
        texts = [Status(code).name for code in plain.tolist()]
    elif plain.dtype in (np.float64, np.int64, np.int32, bool):
        texts = list(map(repr, plain.tolist()))
    else:
        texts = plain.astype(str).tolist()
    return np.array(texts, object).reshape(values.shape)


def _place(column: SweepColumn, lanes: Lanes) -> tuple[np.ndarray, ...]:
    return tuple(lanes[d] for d in column.dims)


def _read(column: SweepColumn, lanes: Lanes) -> np.ndarray:
    """Return the stored numbers in some lanes; from disk, read only the part that holds them."""
    if not column.dims:
        return column.values
    first, *others = _place(column, lanes)
    low, high = int(first.min()), int(first.max())
    return np.asarray(column.stored[low : high + 1])[(first - low, *others)]
