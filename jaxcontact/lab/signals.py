"""Readings over time: their clock, even times, noise, and removal of mains hum."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import NamedTuple, NoReturn

import numpy as np
from jaxtyping import Float

from .tables.heading import Meaning
from .tables.sheet import RecordingError, Row, Sheet

Floats = Float[np.ndarray, " n"]

_SEGMENT, _SEGMENTS, _SHORTEST = 32, 12, 8
"""Readings of a segment for the noise estimate about a line; fewer in a short record."""

_QUIET = 0.3
"""Quantile of the scatter of segments from which the noise is estimated."""

_MAINS = 50.0, 60.0
_AROUND = 0.3
_PERIODS, _HARMONICS = 3, 3
_CLEAR = 40.0
"""Reduction of the sum of squares, in noise variances, for a significant mains line."""

_SLOW = 2000.0
"""Rate in Hz of the averaged readings in which the mains frequency is searched."""


class Doubtful(NamedTuple):
    """A contact that is not used: its time in s, and why."""

    time: float
    why: str


@dataclasses.dataclass(frozen=True, eq=False)
class Trace:
    """A record: `quantity` is "force", "acceleration" or "indentation", read at `time` (n,) in s.

    `value` (n,) in N, m/s² or m is without hum, with the sign for positive contacts. `level` (n,)
    is the reading without contact, and `noise` the standard deviation of one reading. `doubtful`
    are contacts that are not used, and `notes` list the processing steps.
    """

    quantity: str
    time: Floats
    value: Floats
    level: Floats
    noise: float
    doubtful: tuple[Doubtful, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def step(self) -> float:
        """The time in s between readings."""
        return float(self.time[-1] - self.time[0]) / (self.time.size - 1)


def noise_of(value: Floats) -> float:
    """Return the standard deviation of the noise of readings (n,), even if most hold contacts."""
    from scipy.stats import chi2

    size = min(max(value.size // _SEGMENTS, _SHORTEST), _SEGMENT)
    count = value.size // size
    part = value[: count * size].reshape(count, size)
    line = np.stack([np.ones(size), np.linspace(-1, 1, size)])
    basis = np.linalg.qr(line.T)[0]
    left = part - (part @ basis) @ basis.T
    square = np.sum(left**2, axis=1)
    usual = float(chi2.ppf(_QUIET, size - 2))
    noise = math.sqrt(float(np.quantile(square, _QUIET)) / usual)
    # Readings in coarse steps may be constant without contact.
    values = np.unique(value)
    step = float(np.min(np.diff(values))) if values.size > 1 else 0.0
    return max(noise, step / math.sqrt(12))


class Hum(NamedTuple):
    """Mains hum in a record: readings (n,), frequency in Hz and amplitude of the fundamental."""

    value: Floats
    frequency: float
    amplitude: float


def hum_of(time: Floats, value: Floats, quiet: np.ndarray, noise: float) -> Hum | None:
    """Return mains hum and harmonics, from the `quiet` readings (n,); None without hum."""
    length = float(time[-1] - time[0])
    at = np.flatnonzero(quiet)
    if length * _MAINS[0] < _PERIODS or at.size < 4 * _SEGMENT:
        return None
    step = length / (time.size - 1)
    width = max(int(1 / (_SLOW * step)), 1)
    count = at.size // width
    t, y = (x[at[: count * width]].reshape(count, width).mean(axis=1) for x in (time, value))
    y = y - np.median(y)
    grid = np.arange(-_AROUND, _AROUND, 1 / (8 * length)) if 8 * length * _AROUND > 1 else [0.0]
    gain, frequency = max((_gain(t, y, f + d), float(f + d)) for f in _MAINS for d in grid)
    if gain * width < _CLEAR * noise**2:
        return None
    top = 0.5 / step
    waves = [k * frequency for k in range(1, _HARMONICS + 1) if k * frequency < 0.8 * top]
    columns = _waves(time, waves)
    some = at[:: max(at.size // 200_000, 1)]
    found = np.linalg.lstsq(columns[some], value[some] - np.median(value[some]))[0]
    amplitude = float(np.hypot(found[1], found[2]))
    return Hum(columns[:, 1:] @ found[1:], frequency, amplitude)


def _waves(time: Floats, frequencies: list[float]) -> np.ndarray:
    phase = [2 * np.pi * f * time for f in frequencies]
    return np.stack([np.ones_like(time), *(g(p) for p in phase for g in (np.cos, np.sin))], axis=1)


def _gain(time: Floats, value: Floats, frequency: float) -> float:
    """Return the reduction of the sum of squares by a wave of this frequency."""
    columns = _waves(time, [frequency])
    # The columns are nearly orthogonal: normal equations lose no digits and take a tenth of the
    # time.
    left = value - columns @ np.linalg.solve(columns.T @ columns, columns.T @ value)
    return float(np.sum((value - value.mean()) ** 2) - left @ left)


CLOCK = Meaning(
    "time, t, abs time, absolute time, elapsed time, time stamp, timestamp, x value", "s"
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
    unit = None if heading is None else heading.unit
    try:
        # Convert all at once; the row itself reports a single fault.
        found = np.array([row.values[name] for row in rows]).astype(float)
        if found.ndim == 1 and np.isfinite(found).all():
            return found if unit is None or not unit.converts else found * unit.times / unit.by
    except (TypeError, ValueError, OverflowError):
        pass
    found = np.array([row.real(name) for row in rows])
    if (gone := np.isnan(found)).any():
        rows[int(np.argmax(gone))].refuse(name, "is empty")
    return found


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
    _refuse_uneven(rows, time, steps, step)


def _refuse_uneven(rows: Sequence[Row], time: Floats, steps: Floats, step: float) -> NoReturn:
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
