"""Rows of named values from a file, an open text, a data frame, a mapping or arrays."""

from __future__ import annotations

import csv
import dataclasses
import importlib.resources
import io
import itertools
import math
import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NoReturn

import numpy as np

from .._parameter import as_array, rendered, require_path

_SHIPPED_FILE = "bounce_intervals.csv"


class RecordingError(ValueError):
    """A fault in a recording, with its `source`, `row` and `column` (None where it has none).

    `problem` is the message without the place. In a file `row` is the line, the header counted;
    in columns of values it counts measurements from 1.
    """

    def __init__(
        self, problem: str, source: str, row: int | None = None, column: str | None = None
    ):
        self.problem, self.source, self.row, self.column = problem, source, row, column
        place = [source, f"row {row}" if row else "", f"column {column}" if column else ""]
        super().__init__(f"{', '.join(filter(None, place))}: {problem}")


@dataclasses.dataclass(frozen=True)
class Row:
    """The values of one measurement by column; texts, numbers, or None for what is missing."""

    source: str
    number: int
    values: Mapping[str, Any]

    def refuse(self, column: str, problem: str) -> NoReturn:
        """Raise RecordingError with the place of this row."""
        raise RecordingError(problem, self.source, self.number, column)

    @property
    def place(self) -> tuple[str, int]:
        """The name of the ball, "" without such a column, and the number of the row."""
        return self.text("ball", ""), self.number

    def text(self, column: str, default: str | None = None) -> str:
        """The value as text; `default` where the recording has no such column."""
        if default is not None and column not in self.values:
            return default
        value = self.values[column]
        if not isinstance(value, str | int | float) and np.ndim(value) > 0:
            self.refuse(column, f"{rendered(value)} is no single value")
        # 1.0 names the same trial as 1.
        whole = isinstance(value, float) and value.is_integer()
        text = str(int(value) if whole else value).strip()
        # NaN, None and pandas' <NA> stand for what is missing; a text "nan" is a bad number.
        if value is None or text in ("", "<NA>") or value != value:
            self.refuse(column, "is empty")
        return text

    def positive(self, column: str) -> float:
        """The value as a positive, finite number, with all its bits."""
        text, number = self._number(column, "a number")
        if not math.isfinite(number):
            self.refuse(column, f"{text!r} is not a finite number")
        if number <= 0:
            self.refuse(column, f"must be positive, but is {text}")
        return number

    def count(self, column: str) -> int:
        """The value as a whole number that is not negative."""
        text, number = self._number(column, "a whole number")
        if not number.is_integer():
            self.refuse(column, f"{text!r} is not a whole number")
        if number < 0:
            self.refuse(column, f"must not be negative, but is {text}")
        return int(number)

    def _number(self, column: str, kind: str) -> tuple[str, float]:
        text, value = self.text(column), self.values[column]
        try:
            # `float` takes bytes and flags, too, and cuts digits off.
            if isinstance(value, bytes | bytearray | bool | np.bool_):
                raise TypeError
            if type(value) is np.longdouble:
                raise TypeError
            return text, float(value)
        except (TypeError, ValueError, OverflowError):
            self.refuse(column, f"{rendered(text)} is not {kind}")


@dataclasses.dataclass(frozen=True)
class Sheet:
    """Named columns; `rows(wanted)` are their rows, with those of the wanted columns that exist.

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
        return RecordingError(problem, self.source, row or self.header_row, column)


def sheet_of(source: Any, columns: Mapping[str, Any]) -> Sheet:
    """The columns in `source`, or those given by keyword. See `read_recording`."""
    if columns:
        if source is not None:
            raise ValueError(
                "Argument `source` must be None where columns are given by keyword, but is "
                f"{type(source).__name__!r}."
            )
        return _from_columns("the columns given", columns, by_keyword=True)
    if source is None:
        shipped = importlib.resources.files("jaxcontact.data") / _SHIPPED_FILE
        name = f"{_SHIPPED_FILE} (shipped with the package)"
        return _from_text(lambda: shipped.read_text(encoding="utf-8"), name)
    if isinstance(source, str | os.PathLike):
        path = require_path("source", source)
        return _from_text(lambda: path.read_text(encoding="utf-8"), str(path))
    if isinstance(source, Mapping):
        return _from_columns("the dict", source)
    frame = hasattr(source, "columns") and hasattr(source, "__getitem__")
    # The class of data frames has them, too.
    if frame and not isinstance(source, type):
        return _from_columns("the data frame", source)
    if callable(getattr(source, "read", None)) and not isinstance(source, type):
        name = getattr(source, "name", None)
        return _from_text(source.read, name if isinstance(name, str) else "the text")
    raise ValueError(
        "Argument `source` must be a path, an open text file, a dict of columns, a data frame or "
        f"None, but is {rendered(source)}."
    )


def _from_columns(source: str, columns: Any, *, by_keyword: bool = False) -> Sheet:
    """The columns of a mapping, or of a data frame."""
    keys = list(getattr(columns, "columns", columns))
    names = [str(key) for key in keys]

    def rows(wanted: Sequence[str]) -> list[Row]:
        # As objects, numbers keep all their bits and missing values stay what they are.
        arrays = {
            name: _values(columns[key], source, name)
            for name, key in zip(names, keys, strict=True)
            if name in wanted
        }
        first = next(iter(arrays))
        for name, array in arrays.items():
            if array.ndim != 1:
                given = rendered(columns[keys[names.index(name)]])
                problem = f"must be one-dimensional, but has the shape {array.shape}: it is {given}"
                raise RecordingError(problem, source, column=name)
            if len(array) != len(arrays[first]):
                problem = f"has {len(array)} values where column {first} has {len(arrays[first])}"
                raise RecordingError(problem, source, column=name)
        lines = zip(*(array.tolist() for array in arrays.values()), strict=True)
        return [Row(source, k, dict(zip(arrays, v, strict=True))) for k, v in enumerate(lines, 1)]

    return Sheet(source, names, None, rows, by_keyword)


def _values(given: Any, source: str, name: str) -> np.ndarray:
    """A column as objects. Raises RecordingError for what hides or changes its values."""
    plain = as_array(given) if hasattr(given, "__array__") else None
    kind = "O" if plain is None else plain.dtype.kind
    array = as_array(None if isinstance(given, bytearray) else given, object)
    if array is None:
        problem = f"must be a column of numbers or texts, but is {rendered(given)}"
        raise RecordingError(problem, source, column=name)
    # A mask would be dropped, and NumPy counts dates and durations in whole numbers.
    if isinstance(given, np.ma.MaskedArray) or kind in "mM":
        what = "dates or durations" if kind in "mM" else "masked"
        problem = f"must hold numbers or texts and no mask, but is {what}: {rendered(given)}"
        raise RecordingError(problem, source, column=name)
    return array


def _from_text(read: Callable[[], Any], source: str) -> Sheet:
    """The columns of the CSV text that `read` returns."""
    try:
        text = read()
    except OSError as error:
        raise RecordingError(f"cannot be read ({error.strerror or error})", source) from error
    except UnicodeDecodeError as error:
        # The bytes before the bad one are good, so its line can be counted.
        row = error.object[: error.start].count(b"\n") + 1
        raise RecordingError(f"is not {error.encoding.upper()} text", source, row) from error
    if not isinstance(text, str):
        raise RecordingError("must be opened as text, not as bytes", source)
    reader = csv.reader(io.StringIO(text.removeprefix("\ufeff"), newline=""), strict=True)
    try:
        lines = [(reader.line_num, [field.strip() for field in fields]) for fields in reader]
    except csv.Error as error:
        raise RecordingError(f"is not a CSV file ({error})", source, reader.line_num) from error
    lines = [(row, fields) for row, fields in lines if any(fields)]
    if not lines:
        raise RecordingError("is empty; a header with the column names is needed", source, 1)
    (header_row, names), *measured = lines

    def row_of(number: int, fields: list[str], wanted: Sequence[str]) -> Row:
        if len(fields) > len(names):
            problem = f"has {len(fields)} fields where the header has {len(names)}"
            raise RecordingError(problem, source, number, names[-1])
        # Fields that a short line lacks are empty.
        values = itertools.zip_longest(names, fields, fillvalue="")
        return Row(source, number, {name: value for name, value in values if name in wanted})

    return Sheet(source, names, header_row, lambda wanted: [row_of(*m, wanted) for m in measured])
