"""Rows of named values, whatever they were read from, and their faults."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any, NoReturn


class RecordingError(ValueError):
    """A fault in a recording, with its `source`, `row` and `column` (None where it has none).

    `problem` is the message without the place. In a file `row` is the line, the header counted;
    in columns of values it counts measurements from 1.
    """

    def __init__(
        self, problem: str, *, source: str, row: int | None = None, column: str | None = None
    ):
        self.problem, self.source, self.row, self.column = problem, source, row, column
        place = [source]
        if row is not None:
            place.append(f"row {row}")
        if column is not None:
            place.append(f"column {column}")
        super().__init__(f"{', '.join(place)}: {problem}")


@dataclasses.dataclass(frozen=True)
class Row:
    """The values of one measurement by column; texts, numbers, or None for what is missing."""

    source: str
    number: int
    values: Mapping[str, Any]

    def refuse(self, column: str, problem: str) -> NoReturn:
        """Raise RecordingError with the place of this row."""
        raise RecordingError(problem, source=self.source, row=self.number, column=column)

    def has(self, column: str) -> bool:
        """Whether the recording has this column."""
        return column in self.values

    def text(self, column: str, default: str | None = None) -> str:
        """The value as text; `default` where the recording has no such column."""
        if default is not None and not self.has(column):
            return default
        value = self.values[column]
        # 1.0 names the same trial as 1.
        whole = isinstance(value, float) and value.is_integer()
        text = str(int(value) if whole else value).strip()
        # NaN, None and pandas' <NA> stand for what is missing; a text "nan" is a bad number.
        if value is None or text in ("", "<NA>") or value != value:
            self.refuse(column, "is empty")
        return text

    def positive(self, column: str) -> float:
        """The value as a positive, finite number, with all its bits."""
        text, number = self._number(column)
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

    def _number(self, column: str, kind: str = "a number") -> tuple[str, float]:
        text = self.text(column)
        try:
            return text, float(self.values[column])
        except (TypeError, ValueError):
            self.refuse(column, f"{text!r} is not {kind}")
