"""Rows of named values, and the error of a recording."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NoReturn

import numpy as np

from ...extend import Unit, rendered, written_unit
from .heading import Heading


class RecordingError(ValueError):
    """A fault in a recording, with its `source`, `row` and `column` (None if not applicable).

    `problem` is the message without the location. In a file `row` is the line, counting the header;
    in columns of values it counts measurements from 1.
    """

    def __init__(
        self, problem: str, source: str, row: int | None = None, column: str | None = None
    ):
        self.problem: str = problem
        self.source: str = source
        self.row: int | None = row
        self.column: str | None = column
        place = [source, f"row {row}" if row else "", f"column {column}" if column else ""]
        super().__init__(f"{', '.join(filter(None, place))}: {problem}")


Line = tuple[int, list[Any]]
"""The number of a row in its file, and its cells: texts, numbers, None."""


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
        return self._unit(column) is not None

    def _unit(self, column: str) -> Unit | None:
        return self.headings[column].unit if column in self.headings else None

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
        if np.ndim(value) > 0:
            self.refuse(column, f"{rendered(value)} is not a single value")
        # 1.0 names the same trial as 1.
        whole = isinstance(value, float) and value.is_integer()
        text = str(int(value) if whole else value).strip()
        # NaN, None and pandas' <NA> mark missing values; a text "nan" is an invalid number.
        if text in ("", "<NA>", "None") or value != value:
            self.refuse(column, "is empty")
        return text

    def positive(self, column: str, if_zero: str = "") -> float:
        """Return the value as a positive, finite number in SI units, at full precision.

        `if_zero` is the advice that follows the refusal of a zero.
        """
        text, number = self._finite(column)
        if number <= 0:
            self.refuse(column, f"must be positive, but is {text}{'' if number else if_zero}")
        return self._in_si(column, number)

    def real(self, column: str) -> float:
        """Return the value as a finite number in SI units; NaN for an empty cell."""
        if is_empty(self.values[column]):
            return math.nan
        return self._in_si(column, self._finite(column)[1])

    def _finite(self, column: str) -> tuple[str, float]:
        text, number = self._number(column, "a number")
        if not math.isfinite(number):
            self.refuse(column, f"{text!r} is not a finite number")
        return text, number

    def _in_si(self, column: str, number: float) -> float:
        unit = self._unit(column)
        return number if unit is None else unit.to_si(number)

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
                unit, heading = self._unit(column), self.headings.get(column)
                # Clock times have no unit that needs conversion.
                clock = heading is not None and heading.is_time and not (unit and unit.converts)
                return text, seconds_in(value) if clock else float(value)
            # `float` would accept bytes and flags, and lose digits of a longdouble.
            if isinstance(value, bytes | bytearray | bool | np.bool_):
                raise TypeError
            if type(value) is np.longdouble:
                raise TypeError
            return text, float(value)
        except (TypeError, ValueError, OverflowError):
            written = "; write the unit in the heading instead" * _has_unit(value)
            self.refuse(column, f"{rendered(text)} is not {kind}{written}")


_CLOCK = re.compile(r"(?:(\d+):)?(\d+):(\d{1,2}(?:[.,]\d+)?)")


def is_empty(cell: Any) -> bool:
    """Return whether a cell is missing, NaN or blank."""
    return cell is None or cell != cell or (isinstance(cell, str) and not cell.strip())


def seconds_in(text: str) -> float:
    """Return the seconds of a number, or of hh:mm:ss.cc or mm:ss.cc; raise ValueError otherwise."""
    found = _CLOCK.fullmatch(text.strip())
    if found is None:
        return float(text)
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
    lines: Callable[[Sequence[int]], list[Line]]
    notes: tuple[str, ...] = ()
    by_keyword: bool = False
    repeats: tuple[int, ...] = ()
    sheets: tuple[str, ...] = ()

    def beside(self, name: str, value: Callable[[int, int], Any], note: str) -> Sheet:
        """Return the sheet with one more column, `value(k, number)` for row k, from 0."""
        place = len(self.names)

        def lines(wanted: Sequence[int]) -> list[Line]:
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

    def require_one(self) -> None:
        """Raise RecordingError if several sheets hold times, which are those of several records."""
        if len(self.sheets) > 1:
            named = ", ".join(map(repr, self.sheets))
            raise self.fault(f"holds a record in each of {named}; choose one with `sheet=`", "time")

    def fault(self, problem: str, column: str | None, row: int | None = None) -> RecordingError:
        """Return the error for a fault in a row, by default in the header."""
        return RecordingError(problem, self.source, row or self.header_row, column)


def sheet_of_rows(
    source: str,
    names: list[str],
    header_row: int | None,
    rows: list[Line],
    notes: Sequence[str],
    repeats: Sequence[int] = (),
) -> Sheet:
    """Return the sheet with these rows; their cells beyond the header must be empty."""

    def lines(wanted: Sequence[int]) -> list[Line]:
        for number, cells in rows:
            if len(cells) <= len(names):
                continue
            full = len(cells) - next((k for k, c in enumerate(reversed(cells)) if c != ""), 0)
            if full > len(names):
                split = full == 2 * len(names)
                guess = "; are its commas decimal? then separate by semicolons" * split
                problem = f"has {full} fields where the header has {len(names)}{guess}"
                raise RecordingError(problem, source, number, names[-1])
        # Fields missing from a short line are empty.
        return [
            (number, [cells[k] if k < len(cells) else "" for k in wanted]) for number, cells in rows
        ]

    return Sheet(source, names, header_row, lines, tuple(notes), repeats=tuple(repeats))
