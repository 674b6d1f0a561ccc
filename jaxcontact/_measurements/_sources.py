"""Rows from a file, an open text, a data frame, a mapping or arrays."""

from __future__ import annotations

import csv
import dataclasses
import importlib.resources
import io
import itertools
import os
import pathlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from ._rows import RecordingError, Row

_SHIPPED_FILE = "bounce_intervals.csv"
SHIPPED = f"{_SHIPPED_FILE} (shipped with the package)"


@dataclasses.dataclass(frozen=True)
class Sheet:
    """Named columns; `rows(wanted)` are their rows, with the wanted columns that there are.

    `source` and `header_row` (None where there is no header) are the places for messages;
    `by_keyword` is true for columns given by keyword.
    """

    source: str
    names: Sequence[str]
    header_row: int | None
    rows: Callable[[Sequence[str]], list[Row]]
    by_keyword: bool = False

    def fault(self, problem: str, column: str | None, row: int | None = None) -> RecordingError:
        """The error for a fault in a row, in the header if none is given."""
        row = self.header_row if row is None else row
        return RecordingError(problem, source=self.source, row=row, column=column)


def sheet_of(source: Any, columns: Mapping[str, Any]) -> Sheet:
    """The columns in `source`, or those given by keyword. See `read_recording`."""
    if columns:
        if source is not None:
            raise ValueError(
                "Argument `source` must be None where columns are given by keyword, but is "
                f"{type(source).__name__!r}."
            )
        sheet = _from_columns("the columns given", list(columns), columns)
        return dataclasses.replace(sheet, by_keyword=True)
    if source is None:
        resource = importlib.resources.files("jaxcontact.data") / _SHIPPED_FILE
        return _from_text(resource.read_text(encoding="utf-8"), SHIPPED)
    if isinstance(source, str | os.PathLike):
        path = pathlib.Path(source)
        return _from_text(_text(lambda: path.read_text(encoding="utf-8-sig"), str(path)), str(path))
    if isinstance(source, Mapping):
        return _from_columns("the dict", list(source), source)
    if hasattr(source, "columns") and hasattr(source, "__getitem__"):
        return _from_columns("the data frame", list(source.columns), source)
    if hasattr(source, "read"):
        name = getattr(source, "name", None)
        name = name if isinstance(name, str) else "the text"
        return _from_text(_text(source.read, name), name)
    raise ValueError(
        "Argument `source` must be a path, an open text file, a dict of columns, a data frame or "
        f"None, but is {source!r}."
    )


def _from_columns(source: str, keys: Sequence[Any], columns: Any) -> Sheet:
    """The columns `columns[key]`."""
    names = [str(key) for key in keys]

    def rows(wanted: Sequence[str]) -> list[Row]:
        # As objects, numbers keep all their bits and missing values stay what they are.
        arrays = {
            name: np.asarray(columns[key], dtype=object)
            for name, key in zip(names, keys, strict=True)
            if name in wanted
        }
        first = next(iter(arrays))
        for name, array in arrays.items():
            problem = None
            if array.ndim != 1:
                problem = f"must be one-dimensional, but has the shape {array.shape}"
            elif len(array) != len(arrays[first]):
                problem = f"has {len(array)} values where column {first} has {len(arrays[first])}"
            if problem:
                raise RecordingError(problem, source=source, column=name)
        lines = zip(*(array.tolist() for array in arrays.values()), strict=True)
        return [Row(source, k, dict(zip(arrays, v, strict=True))) for k, v in enumerate(lines, 1)]

    return Sheet(source, names, None, rows)


def _text(read: Callable[[], Any], source: str) -> str:
    try:
        text = read()
    except OSError as error:
        raise RecordingError(
            f"cannot be read ({error.strerror or error})", source=source
        ) from error
    except UnicodeDecodeError as error:
        # The bytes before the bad one are good, so its line can be counted.
        row = error.object[: error.start].count(b"\n") + 1
        encoding = error.encoding.upper()
        raise RecordingError(f"is not {encoding} text", source=source, row=row) from error
    if not isinstance(text, str):
        raise RecordingError("must be opened as text, not as bytes", source=source)
    return text.removeprefix("\ufeff")


def _from_text(text: str, source: str) -> Sheet:
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    try:
        lines = [(reader.line_num, [field.strip() for field in fields]) for fields in reader]
    except csv.Error as error:
        raise RecordingError(
            f"is not a CSV file ({error})", source=source, row=reader.line_num
        ) from error
    lines = [(row, fields) for row, fields in lines if any(fields)]
    if not lines:
        raise RecordingError(
            "is empty; a header with the column names is needed", source=source, row=1
        )
    (header_row, names), *measured = lines

    def row(number: int, fields: list[str], wanted: Sequence[str]) -> Row:
        if len(fields) > len(names):
            problem = f"has {len(fields)} fields where the header has {len(names)}"
            raise RecordingError(problem, source=source, row=number, column=names[-1])
        # Fields that a short line lacks are empty.
        values = itertools.zip_longest(names, fields, fillvalue="")
        return Row(source, number, {name: value for name, value in values if name in wanted})

    return Sheet(source, names, header_row, lambda wanted: [row(*m, wanted) for m in measured])
