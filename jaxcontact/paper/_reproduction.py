"""What each figure function of this room returns."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .._text.table import text_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Table = dict[str, np.ndarray]
"""Named columns of equal length; a name ends in its SI unit where there is one: `time_s`."""


def long_table(columns: Mapping[str, ArrayLike]) -> Table:
    """A table of columns that broadcast: a row for each element, the last axis fastest."""
    arrays = np.broadcast_arrays(*map(np.asarray, columns.values()))
    return dict(zip(columns, map(np.ravel, arrays), strict=True))


class Reproduction(NamedTuple):
    """A figure, and the numbers behind it: tables by name, which the command writes as CSV."""

    figure: Figure
    tables: dict[str, Table]

    def __repr__(self) -> str:
        lines = [
            [name, f"{len(next(iter(table.values())))} rows", ", ".join(table)]
            for name, table in self.tables.items()
        ]
        header = ["tables", "", "columns"]
        return "\n".join(["Reproduction", *text_table(lines, header=header, align="<><", indent=2)])
