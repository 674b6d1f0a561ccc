"""Columns of results: as CSV, as datasets of xarray, and in words."""

from __future__ import annotations

import csv
import enum
import functools
import io
import os
import pathlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, BinaryIO, ClassVar, TextIO, cast

import equinox as eqx
import jax
import numpy as np
from jaxtyping import ArrayLike

from .._entry import as_parameter, refusal, require_path, traced
from .files import write_all
from .words import Words, abridged, counted, text_table

if TYPE_CHECKING:
    import xarray

File = str | os.PathLike[str] | TextIO | BinaryIO


class WrittenAsCsv:
    """A result whose columns may be written as CSV."""

    def _columns(self) -> dict[str, np.ndarray]:
        """Return the columns of a single run by name."""
        raise NotImplementedError

    def to_csv(self, path: File) -> None:
        """Write the columns as CSV, each under its name, a row for each time or event.

        `path` is an open file or a file name. A named file appears whole or not at all. Every
        number is the shortest text that reads back to it. Raises ValueError for a batch of runs.
        """
        columns = self._columns()
        write_csv(path, columns, [list(columns.values())])


class EventTable(WrittenAsCsv):
    """Events (K,) of a run, a row each, of which those that are `valid` count."""

    time: Any
    valid: Any
    _events: ClassVar[Words]

    def __len__(self) -> int:
        return self.time.shape[-1]

    def to_dict(self) -> dict[str, np.ndarray]:
        """Return the columns of the valid rows as NumPy arrays by name. Raises ValueError for a
        batch of runs: select one with `jax.tree.map`.
        """
        keep = np.asarray(self.valid)
        if keep.ndim != 1:
            raise ValueError(
                f"The {self._events[1]} must be those of one run, but are a batch of the shape "
                f"{keep.shape[:-1]}; `jax.tree.map(lambda x: x[0], run)` takes the first run."
            )
        columns = {name: column for name, column in vars(self).items() if eqx.is_array(column)}
        del columns["valid"]
        return {name: np.asarray(column)[keep] for name, column in columns.items()}

    def _columns(self) -> dict[str, np.ndarray]:
        return self.to_dict()

    def _cells(self) -> dict[str, Iterable[str]]:
        """Return the columns that are printed, as texts under their headings."""
        raise NotImplementedError

    def __repr__(self) -> str:
        if traced(self.time) or not eqx.is_array(self.time) or self.time.ndim != 1:
            return f"{type(self).__name__}({eqx.tree_pformat(self.time)})"
        cells = self._cells()
        rows = list(zip(*cells.values(), strict=True))
        lines = text_table(abridged(rows), header=list(cells), indent=2, rule=True)
        return "\n".join([counted(len(rows), self._events), *lines])


def digits(column: np.ndarray, count: int = 6) -> list[str]:
    """Return numbers with so many digits."""
    return [f"{number:.{count}g}" for number in column]


def in_lines(head: str, texts: Mapping[str, str], width: int = 10) -> str:
    """Return a heading, and a line for each text behind its name."""
    return "\n".join([head, *(f"  {name:<{width}}{text}" for name, text in texts.items())])


def as_times(time: ArrayLike) -> jax.Array:
    """Return the times (T,) of one number or several. Raises ValueError for anything else."""
    times = as_parameter(time, "time")
    if times.ndim > 1:
        raise refusal("time", "be a number or a list of numbers", time)
    return times.reshape(-1) if traced(times) else jax.device_put(np.asarray(times).reshape(-1))


def state_columns(
    states: Any, names: Sequence[str] = ("time", "energy", "position", "velocity", "spin")
) -> dict[str, np.ndarray]:
    """Return each number of states at times (T,) as a column. Raises ValueError for a batch."""
    if states.time.ndim != 1:
        raise ValueError(
            f"The run must be a single one, but is a batch of the shape {states.time.shape[:-1]}."
        )
    listed = {name: getattr(states, name) for name in names}
    arrays = {name: np.asarray(values) for name, values in listed.items() if values is not None}
    return {
        head: values[:, *place]
        for name, values in arrays.items()
        for head, place in numbered(name, values.shape[1:])
    }


def numbered(name: str, shape: Sequence[int]) -> list[tuple[str, tuple[int, ...]]]:
    """Return a heading for each number of an array, `position[0,1]`, and its place."""
    places = np.ndindex(*shape)
    return [(f"{name}[{','.join(map(str, place))}]".removesuffix("[]"), place) for place in places]


def in_words(values: np.ndarray) -> np.ndarray:
    """Return the shortest text of each number that reads back to it, in its own precision."""
    if values.dtype == object:
        return values
    plain = values.reshape(-1)
    # The same text as NumPy's, in a fifth of the time.
    quick = plain.dtype in (np.float64, np.int64, np.int32, bool)
    texts = list(map(repr, plain.tolist())) if quick else plain.astype(str).tolist()
    return np.array(texts, object).reshape(values.shape)


def write_csv(path: File, heads: Iterable[str], blocks: Iterable[Sequence[np.ndarray]]) -> None:
    """Write a header and blocks of columns to a path or an open file. A named file appears whole or
    not at all. Raises ValueError if `path` is neither a path nor an open file.
    """
    if not hasattr(path, "write"):
        write = functools.partial(write_csv, heads=heads, blocks=blocks)
        write_all({require_path("path", path): write})
        return
    binary, text = isinstance(path, io.BufferedIOBase | io.RawIOBase), io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(heads)
    for columns in blocks:
        texts = (in_words(np.asarray(column)).tolist() for column in columns)
        writer.writerows(zip(*texts, strict=True))
        cast(Any, path).write(text.getvalue().encode() if binary else text.getvalue())
        text.seek(0)
        text.truncate()


def states_in_csv(path: pathlib.Path) -> dict[str, np.ndarray]:
    """Return the arrays of a file of `Run.to_csv` by name; `spin` is missing without it.

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


Arrays = Mapping[str, tuple[Any, ...]]
"""Arrays by name, each behind the names of its axes."""


def dataset(
    arrays: Arrays,
    coordinates: Arrays,
    attributes: Mapping[str, Any],
    attributes_of: Callable[[str], Mapping[str, Any]],
) -> xarray.Dataset:
    """Return a dataset, with the attributes of each array. Raises ImportError without xarray."""
    try:
        import xarray
    except ImportError as error:
        raise ImportError(
            "to_xarray needs xarray, which comes with `pip install 'jaxcontact[data]'`"
        ) from error
    arrays, coordinates = (
        {name: (*array, attributes_of(name)) for name, array in group.items()}
        for group in (arrays, coordinates)
    )
    return xarray.Dataset(arrays, coordinates, attributes)


def quantity_attributes(words: str = "", unit: str = "") -> dict[str, Any]:
    """Return the attributes of a quantity, without those that are empty."""
    return ({"long_name": words} if words else {}) | ({"units": unit} if unit else {})


def flag_attributes(words: str, flags: type[enum.IntEnum]) -> dict[str, Any]:
    """Return the attributes of numbers that are flags, with the names of these."""
    return {
        "long_name": words,
        "flag_values": [int(flag) for flag in flags],
        "flag_meanings": " ".join(flag.name.lower() for flag in flags),
    }
