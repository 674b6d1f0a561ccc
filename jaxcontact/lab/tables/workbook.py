"""Spreadsheets (.xlsx, .ods) and parquet files, by the libraries of the extra `data`."""

from __future__ import annotations

import dataclasses
import datetime
import io
from collections.abc import Sequence
from typing import Any

from .grid import Known, grid_of, known_cells, with_points
from .sheet import Line, RecordingError, Sheet, sheet_of_rows

_HOW = "pip install 'jaxcontact[data]', or save as CSV"


def workbook_grid(
    data: bytes, source: str, known: Known, decimal: str | None, sheet: str | int | None
) -> Sheet:
    """Return the table of a spreadsheet, with the name of the sheet in its source.

    It is the one called `sheet` (or numbered, from 1), otherwise the only one with at least half as
    many known headings as any. Several with equal headings are one table of parts, whose rows
    count on. Raises RecordingError for others, and for a file that cannot be read.
    """
    try:
        import python_calamine
    except ImportError as error:
        problem = f"is a spreadsheet, which needs python-calamine ({_HOW})"
        raise RecordingError(problem, source) from error
    try:
        book = python_calamine.load_workbook(io.BytesIO(data))
        sheets = {
            name: _lines(book.get_sheet_by_name(name).to_python(skip_empty_area=False))
            for name in book.sheet_names
        }
    except python_calamine.CalamineError as error:
        raise RecordingError(f"is a spreadsheet that cannot be read ({error})", source) from error
    filled = {name: rows for name, rows in sheets.items() if rows}
    if not filled:
        raise RecordingError("is empty; a header with the column names is needed", source, 1)
    names = list(filled)
    if sheet is not None:
        read = [_called(sheet, names, source)]
    else:
        score = {n: max(known_cells(cells, known) for _, cells in filled[n]) for n in names}
        # phyphox adds "Metadata Device" and "Metadata Time".
        tables = [n for n in names if not n.startswith("Metadata")] or names
        read = [n for n in tables if 2 * score[n] >= max(score[n] for n in tables)]
    grids: list[Sheet] = []
    for name in read:
        place = f"{source}, sheet {name!r}"
        rows, commas = with_points(filled[name], place, decimal, apart=False)
        own = source if len(names) == 1 else place
        grids.append(grid_of(rows, known, own, ["with decimal commas"] * commas))
    if any(grid.names != grids[0].names for grid in grids):
        told = "; ".join(f"{n!r} ({', '.join(g.names)})" for n, g in zip(read, grids, strict=True))
        problem = f"has sheets with different headings, {told}; choose one with `sheet=`"
        raise RecordingError(problem, source)
    grid = _joined(grids, read, source) if len(grids) > 1 else grids[0]
    left = _named([name for name in names if name not in read])
    notes = [f"sheet{'s' * (len(read) > 1)} {_named(read)}", *[f"not read: {left}"] * bool(left)]
    notes = [*notes * (len(names) > 1), *grid.notes]
    return dataclasses.replace(grid, sheets=tuple(read), notes=tuple(notes))


def _called(sheet: str | int, names: Sequence[str], source: str) -> str:
    """Return the name of the sheet of this name, or of this number."""
    number = int(sheet) - 1 if str(sheet).isdecimal() else -1
    if sheet in names:
        return str(sheet)
    if not 0 <= number < len(names):
        raise RecordingError(f"has no sheet {sheet!r}; it has {_named(names)}", source)
    return names[number]


def _named(names: Sequence[str]) -> str:
    return ", ".join(map(repr, names))


def _joined(sheets: Sequence[Sheet], names: Sequence[str], source: str) -> Sheet:
    """Return tables with equal headings as one of several parts."""
    rows: list[Line] = []
    repeats, told = [], []
    for name, sheet in zip(names, sheets, strict=True):
        ahead = rows[-1][0] if rows else 0
        if name != names[0]:
            repeats.append(ahead + 1)
            told.append(f"row 1 of {name!r} is row {ahead + 1}")
        repeats += [ahead + k for k in sheet.repeats]
        rows += [(ahead + k, cells) for k, cells in sheet.lines(range(len(sheet.names)))]
    one = sheets[0]
    notes = [*one.notes, *told]
    return sheet_of_rows(source, list(one.names), one.header_row, rows, notes, repeats)


def _lines(rows: list[list[Any]]) -> list[Line]:
    lines = [(k, [_cell(value) for value in row]) for k, row in enumerate(rows, 1)]
    return [(k, cells) for k, cells in lines if any(cell != "" for cell in cells)]


def _cell(value: Any) -> Any:
    if isinstance(value, str):
        return value.strip()
    # A duration is a number of seconds. A date is not a measurement; its text shows that.
    if isinstance(value, datetime.timedelta):
        return value.total_seconds()
    return value if isinstance(value, int | float) and not isinstance(value, bool) else str(value)


def parquet_columns(data: bytes, source: str) -> dict[str, Any]:
    """Return the columns of a parquet file by name; raise RecordingError if it cannot be read."""
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError as error:
        problem = f"is a parquet file, which needs pyarrow ({_HOW})"
        raise RecordingError(problem, source) from error
    try:
        table = pyarrow.parquet.read_table(pyarrow.BufferReader(data))
    except (pyarrow.ArrowException, OSError) as error:
        raise RecordingError(f"is a parquet file that cannot be read ({error})", source) from error
    return {name: table.column(k).to_pylist() for k, name in enumerate(table.column_names)}
