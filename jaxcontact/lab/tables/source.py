"""The table in a file, an open text, a data frame, a mapping or arrays.

Spreadsheets (.xlsx, .ods) and parquet files are read by the libraries of the extra `data`.
"""

from __future__ import annotations

import dataclasses
import datetime
import functools
import importlib.resources
import io
import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from ...extend import as_array, read_whole, refusal, rendered, require_path
from ..sound.audio import is_sound, name_of
from .grid import Known, grid_of, known_cells, with_points
from .sheet import Line, RecordingError, Sheet, sheet_of_rows
from .text_file import decoded, text_grid

_SHIPPED_FILE = "bounce_intervals.csv"

_OTHER_KINDS = {
    b"\x1f\x8b": "compressed (gzip); unpack it first",
    b"%PDF": "a PDF; save the table as CSV",
    b"\x89PNG": "a picture; save the table as CSV",
    b"\xff\xd8\xff": "a picture; save the table as CSV",
}
"""First bytes of files that are not tables, with the advice to give."""


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
    path = isinstance(source, str | os.PathLike)
    # Classes of data frames and files have these attributes too.
    own = not isinstance(source, type)
    frame = own and hasattr(source, "columns") and hasattr(source, "__getitem__")
    readable = own and callable(getattr(source, "read", None))
    if sheet is not None and not (path or readable):
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
    if path:
        file = require_path("source", source)
        return from_file(lambda: read_whole(file), str(file))
    if isinstance(source, Mapping):
        return _from_columns("the dict", source)
    if frame:
        return _from_columns("the data frame", source)
    if readable:
        return from_file(source.read, name_of(source, "the text"))
    must = "be a path, an open file, a dict of columns, a data frame or None"
    raise refusal("source", must, source)


def _from_columns(source: str, columns: Any, *, by_keyword: bool = False) -> Sheet:
    """Return the columns of a mapping, or of a data frame."""
    keys = list(getattr(columns, "columns", columns))
    names = [str(key) for key in keys]

    def lines(wanted: Sequence[int]) -> list[Line]:
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
            return _from_columns(source, _parquet_columns(content, source))
        if content.startswith((b"PK\x03\x04", b"\xd0\xcf\x11\xe0")):
            return _workbook(content, source, known, decimal, sheet)
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
    return text_grid(content, source, known, decimal, [encoding] * bool(encoding))


_HOW = "pip install 'jaxcontact[data]', or save as CSV"


def _workbook(
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
    return value if type(value) in (int, float) else str(value)


def _parquet_columns(data: bytes, source: str) -> dict[str, Any]:
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
