"""A sweep as text, one row per lane, a few thousand rows at a time."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Sequence

import numpy as np

from .._impact import Status
from .column import SweepColumn, within
from .table import SweepTable

_ROWS = 1 << 14
"""Rows that are converted to text at once."""

_REPEATED = 4
"""Numbers that occur in this many rows, on average, are converted once."""

Lanes = Sequence[np.ndarray]
"""The index of some lanes along each dimension."""


def rows_of(table: SweepTable) -> Iterator[str]:
    """Yield the header of the table, then its rows."""
    along = table.dims_of_axes()
    columns = [
        (name, SweepColumn((table.dims.index(along[name]),), values))
        for name, values in table.axes.items()
    ]
    columns += (table.columns() | {"status": table.status_column}).items()
    head = io.StringIO()
    csv.writer(head, lineterminator="\n").writerow(
        name + (f"[{','.join(map(str, place))}]" if place else "")
        for name, column in columns
        for place in np.ndindex(column.own_shape)
    )
    yield head.getvalue()
    cells = [_Cells(name, column, table.shape) for name, column in columns]
    lanes = math.prod(table.shape)
    for start in range(0, lanes, _ROWS):
        rows = np.arange(start, min(start + _ROWS, lanes))
        where = np.unravel_index(rows, table.shape) if table.shape else ()
        texts = [text for cell in cells for text in cell.texts(where, len(rows))]
        yield "\n".join(map(",".join, zip(*texts, strict=True))) + "\n"


class _Cells:
    """The texts of one column."""

    def __init__(self, name: str, column: SweepColumn, shape: Sequence[int]):
        self.status, self.column = name == "status", column
        self.otherwise = self._made(np.asarray(column.otherwise)) if column.masks else np.array("")
        repeated = _REPEATED * math.prod(column.stored.shape) <= math.prod(shape)
        self.ready = self._made(column.values) if repeated else None

    def texts(self, lanes: Lanes, count: int) -> Iterator[list[str]]:
        """Return the texts in some lanes, one list for each of the column's numbers per lane."""
        if self.ready is not None:
            texts = self.ready[_place(self.column, lanes)]
        else:
            texts = self._made(_read(self.column, lanes))
        texts = np.broadcast_to(texts, (count, *self.column.own_shape))
        keep = np.ones(count, bool)
        for mask in self.column.masks:
            keep &= _read(mask, lanes)
        if not keep.all():
            keep = within(keep, (0,), range(texts.ndim))
            texts = np.where(keep, texts, self.otherwise)
        texts = texts.reshape(count, -1)
        return (texts[:, k].tolist() for k in range(texts.shape[1]))

    def _made(self, values: np.ndarray) -> np.ndarray:
        """Convert each number to the shortest text that restores it in its own precision."""
        plain = values.reshape(-1)
        if self.status and set(np.unique(plain)) <= set(Status):
            texts = [Status(code).name for code in plain.tolist()]
        elif plain.dtype in (np.float64, np.int64, np.int32, bool):
            texts = list(map(repr, plain.tolist()))
        else:
            texts = plain.astype(str).tolist()
        return np.array(texts, object).reshape(values.shape)


def _place(column: SweepColumn, lanes: Lanes) -> tuple[np.ndarray, ...]:
    return tuple(lanes[d] for d in column.dims)


def _read(column: SweepColumn, lanes: Lanes) -> np.ndarray:
    """Return the stored numbers in some lanes; from disk, read only the part that holds them."""
    if not column.dims:
        return column.values
    first, *others = _place(column, lanes)
    low, high = int(first.min()), int(first.max())
    return np.asarray(column.stored[low : high + 1])[(first - low, *others)]
