"""Spreadsheets (.xlsx, .ods) and parquet files, by the libraries of the extra `data`."""

from __future__ import annotations

import datetime
import io
from typing import Any

from .fault import RecordingError
from .grid import Grid, Known, Line, grid_of, known_cells, with_points

_HOW = "pip install 'jaxcontact[data]', or save as CSV"


def workbook_grid(data: bytes, source: str, known: Known, decimal: str | None = None) -> Grid:
    """Return the sheet with most known headings, or else the first that is not empty.

    Rows are numbered as in the spreadsheet. Raises RecordingError for a file that cannot be read.
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
    name = max(filled, key=lambda n: max(known_cells(cells, known) for _, cells in filled[n]))
    rows, commas = with_points(filled[name], source, decimal, apart=False)
    notes = [f"sheet {name!r}"] * (len(filled) > 1) + ["with decimal commas"] * commas
    return grid_of(rows, known, notes)


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
