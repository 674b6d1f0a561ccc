"""The times of a record, from its own column or its sampling rate."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..tables.fault import RecordingError
from ..tables.heading import Meaning, words
from ..tables.sheet import Row, Sheet
from .trace import Floats

CLOCK = Meaning(
    words("time, t, abs time, absolute time, elapsed time, time stamp, timestamp, x value"), "s"
)

_SLOWEST = 2e-3
"""Longest plausible step in s; contacts are shorter than eight of them."""

_UNEVEN = 0.5
"""Tolerance in steps for even times, which are written with few digits."""


def with_clock(sheet: Sheet, rate: float) -> Sheet:
    """Return the sheet with a column of times, for `rate` readings per second.

    Raises RecordingError for a sheet that has times, ValueError for a rate too low for impacts.
    """
    if rate * _SLOWEST <= 1:
        raise ValueError(
            f"Argument `rate` must be in Hz, above {1 / _SLOWEST:g} to see an impact, but is "
            f"{rate:g}; is it in kHz?"
        )
    own = next((text for text in sheet.names if CLOCK.heading(text)), None)
    if own is not None:
        raise sheet.fault("already gives the times; omit `rate`", own)
    return sheet.beside("time", lambda k, _: k / rate, f"{rate:g} readings per second")


def column_of(rows: Sequence[Row], name: str) -> Floats:
    """Return a column (n,) as numbers in SI units; raise RecordingError for the first fault."""
    heading = rows[0].headings.get(name)
    try:
        # Convert all at once; the row itself reports a single fault.
        found = np.array([row.values[name] for row in rows]).astype(float)
        if found.ndim != 1 or not np.isfinite(found).all():
            raise ValueError
    except (TypeError, ValueError, OverflowError):
        found = np.array([row.real(name) for row in rows])
        if (gone := np.isnan(found)).any():
            rows[int(np.argmax(gone))].refuse(name, "is empty")
        return found
    unit = None if heading is None else heading.unit
    return found if unit is None or not unit.converts else found * unit.times / unit.by


def even(rows: Sequence[Row], time: Floats) -> tuple[Floats, tuple[str, ...]]:
    """Return times (n,) in s with even steps, and notes on what was done to them.

    Raises RecordingError for times that do not grow, have gaps or seem to be in another unit.
    """
    if time.size < 2:
        raise RecordingError("holds one reading only", rows[0].source, rows[0].number)
    steps = np.diff(time)
    step = float(np.median(steps)) if np.median(steps) > 0 else float(np.mean(steps))
    if step >= _SLOWEST and not rows[0].has_unit("time"):
        unit = "ms" if step < 1 else "µs"
        rows[0].refuse(
            "time",
            f"grows by {step:g} from reading to reading, in s too slow for an impact; is it in "
            f"{unit}? write the unit in the heading, 'time [{unit}]', or 'time [s]' if it is right",
        )
    mean = float(time[-1] - time[0]) / (time.size - 1)
    grid = time[0] + mean * np.arange(time.size)
    if mean > 0 and np.max(np.abs(time - grid)) <= _UNEVEN * mean:
        same = np.allclose(time, grid, rtol=0, atol=1e-3 * mean)
        return grid, () if same else ("times taken as even, since they are rounded",)
    bad = int(np.argmin(steps)) + 1
    if steps[bad - 1] <= 0:
        rows[bad].refuse(
            "time",
            f"{time[bad]:g} s is not later than {time[bad - 1]:g} s; are times written with too "
            "few digits? omit the column and give the readings per second as `rate`",
        )
    bad = int(np.argmax(steps)) + 1
    if steps[bad - 1] > 2 * step:
        rows[bad].refuse(
            "time", f"{steps[bad - 1]:g} s after the reading before, where others take {step:g} s"
        )
    rows[0].refuse("time", "does not grow by even steps; a record is sampled at one rate")
