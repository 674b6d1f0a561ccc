"""Quantities that page and figures derive from the rows."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

Row = dict[str, Any]
FAMILIES = {
    "ours": "jaxcontact",
    "numba": "numba",
    "diffrax": "plain diffrax",
    "scipy": "SciPy",
    "engines": "another simulator",
}


QUIET = 3.0
"""A load average that leaves a core to a run, which makes 1 to 2 of it alone."""


def busy(row: Row) -> bool:
    """Whether the machine had other work while a row was measured."""
    return (row.get("load") or 0) > QUIET


def ways_of(rows: Iterable[Row]) -> list[str]:
    """Names of ways in the order they were measured in."""
    return list(dict.fromkeys(row["way"] for row in rows))


def problems_of(rows: Iterable[Row]) -> list[str]:
    return list(dict.fromkeys(row["problem"] for row in rows))


def batches_of(rows: Iterable[Row]) -> list[int]:
    return sorted({row["batch"] for row in rows})


def cheapest(rows: Iterable[Row], error: float) -> Row | None:
    """The fastest row within an error; None where no row is."""
    good = [row for row in rows if row.get("error", 1e9) <= error]
    return min(good, key=lambda row: row["cost"], default=None)


def closest(rows: Iterable[Row]) -> Row | None:
    """The row with the least error; None where no row has one."""
    return min((row for row in rows if "error" in row), key=lambda row: row["error"], default=None)


def some(rows: Iterable[Row], **wanted: Any) -> list[Row]:
    """The rows that have these values."""
    return [row for row in rows if all(row.get(k) == v for k, v in wanted.items())]


def number(x: float) -> str:
    """Two digits."""
    if x >= 100:
        return f"{round(x, -(len(str(int(x))) - 2)):,.0f}"
    return f"{x:.2g}"
