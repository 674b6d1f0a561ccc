"""A table of cells as a file holds it, before its columns mean anything."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Sequence
from typing import Any

from .._units import written_unit
from ._fault import RecordingError

Known = Callable[[str], bool]
"""Whether a text may be the heading of a column."""

Line = tuple[int, list[Any]]
"""The number of a row in its file, and its cells: texts, numbers, None."""

_NUMBER = re.compile(r"[+-]?(\d+[.,]?\d*|[.,]\d+)(e[+-]?\d+)?", re.IGNORECASE)
_COMMA = re.compile(r"[+-]?\d*,\d+(e[+-]?\d+)?", re.IGNORECASE)
_POINT = re.compile(r"[+-]?\d*\.\d+(e[+-]?\d+)?", re.IGNORECASE)
_THOUSANDS = {
    ",": re.compile(r"[+-]?\d{1,3}(\.\d{3})+(,\d*)?"),
    ".": re.compile(r"[+-]?\d{1,3}(,\d{3})+(\.\d*)?"),
}
_EITHER = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")
"""1,234 may be 1.234 or 1234."""


@dataclasses.dataclass(frozen=True)
class Grid:
    """The headings of a table and its rows; `header_row` is None where no row is a heading.

    `notes` say in words how the file was read, where that is not the plainest way.
    """

    names: list[str]
    header_row: int | None
    rows: list[Line]
    notes: tuple[str, ...] = ()


def is_number(cell: Any) -> bool:
    """Whether a cell holds a number, with a decimal point or comma."""
    return _NUMBER.fullmatch(cell) is not None if isinstance(cell, str) else cell is not None


def known_cells(cells: Sequence[Any], known: Known) -> int:
    """How many cells of a row may be headings; 0 for a row with numbers."""
    if any(is_number(cell) for cell in cells if cell != ""):
        return 0
    return sum(bool(cell) and known(cell) for cell in cells)


def grid_of(rows: list[Line], known: Known, notes: Sequence[str] = ()) -> Grid:
    """The rows of a file as headings and measurements.

    The heading is the row with most known words; without any the row above the first numbers; none
    where the table begins with numbers. Rows above it are left out, and a row of units below it
    goes into the headings.
    """
    at = _heading(rows, known)
    if at is None:
        width = max((len(cells) for _, cells in rows), default=0)
        return Grid([""] * width, None, rows, tuple(notes))
    number, cells = rows[at]
    names = ["" if cell is None else str(cell).strip() for cell in cells]
    while names and not names[-1]:
        names.pop()
    below = rows[at + 1 :]
    if below and _are_units(below[0][1]):
        units = [*map(str, below[0][1]), *[""] * len(names)]
        names = [
            f"{name} [{unit.strip().strip('[](){}')}]" if unit else name
            for name, unit in zip(names, units, strict=False)
        ]
        below = below[1:]
    if at:
        told = f"rows {rows[0][0]} to {rows[at - 1][0]}" if at > 1 else f"row {rows[0][0]}"
        notes = (*notes, f"{told} above the headings left out")
    return Grid(names, number, below, tuple(notes))


def _heading(rows: list[Line], known: Known) -> int | None:
    scores = [known_cells(cells, known) for _, cells in rows]
    if any(scores):
        return scores.index(max(scores))
    numeric = (k for k, (_, cells) in enumerate(rows) if any(map(is_number, filter(None, cells))))
    first = next(numeric, len(rows))
    if first:
        return first - 1 if first < len(rows) else 0
    return None


def _are_units(cells: Sequence[Any]) -> bool:
    texts = [cell for cell in cells if cell not in ("", None)]
    units = [isinstance(cell, str) and written_unit(cell) is not None for cell in texts]
    return bool(texts) and all(units) and not all(map(is_number, texts))


def with_points(
    rows: list[Line], source: str, decimal: str | None, *, apart: bool
) -> tuple[list[Line], bool]:
    """The rows with decimal points in their numbers, and whether they had decimal commas.

    `decimal` is the mark that was named, if any; `apart`, whether commas separate columns, so that
    none is left in a number. Raises RecordingError where the marks cannot be told.
    """
    texts = [(k, c) for k, cells in rows for c in cells if isinstance(c, str) and "," in c]
    commas = [(k, c) for k, c in texts if _COMMA.fullmatch(c) or _THOUSANDS[","].fullmatch(c)]
    grouped = [(k, c) for k, c in texts if _THOUSANDS["."].fullmatch(c)]
    mark = decimal
    if mark is None:
        sure = [(k, c) for k, c in commas if not _EITHER.fullmatch(c)]
        points = [
            (k, c)
            for k, cells in rows
            for c in cells
            if isinstance(c, str) and (_POINT.fullmatch(c) or ((k, c) in grouped and "." in c))
        ]
        if commas and points and not apart:
            (k, comma), (row, point) = commas[0], points[0]
            problem = (
                f"{point!r} has a decimal point, and {comma!r} in row {k} a decimal comma or a "
                'mark of thousands; say which with `decimal=","` or `decimal="."`'
            )
            raise RecordingError(problem, source, row)
        if commas and not sure and not apart:
            row, text = commas[0]
            problem = (
                f"{text!r} may be {text.replace(',', '.')} or {text.replace(',', '')}; say which "
                'with `decimal=","` or `decimal="."`'
            )
            raise RecordingError(problem, source, row)
        mark = "," if commas else "."
    if not texts:
        return rows, False

    def plain(cell: Any) -> Any:
        if not isinstance(cell, str) or ("," not in cell and mark == "."):
            return cell
        if mark == "," and _THOUSANDS[","].fullmatch(cell):
            return cell.replace(".", "").replace(",", ".")
        if mark == "," and _COMMA.fullmatch(cell):
            return cell.replace(",", ".")
        return cell.replace(",", "") if mark == "." and _THOUSANDS["."].fullmatch(cell) else cell

    return [(k, [plain(cell) for cell in cells]) for k, cells in rows], mark == ","
