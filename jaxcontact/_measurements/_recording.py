"""Recordings of one bouncing ball, read from anything that has named columns."""

from __future__ import annotations

import collections
import dataclasses
import os
from collections.abc import Mapping
from typing import Any, TextIO

from .._parameter import rendered, require_choice
from ._layout import LAYOUTS, Layout, Record
from ._sheet import Sheet, sheet_of

_SHIPPED_BALL = "blue"


@dataclasses.dataclass(frozen=True, repr=False)
class Recording:
    """The measurements of one ball.

    `source` names where they come from, `layout` is their column layout (see `read_recording`),
    `ball` the name of the ball ("" where there is none), `records` the measurements in order.
    """

    source: str
    layout: Layout[Any]
    ball: str
    records: tuple[Record, ...]

    def __len__(self) -> int:
        return len(self.records)

    def __repr__(self) -> str:
        facts = {
            "source": self.source,
            "layout": self.layout.name,
            "ball": self.ball or "(no name)",
            "rows": str(len(self)),
            **self.layout.facts(self.records),
        }
        return "Recording\n" + "\n".join(f"  {name:<13}{fact}" for name, fact in facts.items())


def read_recording(
    source: str | os.PathLike[str] | TextIO | Mapping[str, Any] | Any = None,
    *,
    layout: str | None = None,
    ball: Any = None,
    **columns: Any,
) -> Recording:
    """Read the recording of one bouncing ball from a CSV file, a data frame, or arrays.

    The `layout` follows from the columns, unless it is named:

    - "intervals": `ball`, `drop_height_m`, `trial`, `bounce`, `interval_s`, the time in s between
      impacts `bounce` and `bounce` + 1 of a trial;
    - "heights": `ball`, `drop_height_m`, `trial`, `rebound_height_m`, a drop and its first rebound
      in m;
    - "table": `velocity`, the approach speed in m/s, `restitution`, and optionally `ball`.

    `source` is the path of a CSV file with a header, an open text file, a dict of columns, or a
    data frame (of pandas, polars, or anything with `.columns` and `[name]`); other columns are
    ignored. None reads the bounce intervals that ship with the package. Without `source`, columns
    may be given by keyword: `read_recording(interval_s=[0.42, 0.37, 0.33])`. Only then `ball`,
    `trial`, `bounce`, and for intervals `drop_height_m`, may be left out, which means one ball and
    one trial whose bounces are counted in order.

    `ball` chooses a ball by its name, which is necessary where there are several (from the shipped
    data, "blue" is chosen). A sequence of names is the column `ball`, given by keyword.

    Returns a `Recording`. Raises RecordingError, which names source, row and column, for a file
    that cannot be read, a column that is missing, repeated, not one-dimensional or of another
    length, a row with too many fields, a number that is missing, text, not finite or not positive,
    a repeated bounce, and a ball that does not exist or has to be chosen. Rows of a file are its
    lines, the header included; in columns of values they count from 1. Raises ValueError for other
    arguments, unknown columns among the keywords included.
    """
    if layout is not None:
        require_choice("layout", layout, LAYOUTS)
    if ball is not None and not isinstance(ball, str):
        if source is not None or not columns:
            raise ValueError(
                "Argument `ball` must be the name of one ball in `source`, or a column of names "
                f"beside other columns given by keyword, but is {rendered(ball)}."
            )
        columns, ball = {"ball": ball, **columns}, None
    known = dict.fromkeys(c for one in LAYOUTS.values() for c in (*one.columns, *one.optional))
    for name in columns:
        if name not in known:
            raise ValueError(f"Argument `{name}` is no known column; these are {', '.join(known)}.")
    sheet = sheet_of(source, columns)
    meant = _layout_of(sheet, layout)
    rows = sheet.rows((*meant.columns, *meant.optional))
    if not rows:
        what = "columns" if sheet.header_row is None else "a header"
        raise sheet.fault(f"holds {what} but no measurement", meant.columns[-1])
    records = meant.read(rows)
    balls = dict.fromkeys(record.ball for record in records)
    named = ", ".join(filter(None, balls))
    if ball is None and source is None and not columns:
        ball = _SHIPPED_BALL
    elif ball is None:
        ball, *others = balls
        if others:
            # By keyword, `ball` is the column.
            how = "give the columns as a dict and " if sheet.by_keyword else ""
            problem = f"holds several balls ({named}); {how}choose one with `ball=`, as in {ball=}"
            row = next(record.row for record in records if record.ball == others[0])
            raise sheet.fault(problem, "ball", row)
    if ball not in balls:
        raise sheet.fault(f"has no ball {ball!r}; it holds {named or 'no named ball'}", "ball")
    mine = tuple(record for record in records if record.ball == ball)
    return Recording(sheet.source, meant, ball, mine)


def _layout_of(sheet: Sheet, name: str | None) -> Layout[Any]:
    """The layout called `name`, or the one that the columns fit best; its columns are there."""
    names, layouts = sheet.names, LAYOUTS.values()
    for column in names:
        if column and names.count(column) > 1:
            raise sheet.fault("is there twice in the header", column)
    owners = collections.Counter(column for one in layouts for column in one.columns)
    if name is None and owners.keys().isdisjoint(names):
        choices = "; ".join(", ".join(one.columns) for one in layouts)
        first = (names[0] or "1") if names else None
        raise sheet.fault(f"no known column; one of these sets is needed: {choices}", first)

    def missing(layout: Layout[Any]) -> list[str]:
        needed = layout.measured if sheet.by_keyword else layout.columns
        return [column for column in needed if column not in names]

    def misfit(layout: Layout[Any]) -> tuple[bool, int, int]:
        has_own = any(column in names and owners[column] == 1 for column in layout.columns)
        return not has_own, len(missing(layout)), len(set(layout.columns).difference(names))

    # The layout that lacks least, of those with a column that no other layout has, is meant. What
    # it lacks is then named, rather than all columns of all layouts.
    meant = min(layouts, key=misfit) if name is None else LAYOUTS[name]
    for column in missing(meant):
        needed = ", ".join(meant.measured if sheet.by_keyword else meant.columns)
        raise sheet.fault(
            f"is missing; the layout {meant.name!r} needs the columns {needed}", column
        )
    return meant
