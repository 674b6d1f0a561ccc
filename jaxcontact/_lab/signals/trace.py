"""A long instrument record: even times, noise, and removal of mains hum."""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

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
    tries = [(_gain(t, y, f + float(d)), f + float(d)) for f in _MAINS for d in grid]
    gain, frequency = max(tries)
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
