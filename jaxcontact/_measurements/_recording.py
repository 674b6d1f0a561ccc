"""Recordings of one bouncing ball, read from anything that has named columns."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping, Sequence
from typing import Any, TextIO

from ._layout import LAYOUTS, Layout, Record
from ._rows import RecordingError
from ._sources import Sheet, sheet_of

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

    The columns tell the `layout`, unless it is named:

    - "intervals": `ball`, `drop_height_m`, `trial`, `bounce`, `interval_s`, the time in s between
      impacts `bounce` and `bounce` + 1 of a trial;
    - "heights": `ball`, `drop_height_m`, `trial`, `rebound_height_m`, a drop and its first rebound
      in m;
    - "table": `velocity`, the approach speed in m/s, `restitution`, and optionally `ball`.

    `source` is a path of a CSV file with a header, an open text file, a dict of columns, or a data
    frame (of pandas, polars, or whatever has `.columns` and `[name]`); columns of other names are
    ignored. None reads the bounce intervals that ship with the package. Without `source`, columns
    may be given by keyword: `read_recording(interval_s=[0.42, 0.37, 0.33])`. Only then `ball`,
    `trial`, `bounce`, and for intervals `drop_height_m`, may be left out: that is one ball and one
    trial whose bounces are counted in order.

    `ball` chooses a ball by its name, which is necessary where there are several (from the shipped
    data, "blue" is chosen). A sequence of names is the column `ball`.

    Returns a `Recording`. Raises RecordingError, which names source, row and column, for a file
    that cannot be read, a column that is missing, there twice, not one-dimensional or of another
    length, a row with too many fields, a number that is missing, text, not finite or not positive,
    a bounce that is there twice, and a ball that is not there or has to be chosen. Rows of a file
    are its lines, the header included; in columns of values they count from 1. Raises ValueError
    for other arguments, unknown columns among the keywords included.
    """
    if layout is not None and layout not in LAYOUTS:
        choices = ", ".join(map(repr, LAYOUTS))
        raise ValueError(f"Argument `layout` must be one of {choices}, but is {layout!r}.")
    by_keyword = bool(columns) or not (ball is None or isinstance(ball, str))
    if by_keyword and not (ball is None or isinstance(ball, str)):
        if source is not None:
            raise ValueError(
                f"Argument `ball` must be the name of one ball in `source`, but is {ball!r}."
            )
        columns, ball = {"ball": ball, **columns}, None
    known = dict.fromkeys(c for one in LAYOUTS.values() for c in (*one.columns, *one.optional))
    for name in columns:
        if name not in known:
            raise ValueError(f"Argument `{name}` is no known column; these are {', '.join(known)}.")
    sheet = sheet_of(source, columns)
    if source is None and not by_keyword and ball is None:
        ball = _SHIPPED_BALL
    meant = _layout_of(sheet, layout, by_keyword)
    rows = sheet.rows((*meant.columns, *meant.optional))
    if not rows:
        raise RecordingError(
            f"holds {'columns' if sheet.header_row is None else 'a header'} but no measurement",
            source=sheet.source,
            row=sheet.header_row,
            column=meant.columns[-1],
        )
    return _of_ball(meant.read(rows), ball, meant, sheet, by_keyword)


def _layout_of(sheet: Sheet, name: str | None, by_keyword: bool) -> Layout[Any]:
    names = sheet.names

    def refuse(problem: str, column: str | None) -> RecordingError:
        return RecordingError(problem, source=sheet.source, row=sheet.header_row, column=column)

    for column in names:
        if column and names.count(column) > 1:
            raise refuse("is there twice in the header", column)
    if name is None and not any(c in names for one in LAYOUTS.values() for c in one.columns):
        choices = "; ".join(", ".join(one.columns) for one in LAYOUTS.values())
        first = (names[0] or "1") if names else None
        raise refuse(f"no known column; one of these sets is needed: {choices}", first)
    meant = _meant(names, by_keyword) if name is None else LAYOUTS[name]
    needed = meant.measured if by_keyword else meant.columns
    for column in needed:
        if column not in names:
            raise refuse(f"is missing; {meant.name} need the columns {', '.join(needed)}", column)
    return meant


def _meant(names: Sequence[str], by_keyword: bool) -> Layout[Any]:
    """The layout that lacks least, of those with a column that no other layout has.

    What it lacks is then named, rather than all columns of all layouts.
    """
    layouts = list(LAYOUTS.values())

    def owns(layout: Layout[Any]) -> bool:
        others = {c for one in layouts if one is not layout for c in one.columns}
        return any(c in names and c not in others for c in layout.columns)

    def lacks(layout: Layout[Any]) -> tuple[int, int]:
        needed = layout.measured if by_keyword else layout.columns
        return sum(c not in names for c in needed), sum(c not in names for c in layout.columns)

    return min([one for one in layouts if owns(one)] or layouts, key=lacks)


def _of_ball(
    records: Sequence[Record],
    ball: str | None,
    layout: Layout[Any],
    sheet: Sheet,
    by_keyword: bool,
) -> Recording:
    balls = list(dict.fromkeys(record.ball for record in records))
    named = ", ".join(name for name in balls if name)
    if ball is None and len(balls) > 1:
        # By keyword, `ball` is the column.
        how = "give the columns as a dict and " if by_keyword else ""
        raise RecordingError(
            f"holds several balls ({named}); {how}choose one with `ball=`, as in ball={balls[0]!r}",
            source=sheet.source,
            row=next(record.row for record in records if record.ball != balls[0]),
            column="ball",
        )
    if ball is not None and ball not in balls:
        raise RecordingError(
            f"has no ball {ball!r}; it holds {named or 'no named ball'}",
            source=sheet.source,
            row=sheet.header_row,
            column="ball",
        )
    ball = balls[0] if ball is None else ball
    mine = tuple(record for record in records if record.ball == ball)
    return Recording(sheet.source, layout, ball, mine)
