"""Text in columns, and wrapped text."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Sequence


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


def markdown_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Return the lines of a table in Markdown."""
    lines = [
        "|" + "".join(f" {cell} |" if cell else " |" for cell in row) for row in (header, *rows)
    ]
    return [lines[0], "|" + "---|" * len(header), *lines[1:]]


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
