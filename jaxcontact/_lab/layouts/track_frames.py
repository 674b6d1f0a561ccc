"""The frames of a track: times, positions and unit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..tables.sheet import Row
from ..track import Frames

_MISSING = ("", "nan", "none", "na", "n/a", "null", "-")


class Clock(NamedTuple):
    """The `column` that gives the time of a frame, in steps of `step` s."""

    column: str
    step: float


def clock_of(rows: Sequence[Row], rate: float | None) -> Clock:
    """Return the clock of a track: frame numbers with a `rate`, otherwise times.

    A column of times that counts 0, 1, 2, ... numbers frames. Raises RecordingError for frame
    numbers without a rate, and for times with one.
    """
    there = rows[0].values
    if rate is None:
        if "time" not in there:
            rows[0].refuse("frame", "counts frames; give the frames per second as `rate`")
        if not rows[0].has_unit("time") and _is_count(rows, "time"):
            rows[0].refuse(
                "time",
                "counts 0, 1, 2, ...; are these frames? then give the frames per second as "
                "`rate`, or write the unit in the heading, 'time [s]'",
            )
        return Clock("time", 1.0)
    if "frame" in there:
        return Clock("frame", 1 / rate)
    if rows[0].has_unit("time") or not _is_count(rows, "time"):
        rows[0].refuse("time", f"gives times already; leave `rate` out, which is {rate:g}")
    return Clock("time", 1 / rate)


def _unit(rows: Sequence[Row]) -> str:
    """Return the unit of positions, "" if unwritten; raise RecordingError for two units."""
    there = [name for name in ("y", "x") if name in rows[0].headings]
    units = {name: unit.si if (unit := rows[0].headings[name].unit) else "" for name in there}
    if len(set(units.values())) > 1:
        told = " and ".join(f"{name} in {unit or 'no unit'}" for name, unit in units.items())
        rows[0].refuse("x", f"must have the unit of y, but the units are {told}")
    return units.get("y", "")


def frames_of(rows: Sequence[Row], clock: Clock) -> Frames:
    """Return the frames in which the ball was detected, in order."""
    along = "x" in rows[0].values
    found = []
    for row in rows:
        y = _place(row, "y")
        x = _place(row, "x") if along else 0.0
        if math.isnan(x + y):
            continue
        t = row.real(clock.column)
        if math.isnan(t):
            row.refuse(clock.column, "is empty")
        found.append((t * clock.step, x, y, row.number))
    found.sort()
    values = np.array(found).reshape(-1, 4)
    same = np.flatnonzero(np.diff(values[:, 0]) <= 0)
    if same.size:
        number = int(values[same[0] + 1, 3])
        row = next(one for one in rows if one.number == number)
        row.refuse(
            clock.column,
            f"has two positions at {row.text(clock.column)}; name several balls in a column "
            "`particle`, and choose one with `ball=`",
        )
    x = values[:, 1] if along else None
    return Frames(values[:, 0], values[:, 2], x, values[:, 3], unit=_unit(rows))


def _place(row: Row, column: str) -> float:
    """Return a position; NaN if the ball was not detected."""
    value = row.values[column]
    if value is None or value != value:
        return math.nan
    if isinstance(value, str) and value.strip().casefold() in _MISSING:
        return math.nan
    return row.real(column)


def _is_count(rows: Sequence[Row], column: str) -> bool:
    """Return whether a column counts 0, 1, 2, ..., possibly with gaps."""
    values = np.sort([row.real(column) for row in rows])
    whole = bool(np.all(values == np.round(values)))
    return whole and values.size > 1 and float(np.median(np.diff(np.unique(values)))) == 1
