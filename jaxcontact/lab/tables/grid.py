"""The cells of a table before its columns have a meaning, and the error of a recording."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from ...extend import written_unit


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


Known = Callable[[str], bool]
"""Test whether a text may be the heading of a column."""

Line = tuple[int, list[Any]]
"""The number of a row in its file, and its cells: texts, numbers, None."""

_NUMBER = re.compile(
    r"[+-]?(\d+[.,]?\d*|[.,]\d+)(e[+-]?\d+)?|\d+(:\d{1,2}){1,2}([.,]\d+)?", re.IGNORECASE
)
_COMMA = re.compile(r"[+-]?\d*,\d+(e[+-]?\d+)?", re.IGNORECASE)
_POINT = re.compile(r"[+-]?\d*\.\d+(e[+-]?\d+)?", re.IGNORECASE)
_THOUSANDS = {
    ",": re.compile(r"[+-]?\d{1,3}(\.\d{3})+(,\d*)?"),
    ".": re.compile(r"[+-]?\d{1,3}(,\d{3})+(\.\d*)?"),
}
_EITHER = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")
"""1,234 may be 1.234 or 1234."""

_SUMMARIES = frozenset(
    "mean,average,avg,median,sd,std,std dev,stdev,stddev,standard deviation,sem,standard error,"
    "variance,var,min,max,minimum,maximum,sum,total,count,mittelwert,mittel,standardabweichung,"
    "summe,moyenne,écart type,media,promedio,σ,μ".split(",")
)
"""Words that begin summary rows below a table."""

_LONGEST = 12
"""Largest length of a unit."""

_OTHER_UNITS = frozenset(
    "Nm,N·m,N m,N*m,N-m,V,mV,Hz,kHz,kg,deg,°,°C,rad,rad/s,°/s,Pa,kPa,MPa,bar,J,W,dB,a.u.".split(",")
)
"""Units of columns that are not read."""


@dataclasses.dataclass(frozen=True)
class Grid:
    """The headings of a table and its rows; `header_row` is None if no row is a heading.

    `notes` say how the file was read, if not in the plainest way. `repeats` are the rows that
    repeat the headings. `sheets` are the sheets of a spreadsheet that were read.
    """

    names: list[str]
    header_row: int | None
    rows: list[Line]
    notes: tuple[str, ...] = ()
    repeats: tuple[int, ...] = ()
    sheets: tuple[str, ...] = ()


def is_number(cell: Any) -> bool:
    """Return whether a cell holds a number with decimal point or comma, or a time as mm:ss.cc."""
    return _NUMBER.fullmatch(cell) is not None if isinstance(cell, str) else cell is not None


def known_cells(cells: Sequence[Any], known: Known) -> int:
    """Return how many cells of a row may be headings; 0 for a row with numbers.

    A unit is not a heading: N is the newton, not the number of a bounce.
    """
    if is_number(cells[0]) and cells[0] != "":
        return 0  # the usual row
    if any(is_number(cell) for cell in cells if cell != ""):
        return 0
    return sum(bool(cell) and known(cell) and written_unit(str(cell)) is None for cell in cells)


def grid_of(rows: list[Line], known: Known, notes: Sequence[str] = ()) -> Grid:
    """Split the rows of a file into headings and measurements.

    The heading is the row with most known words. Without any, it is the row above the first
    numbers, if that holds more than units. A table that begins with numbers has no heading. Rows
    above the heading are left out, and an adjacent row of units is merged into it. Repeated
    headings below, and means and similar rows at the end, are left out.
    """
    at = _heading(rows, known)
    width = max((len(cells) for _, cells in rows), default=0)
    number, names, first, below = None, [""] * width, 0, rows
    if at is not None:
        number, names = rows[at][0], _texts(rows[at][1])
        first, below = at, rows[at + 1 :]
    if below and _are_units(below[0][1]):
        names, below = _with_units(names, below[0][1]), below[1:]
    elif first and _are_units(rows[first - 1][1]):
        first -= 1
        names = _with_units(names, rows[first][1])
    if at is None:
        return Grid(names, None, below, tuple(notes))
    notes = [*notes, *_left_out_notes(rows[:first], "above the headings")]
    below, repeats = _without_repeats(below, rows[at][1])
    if repeats:
        shown = ", ".join(map(str, repeats[:6])) + ", ..." * (len(repeats) > 6)
        notes.append(f"headings repeated in row{'s' * (len(repeats) > 1)} {shown} left out")
    end = len(below)
    while end > 1 and _is_summary(below[end - 1][1], len(names)):
        end -= 1
    notes += _left_out_notes(below[end:], "below the measurements")
    return Grid(names, number, below[:end], tuple(notes), repeats)


def _without_repeats(
    below: list[Line], heading: Sequence[Any]
) -> tuple[list[Line], tuple[int, ...]]:
    """Return the rows that do not repeat the heading, and the numbers of those that do."""
    texts, start = _texts(heading), heading[:1]
    repeats = [
        k for k, (_, cells) in enumerate(below) if cells[:1] == start and _texts(cells) == texts
    ]
    # A row of units may follow each of them.
    gone = {*repeats, *(k + 1 for k in repeats if _are_units(_cells(below, k + 1)))}
    rest = [row for k, row in enumerate(below) if k not in gone]
    return rest, tuple(below[k][0] for k in repeats)


def _left_out_notes(rows: Sequence[Line], where: str) -> list[str]:
    """Return the note on rows that are not read."""
    if not rows:
        return []
    several = f"rows {rows[0][0]} to {rows[-1][0]}" if len(rows) > 1 else f"row {rows[0][0]}"
    return [f"{several} {where} left out"]


def _cells(rows: Sequence[Line], k: int) -> Sequence[Any]:
    return rows[k][1] if k < len(rows) else ()


def _texts(cells: Sequence[Any]) -> list[str]:
    """Return the texts of a row, without empty cells at its end."""
    texts = ["" if cell is None else str(cell).strip() for cell in cells]
    while texts and not texts[-1]:
        texts.pop()
    return texts


def _is_summary(cells: Sequence[Any], width: int) -> bool:
    """Return whether a row at the end is not a measurement: a mean or similar, or a remark."""
    texts = _texts(cells)
    words = [text for text in texts if text]
    if not words or is_number(words[0]):
        return False
    plain = re.sub(r"[\s_:\-]+", " ", words[0].casefold().replace(".", "")).strip()
    return plain in _SUMMARIES or (len(texts) == 1 < width)


def _with_units(names: Sequence[str], units: Sequence[Any]) -> list[str]:
    """Return the headings with the units of a separate row, unless they have them."""
    found = []
    for k, name in enumerate(names):
        unit = "" if k >= len(units) or units[k] is None else str(units[k]).strip().strip("[](){}")
        has = name.endswith(tuple(f"{a}{unit}{b}" for a, b in ("[]", "()", "{}"))) and unit
        found.append(name if has or not unit else f"{name} [{unit}]".strip())
    return found


def _heading(rows: list[Line], known: Known) -> int | None:
    scores = [known_cells(cells, known) for _, cells in rows]
    if any(scores):
        return scores.index(max(scores))
    numeric = (k for k, (_, cells) in enumerate(rows) if any(map(is_number, filter(None, cells))))
    first = next(numeric, len(rows))
    above = first - 1 if first < len(rows) else 0
    if above > 0 and _are_units(rows[above][1]):
        above -= 1
    return None if above < 0 or _are_units(rows[above][1]) else above


def _are_units(cells: Sequence[Any]) -> bool:
    """Return whether a row holds only units, most of them known: "s; N; N m"."""
    texts = [cell for cell in cells if cell not in ("", None)]
    if not texts or not all(isinstance(cell, str) and len(cell) < _LONGEST for cell in texts):
        return False
    others = [cell for cell in texts if written_unit(cell) is None]
    unknown = sum(cell.strip("[](){} ") not in _OTHER_UNITS for cell in others)
    numbers = sum(map(is_number, texts))
    if len(others) == len(texts) or any(map(is_number, others)):
        return False
    if numbers:  # 1 is the unit of a dimensionless column
        return not others and numbers < len(texts)
    return 2 * unknown < len(texts)


class _Marks(NamedTuple):
    """Marks in the numbers of a table, each with the row and text that shows it first.

    `sure`: whether some comma can only be decimal. `written`: whether any text has a comma.
    `simple`: whether every text with a comma is a number with that comma alone.
    """

    comma: tuple[int, str] | None
    point: tuple[int, str] | None
    sure: bool
    written: bool
    simple: bool


def _marks(rows: list[Line]) -> _Marks:
    comma: tuple[int, str] | None = None
    point: tuple[int, str] | None = None
    sure = written = False
    simple = True
    for k, cells in rows:
        for c in cells:
            if not isinstance(c, str):
                continue
            if "," not in c:
                if point is None and "." in c and _POINT.fullmatch(c):
                    point = k, c
                continue
            written = True
            # Shortcut for the usual number, without the cost of patterns.
            if sure and c.lstrip("+-").replace(",", "", 1).isdecimal():
                continue
            if one := _COMMA.fullmatch(c) or _THOUSANDS[","].fullmatch(c):
                comma = comma or (k, c)
                sure = sure or not _EITHER.fullmatch(c)
            simple = simple and one is not None and "." not in c
            if point is None and "." in c and _THOUSANDS["."].fullmatch(c):
                point = k, c
    return _Marks(comma, point, sure, written, simple)


def _decimal_mark(found: _Marks, source: str, *, apart: bool) -> str:
    """Return the decimal mark. Raise RecordingError if it is ambiguous."""
    comma, point = found.comma, found.point
    if comma and point and not apart:
        problem = (
            f"{point[1]!r} has a decimal point, and {comma[1]!r} in row {comma[0]} a decimal "
            'comma or a mark of thousands; say which with `decimal=","` or `decimal="."`'
        )
        raise RecordingError(problem, source, point[0])
    if comma and not found.sure and not apart:
        row, text = comma
        problem = (
            f"{text!r} may be {text.replace(',', '.')} or {text.replace(',', '')}; say which "
            'with `decimal=","` or `decimal="."`'
        )
        raise RecordingError(problem, source, row)
    return "," if comma else "."


def _with_point(cell: Any, mark: str) -> Any:
    """Return a cell with a decimal point, if it is a number with the given mark."""
    if not isinstance(cell, str) or "," not in cell:
        # 1.234 with decimal commas is 1234.
        dotted = mark == "," and isinstance(cell, str) and "." in cell
        return cell.replace(".", "") if dotted and _THOUSANDS[","].fullmatch(cell) else cell
    if mark == ".":
        return cell.replace(",", "") if _THOUSANDS["."].fullmatch(cell) else cell
    if _COMMA.fullmatch(cell):
        return cell.replace(",", ".")
    if _THOUSANDS[","].fullmatch(cell):
        return cell.replace(".", "").replace(",", ".")
    return cell


def with_points(
    rows: list[Line], source: str, decimal: str | None, *, apart: bool
) -> tuple[list[Line], bool]:
    """Return the rows with decimal points in their numbers, and whether they had decimal commas.

    `decimal` is the mark given by the user, if any. `apart` is True if commas separate columns, so
    that no number contains one. Raises RecordingError if the marks are ambiguous.
    """
    found = _marks(rows)
    mark = _decimal_mark(found, source, apart=apart) if decimal is None else decimal
    if not found.written:
        return rows, False
    if found.simple and mark == "," and found.point is None:
        # The usual case, in a third of the time.
        return [
            (k, [c.replace(",", ".") if isinstance(c, str) else c for c in cells])
            for k, cells in rows
        ], True
    return [(k, [_with_point(cell, mark) for cell in cells]) for k, cells in rows], mark == ","
