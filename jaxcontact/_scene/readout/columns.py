"""Columns of numbers and words as CSV text."""

from __future__ import annotations

import csv
import functools
import io
import os
import pathlib
from collections.abc import Mapping
from typing import Any, BinaryIO, TextIO, cast

import numpy as np

from ..._entry import require_path
from ..._text.files import write_all


def write_csv(
    columns: Mapping[str, np.ndarray], path: str | os.PathLike[str] | TextIO | BinaryIO
) -> None:
    """Write columns (K,) with a header to a path or an open file. A named file appears whole or not
    at all. Every number is the shortest text that reads back to it, in its own precision. Raises
    ValueError if `path` is neither a path nor an open file.
    """
    if not hasattr(path, "write"):
        write_all({require_path("path", path): functools.partial(write_csv, columns)})
        return
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    texts = (np.asarray(column).astype(str).tolist() for column in columns.values())
    writer.writerows(zip(*texts, strict=True))
    binary = isinstance(path, io.BufferedIOBase | io.RawIOBase)
    cast(Any, path).write(text.getvalue().encode() if binary else text.getvalue())


def state_columns(states: Any) -> dict[str, np.ndarray]:
    """Return `time`, `energy`, and each number of `position`, `velocity` and `spin` as a column."""
    columns = {"time": np.asarray(states.time), "energy": np.asarray(states.energy)}
    for name in ("position", "velocity", "spin"):
        values = getattr(states, name)
        if values is not None:
            values = np.asarray(values)
            for place in np.ndindex(*values.shape[1:]):
                columns[f"{name}[{','.join(map(str, place))}]"] = values[:, *place]
    return columns


def states_in_csv(path: pathlib.Path) -> dict[str, np.ndarray]:
    """Return the arrays of a file of `state_columns` by name; `spin` is missing without it.

    Raises ValueError for other columns, and OSError for a file that cannot be read.
    """
    with path.open(newline="") as file:
        heads = next(csv.reader(file), [])
        lines = file.readlines()
    if not lines:
        raise ValueError(f"{path} must have a row for each time, but has none.")
    values = np.loadtxt(lines, delimiter=",", ndmin=2)
    arrays: dict[str, np.ndarray] = {}
    for name in ("time", "energy", "position", "velocity", "spin"):
        named = [k for k, head in enumerate(heads) if head.partition("[")[0] == name]
        if not named and name != "spin":
            raise ValueError(f"{path} must have columns of `Run.to_csv`, but has no {name!r}.")
        if named:
            last = heads[named[-1]].partition("[")[2].rstrip("]")
            shape = [int(k) + 1 for k in last.split(",")] if last else []
            arrays[name] = values[:, named].reshape(-1, *shape)
    return arrays
