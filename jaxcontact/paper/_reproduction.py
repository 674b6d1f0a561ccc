"""The result of the figure functions of this room."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .._text.table import text_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Table = dict[str, np.ndarray]
"""Named columns of equal length; names end in their SI unit if they have one: `time_s`."""


def long_table(columns: Mapping[str, ArrayLike]) -> Table:
    """Return a table of columns that broadcast: one row per element, the last axis fastest."""
    arrays = np.broadcast_arrays(*map(np.asarray, columns.values()))
    return dict(zip(columns, map(np.ravel, arrays), strict=True))


class Reproduction(NamedTuple):
    """A figure, and its numbers as named tables, which the command writes as CSV."""

    figure: Figure
    tables: dict[str, Table]

    def __repr__(self) -> str:
        lines = [
            [name, f"{len(next(iter(table.values())))} rows", ", ".join(table)]
            for name, table in self.tables.items()
        ]
        header = ["tables", "", "columns"]
        return "\n".join(["Reproduction", *text_table(lines, header=header, align="<><", indent=2)])
