"""Rows of named values from a file, an open text, a data frame, a mapping or arrays."""

from __future__ import annotations

import dataclasses
import functools
import importlib.resources
import math
import operator
import os
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NoReturn

import numpy as np

from ...extend import as_array, read_whole, rendered, require_path, written_unit
from ..sound.audio import is_sound
from .grid import Grid, Known, RecordingError
from .heading import Heading
from .text_file import decoded, text_grid
from .workbook import parquet_columns, workbook_grid

_SHIPPED_FILE = "bounce_intervals.csv"

_OTHER_KINDS = {
    b"\x1f\x8b": "compressed (gzip); unpack it first",
    b"%PDF": "a PDF; save the table as CSV",
    b"\x89PNG": "a picture; save the table as CSV",
    b"\xff\xd8\xff": "a picture; save the table as CSV",
}
"""First bytes of files that are not tables, with the advice to give."""


@dataclasses.dataclass(slots=True, eq=False)
class Row:
    """The values of one measurement by column: texts, numbers, or None if missing.

    `headings` are those of the file, by column. Numbers are converted to SI units from the unit of
    the heading.
    """

    source: str
    number: int
    values: Mapping[str, Any]
    headings: Mapping[str, Heading] = dataclasses.field(default_factory=dict)

    def refuse(self, column: str, problem: str) -> NoReturn:
        """Raise RecordingError with the location of this row."""
        shown = self.headings[column].text if column in self.headings else column
        raise RecordingError(problem, self.source, self.number, shown or column)

    def has_unit(self, column: str) -> bool:
        """Return whether the unit of a column is written in its heading."""
        return column in self.headings and self.headings[column].unit is not None

    @property
    def place(self) -> tuple[str, int]:
        """The name of the ball, "" without such a column, and the number of the row."""
        return self.text("ball", ""), self.number

    def text(self, column: str, default: str | None = None) -> str:
        """Return the value as text; `default` if the recording has no such column."""
        if default is not None and column not in self.values:
            return default
        value = self.values[column]
        if isinstance(value, str):
            if (text := value.strip()) in ("", "<NA>"):
                self.refuse(column, "is empty")
            return text
        if not isinstance(value, int | float) and np.ndim(value) > 0:
            self.refuse(column, f"{rendered(value)} is not a single value")
        # 1.0 names the same trial as 1.
        whole = isinstance(value, float) and value.is_integer()
        text = str(int(value) if whole else value).strip()
        # NaN, None and pandas' <NA> mark missing values; a text "nan" is an invalid number.
        if value is None or text in ("", "<NA>") or value != value:
            self.refuse(column, "is empty")
        return text

    def positive(self, column: str, if_zero: str = "") -> float:
        """Return the value as a positive, finite number in SI units, at full precision.

        `if_zero` is the advice that follows the refusal of a zero.
        """
        text, number = self._number(column, "a number")
        if not math.isfinite(number):
            self.refuse(column, f"{text!r} is not a finite number")
        if number <= 0:
            self.refuse(column, f"must be positive, but is {text}{'' if number else if_zero}")
        return self._in_si(column, number)

    def real(self, column: str) -> float:
        """Return the value as a finite number in SI units; NaN for an empty cell."""
        value = self.values[column]
        if value is None or value != value or (isinstance(value, str) and not value.strip()):
            return math.nan
        text, number = self._number(column, "a number")
        if not math.isfinite(number):
            self.refuse(column, f"{text!r} is not a finite number")
        return self._in_si(column, number)

    def _in_si(self, column: str, number: float) -> float:
        heading = self.headings.get(column)
        return number if heading is None or heading.unit is None else heading.unit.to_si(number)

    def count(self, column: str) -> int:
        """Return the value as a non-negative integer."""
        text, number = self._number(column, "a whole number")
        if not number.is_integer():
            self.refuse(column, f"{text!r} is not a whole number")
        if number < 0:
            self.refuse(column, f"must not be negative, but is {text}")
        return int(number)

    def _number(self, column: str, kind: str) -> tuple[str, float]:
        text, value = self.text(column), self.values[column]
        try:
            if isinstance(value, str):
                if ":" in value and self._is_time(column):
                    return text, _seconds(value)
                return text, float(value)
            # `float` would accept bytes and flags, and lose digits of a longdouble.
            if isinstance(value, bytes | bytearray | bool | np.bool_):
                raise TypeError
            if type(value) is np.longdouble:
                raise TypeError
            return text, float(value)
        except (TypeError, ValueError, OverflowError):
            written = "; write the unit in the heading instead" * _has_unit(value)
            self.refuse(column, f"{rendered(text)} is not {kind}{written}")

    def _is_time(self, column: str) -> bool:
        """Return whether a column holds times without a unit that needs conversion."""
        heading = self.headings.get(column)
        return (
            heading is not None
            and heading.is_time
            and not (heading.unit is not None and heading.unit.converts)
        )


_CLOCK = re.compile(r"(?:(\d+):)?(\d+):(\d{1,2}(?:[.,]\d+)?)")


def _seconds(text: str) -> float:
    """Return the seconds of a time as hh:mm:ss.cc or mm:ss.cc; raise ValueError otherwise."""
    found = _CLOCK.fullmatch(text.strip())
    if found is None:
        raise ValueError
    hours, minutes, seconds = found.groups()
    return 3600.0 * int(hours or 0) + 60.0 * int(minutes) + float(seconds.replace(",", "."))


_NUMBER_AND_UNIT = re.compile(r"[+-]?[\d.,]+\s*([^\d\s].*)")


def _has_unit(value: Any) -> bool:
    """Return whether a text is a number followed by a unit."""
    found = _NUMBER_AND_UNIT.fullmatch(value.strip()) if isinstance(value, str) else None
    return found is not None and written_unit(found[1]) is not None


@dataclasses.dataclass(frozen=True)
class Sheet:
    """Named columns; `lines(wanted)` returns row numbers and the cells of some columns.

    `source` and `header_row` (None without a header) locate faults in messages. `wanted` are
    positions among `names`, some of which may be empty. `by_keyword` is True for columns given by
    keyword. `notes` say how a file was read. `repeats` are rows of repeated headings, and `sheets`
    the sheets of a spreadsheet that were read.
    """

    source: str
    names: Sequence[str]
    header_row: int | None
    lines: Callable[[Sequence[int]], list[tuple[int, list[Any]]]]
    notes: tuple[str, ...] = ()
    by_keyword: bool = False
    repeats: tuple[int, ...] = ()
    sheets: tuple[str, ...] = ()

    def beside(self, name: str, value: Callable[[int, int], Any], note: str) -> Sheet:
        """Return the sheet with one more column, `value(k, number)` for row k, from 0."""
        place = len(self.names)

        def lines(wanted: Sequence[int]) -> list[tuple[int, list[Any]]]:
            rows = self.lines([k for k in wanted if k != place])
            if place not in wanted:
                return rows
            at = list(wanted).index(place)
            return [
                (number, [*cells[:at], value(k, number), *cells[at:]])
                for k, (number, cells) in enumerate(rows)
            ]

        return dataclasses.replace(
            self, names=[*self.names, name], lines=lines, notes=(*self.notes, note)
        )

    def rows(self, places: Mapping[str, int], headings: Mapping[str, Heading]) -> list[Row]:
        """Return the rows, with the values of columns at some positions under other names."""
        return [
            Row(self.source, number, dict(zip(places, cells, strict=True)), headings)
            for number, cells in self.lines(list(places.values()))
        ]

    def fault(self, problem: str, column: str | None, row: int | None = None) -> RecordingError:
        """Return the error for a fault in a row, by default in the header."""
        return RecordingError(problem, self.source, row or self.header_row, column)


def sheet_of(
    source: Any,
    columns: Mapping[str, Any],
    known: Known,
    decimal: str | None = None,
    sheet: str | int | None = None,
) -> Sheet:
    """Return the columns in `source`, or those given by keyword; see `read_recording`.

    `known` tests whether a text may be a heading, `decimal` is the decimal mark, and `sheet` the
    sheet of a spreadsheet.
    """
    from_file = functools.partial(_from_file, known=known, decimal=decimal, sheet=sheet)
    if sheet is not None and not (
        isinstance(source, str | os.PathLike) or callable(getattr(source, "read", None))
    ):
        raise ValueError(f"Argument `sheet` must be None without a file, but is {rendered(sheet)}.")
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
        return from_file(shipped.read_bytes, name)
    if isinstance(source, str | os.PathLike):
        path = require_path("source", source)
        return from_file(lambda: read_whole(path), str(path))
    if isinstance(source, Mapping):
        return _from_columns("the dict", source)
    frame = hasattr(source, "columns") and hasattr(source, "__getitem__")
    # Classes of data frames have these attributes too.
    if frame and not isinstance(source, type):
        return _from_columns("the data frame", source)
    if callable(getattr(source, "read", None)) and not isinstance(source, type):
        name = getattr(source, "name", None)
        name = name if isinstance(name, str) else "the text"
        return from_file(source.read, name)
    raise ValueError(
        "Argument `source` must be a path, an open file, a dict of columns, a data frame or "
        f"None, but is {rendered(source)}."
    )


def _from_columns(source: str, columns: Any, *, by_keyword: bool = False) -> Sheet:
    """Return the columns of a mapping, or of a data frame."""
    keys = list(getattr(columns, "columns", columns))
    names = [str(key) for key in keys]

    def lines(wanted: Sequence[int]) -> list[tuple[int, list[Any]]]:
        # As objects, numbers keep full precision and missing values stay unchanged.
        arrays = {names[k]: _values(columns[keys[k]], source, names[k]) for k in wanted}
        if not arrays:
            return []
        first = next(iter(arrays))
        for name, array in arrays.items():
            if array.ndim != 1:
                given = rendered(columns[keys[names.index(name)]])
                problem = f"must be one-dimensional, but has the shape {array.shape}: it is {given}"
                raise RecordingError(problem, source, column=name)
            if len(array) != len(arrays[first]):
                problem = f"has {len(array)} values where column {first} has {len(arrays[first])}"
                raise RecordingError(problem, source, column=name)
        values = zip(*(array.tolist() for array in arrays.values()), strict=True)
        return [(k, list(cells)) for k, cells in enumerate(values, 1)]

    return Sheet(source, names, None, lines, by_keyword=by_keyword)


def _values(given: Any, source: str, name: str) -> np.ndarray:
    """Return a column as objects; raise RecordingError if conversion would change its values."""
    plain = as_array(given) if hasattr(given, "__array__") else None
    kind = "O" if plain is None else plain.dtype.kind
    array = as_array(None if isinstance(given, bytearray) else given, object)
    if array is None:
        problem = f"must be a column of numbers or texts, but is {rendered(given)}"
        raise RecordingError(problem, source, column=name)
    # NumPy would drop a mask, and convert dates and durations to integers.
    if isinstance(given, np.ma.MaskedArray) or kind in "mM":
        what = "dates or durations" if kind in "mM" else "masked"
        problem = f"must hold numbers or texts and no mask, but is {what}: {rendered(given)}"
        raise RecordingError(problem, source, column=name)
    return array


def _from_file(
    read: Callable[[], Any], source: str, known: Known, decimal: str | None, sheet: str | int | None
) -> Sheet:
    """Return the columns of the file that `read` returns; its first bytes decide the kind."""
    try:
        content = read()
    except OSError as error:
        raise RecordingError(f"cannot be read ({error.strerror or error})", source) from error
    except UnicodeDecodeError as error:
        # The bytes before the invalid one are valid, so its line can be counted.
        row = error.object[: error.start].count(b"\n") + 1
        problem = f"is not {error.encoding.upper()} text; give its path, or open it as bytes"
        raise RecordingError(problem, source, row) from error
    encoding = ""
    if isinstance(content, bytes):
        if content.startswith(b"PAR1") and sheet is None:
            return _from_columns(source, parquet_columns(content, source))
        if content.startswith((b"PK\x03\x04", b"\xd0\xcf\x11\xe0")):
            return _of_grid(*workbook_grid(content, source, known, decimal, sheet))
        if is_sound(content[:16]):
            raise RecordingError("is a sound, which has no such columns", source)
        for beginning, words in _OTHER_KINDS.items():
            if content.startswith(beginning):
                raise RecordingError(f"is {words}", source)
        content, encoding = decoded(content, source)
    if not isinstance(content, str):
        raise RecordingError(f"must hold text, but holds {rendered(content)}", source)
    if sheet is not None:
        raise RecordingError("has no sheets; omit `sheet`", source)
    grid = text_grid(content, source, known, decimal)
    notes = (*([encoding] if encoding else []), *grid.notes)
    return _of_grid(dataclasses.replace(grid, notes=notes), source)


def _of_grid(grid: Grid, source: str) -> Sheet:
    names = grid.names

    def lines(wanted: Sequence[int]) -> list[tuple[int, list[Any]]]:
        for number, cells in grid.rows:
            if len(cells) <= len(names):
                continue
            full = len(cells) - next((k for k, c in enumerate(reversed(cells)) if c != ""), 0)
            if full > len(names):
                split = full == 2 * len(names)
                guess = "; are its commas decimal? then separate by semicolons" * split
                problem = f"has {full} fields where the header has {len(names)}{guess}"
                raise RecordingError(problem, source, number, names[-1])
        # Fields missing from a short line are empty.
        end, some = max(wanted, default=-1), len(wanted) > 1
        pick = operator.itemgetter(*wanted) if some else lambda cells: [cells[k] for k in wanted]
        return [
            (number, list(pick(cells)))
            if len(cells) > end
            else (number, [cells[k] if k < len(cells) else "" for k in wanted])
            for number, cells in grid.rows
        ]

    more = {"repeats": grid.repeats, "sheets": grid.sheets}
    return Sheet(source, names, grid.header_row, lines, grid.notes, **more)
