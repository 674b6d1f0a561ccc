"""Tables from rows of cells: which row is the heading, which belong to it, and decimal marks."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import Any

from ...extend import written_unit
from .sheet import Line, RecordingError, Sheet, sheet_of_rows

Known = Callable[[str], bool]
"""Test whether a text may be the heading of a column."""

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


def is_number(cell: Any) -> bool:
    """Return whether a cell holds a number with decimal point or comma, or a time as mm:ss.cc."""
    return _NUMBER.fullmatch(cell) is not None if isinstance(cell, str) else cell is not None


def known_cells(cells: Sequence[Any], known: Known) -> int:
    """Return how many cells of a row may be headings; 0 for a row with numbers.

    A unit is not a heading: N is the newton, not the number of a bounce.
    """
    # The first cell of the usual row is a number.
    if any(is_number(cell) for cell in cells if cell != ""):
        return 0
    return sum(bool(cell) and known(cell) and written_unit(str(cell)) is None for cell in cells)


def grid_of(rows: list[Line], known: Known, source: str, notes: Sequence[str] = ()) -> Sheet:
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
        return sheet_of_rows(source, names, None, below, notes)
    notes = [*notes, *_left_out_notes(rows[:first], "above the headings")]
    start, heading = rows[at][1][:1], _texts(rows[at][1])
    repeats = [k for k, (_, c) in enumerate(below) if c[:1] == start and _texts(c) == heading]
    if repeats:
        # A row of units may follow each of them.
        units = {k + 1 for k in repeats if k + 1 < len(below) and _are_units(below[k + 1][1])}
        lines = [below[k][0] for k in repeats]
        below = [row for k, row in enumerate(below) if k not in {*repeats, *units}]
        shown = ", ".join(map(str, lines[:6])) + ", ..." * (len(lines) > 6)
        notes.append(f"headings repeated in row{'s' * (len(lines) > 1)} {shown} left out")
        repeats = lines
    end = len(below)
    while end > 1 and _is_summary(below[end - 1][1], len(names)):
        end -= 1
    notes += _left_out_notes(below[end:], "below the measurements")
    return sheet_of_rows(source, names, number, below[:end], notes, repeats)


def _left_out_notes(rows: Sequence[Line], where: str) -> list[str]:
    """Return the note on rows that are not read."""
    if not rows:
        return []
    several = f"rows {rows[0][0]} to {rows[-1][0]}" if len(rows) > 1 else f"row {rows[0][0]}"
    return [f"{several} {where} left out"]


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
    above = next(numeric, 1) - 1
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


def _decimal_mark(rows: list[Line], source: str, *, apart: bool) -> str:
    """Return the decimal mark; raise RecordingError if it is ambiguous."""
    comma: tuple[int, str] | None = None
    point: tuple[int, str] | None = None
    sure = False  # whether some comma can only be decimal
    for k, cells in rows:
        for c in cells:
            if not isinstance(c, str):
                continue
            if "," in c and not sure and (_COMMA.fullmatch(c) or _THOUSANDS[","].fullmatch(c)):
                comma, sure = comma or (k, c), not _EITHER.fullmatch(c)
            pattern = _THOUSANDS["."] if "," in c else _POINT
            if "." in c and point is None and pattern.fullmatch(c):
                point = k, c
    if comma and point and not apart:
        problem = (
            f"{point[1]!r} has a decimal point, and {comma[1]!r} in row {comma[0]} a decimal "
            'comma or a mark of thousands; say which with `decimal=","` or `decimal="."`'
        )
        raise RecordingError(problem, source, point[0])
    if comma and not sure and not apart:
        row, text = comma
        problem = (
            f"{text!r} may be {text.replace(',', '.')} or {text.replace(',', '')}; say which "
            'with `decimal=","` or `decimal="."`'
        )
        raise RecordingError(problem, source, row)
    return "," if comma else "."


def _with_point(cell: Any, mark: str) -> Any:
    """Return a cell with a decimal point, if it is a number with the given mark."""
    if not isinstance(cell, str) or not ("," in cell or (mark == "," and "." in cell)):
        return cell
    if mark == "," and _COMMA.fullmatch(cell):
        return cell.replace(",", ".")
    if _THOUSANDS[mark].fullmatch(cell):  # 1.234 with decimal commas is 1234
        return cell.replace("." if mark == "," else ",", "").replace(",", ".")
    return cell


def with_points(
    rows: list[Line], source: str, decimal: str | None, *, apart: bool
) -> tuple[list[Line], bool]:
    """Return the rows with decimal points in their numbers, and whether they had decimal commas.

    `decimal` is the mark given by the user, if any. `apart` is True if commas separate columns, so
    that no number contains one. Raises RecordingError if the marks are ambiguous.
    """
    if not any(isinstance(cell, str) and "," in cell for _, cells in rows for cell in cells):
        return rows, False
    mark = _decimal_mark(rows, source, apart=apart) if decimal is None else decimal
    return [(k, [_with_point(cell, mark) for cell in cells]) for k, cells in rows], mark == ","
