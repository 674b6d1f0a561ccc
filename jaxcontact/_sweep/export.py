"""A sweep for other tools: an xarray dataset, or a table in a text file."""

from __future__ import annotations

import functools
import importlib.metadata
import io
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, TextIO, cast

import numpy as np

from .._impact import Status
from .._text.files import write_all
from .._text.units import meaning
from .long_table import rows_of
from .table import SweepTable

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
