"""Words for counts, lists and ranges, and text in columns."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Sequence

Words = tuple[str, str]
"""A noun phrase in the singular and in the plural."""


def counted(count: int, words: Words) -> str:
    """Return a count with its noun: `1 trial`, `2 trials`, `0 trials`."""
    return f"{count} {words[count != 1]}"


def listed(names: Sequence[str]) -> str:
    """Return names as `a, b and c`."""
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))


def span(values: Sequence[float], unit: str = "") -> str:
    """Return the range of values: `0.1 to 0.3 m`, or `0.1 m` if all are equal."""
    low, high = f"{min(values):.3g}", f"{max(values):.3g}"
    return f"{low if low == high else f'{low} to {high}'} {unit}".rstrip()


_NAMED = 5
"""Largest number of bad points that a message names; the others are counted."""


def first_few(words: Sequence[str]) -> str:
    """Return the first few words, and how many more there are."""
    more = f" and {len(words) - _NAMED} more" if len(words) > _NAMED else ""
    return ", ".join(words[:_NAMED]) + more


def text_table(
    rows: Iterable[Sequence[str]],
    *,
    header: Sequence[str] = (),
    align: str = "",
    indent: int = 0,
    gap: int = 2,
    rule: bool = False,
) -> list[str]:
    """Return the lines of a table whose columns are as wide as their widest cell.

    `align` holds "<" or ">" for each column in order, "<" beyond its end. `indent` is the number of
    spaces before the first column, and `gap` that between columns. `rule` draws a line below the
    `header`. A row may have fewer cells than there are columns.
    """
    cells = [list(header)] * bool(header) + [list(row) for row in rows]
    columns = max(map(len, cells), default=0)
    sides = align.ljust(columns, "<")
    widths = [max(len(row[k]) for row in cells if k < len(row)) for k in range(columns)]
    lines = [
        " " * indent
        + (" " * gap).join(f"{cell:{sides[k]}{widths[k]}}" for k, cell in enumerate(row)).rstrip()
        for row in cells
    ]
    if header and rule:
        lines.insert(1, " " * indent + "-" * (max(map(len, lines)) - indent))
    return lines


def abridged(rows: Sequence[Sequence[str]], most: int = 13) -> list[Sequence[str]]:
    """Return the rows of a table; of more than `most`, the first ones and the last."""
    rows = list(rows)
    return rows if len(rows) <= most else [*rows[: most - 1], ["..."], rows[-1]]


def wrapped(
    head: str, text: str, *, width: int = 100, indent: int = 11, lead: str = ""
) -> list[str]:
    """Return lines of at most `width` characters: `lead`, `head`, `text` at column `indent`."""
    return textwrap.wrap(
        text,
        width,
        initial_indent=f"{lead + head:<{indent - 1}} ",
        subsequent_indent=" " * indent,
        break_long_words=False,
        break_on_hyphens=False,
    )


def with_error(value: float, error: float) -> str:
    """Return `0.8799 ± 0.0010`: the error with two digits, the value with as many places."""
    if not error > 0:
        return f"{value:.6g} ± 0"
    places = 1 - math.floor(math.log10(error))
    if 0 <= places <= 6 and abs(value) < 1e6:
        return f"{value:.{places}f} ± {error:.{places}f}"
    # As many digits of the value as the error warrants.
    size = math.floor(math.log10(abs(value))) if value else 0
    digits = max(size + places, 0)
    return f"{value:.{digits}e} ± {error:.1e}"
