"""Flights in a track: parts between lowest points with equal curvature."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy import ndimage, signal

from .fitting import LEAST_FRAMES, Guess
from .guess import SHARE, guess_of, line, trimmed
from .search import MAD
from .seen import Floats

_STANDS_OUT = 8.0
"""Standard deviations by which a ball must rise between two impacts."""

_SMOOTH = 0.012
"""Length in s of the median filter before the search for impacts."""

_SPIKE = 6.0
_ALIKE = 0.12
"""Tolerance of the curvature of flights: this fraction plus `_ERRORS` standard errors."""

_ERRORS = 5.0
_NEAR = 0.93
"""Fraction of the height above which a ball may be held."""

_HIGHER = 1.3
"""Largest ratio of a flight time to the one before."""


class _Part(NamedTuple):
    """The frames from `low` to below `high` between two lowest points, and their best parabola.

    `fall` is its acceleration and `error` the standard error, `noise` the scatter, and `share` the
    fraction of frames on it.
    """

    low: int
    high: int
    fall: float
    error: float
    noise: float
    share: float


class FoundDrops(NamedTuple):
    """Guesses of the drops, and the times of lowest points that belong to none of them."""

    guesses: list[Guess]
    others: list[float]


def find(time: Floats, height: Floats) -> FoundDrops:
    """Find the drops in a track whose heights (n,) increase upwards."""
    noise = noise_of(height)
    good = _without_spikes(time, height, noise)
    lows = _lowest(time, height, good, noise)
    while True:
        parts = [
            _part(time, height, a, b, good)
            for a, b in zip([0, *lows], [*lows, time.size - 1], strict=True)
        ]
        fall = _common_fall(parts)
        if fall is None:
            fall = _fall_of_one(time, height, good, lows, noise)
        if fall is None:
            return FoundDrops([], [float(time[k]) for k in lows])
        # A point that a ball passes without turning is not an impact.
        bad = [k for k in lows if not _turns(time, height, good, lows, k, fall)]
        if not bad:
            break
        lows = [k for k in lows if k not in bad]
        if not lows:
            return FoundDrops([], [])
    guesses, taken = [], set()
    inner = parts[1:-1]
    usual = float(np.median([p.noise for p in inner if _fits(p, fall)] or [noise]))
    for run in _runs(time, lows, [_fits(part, fall) for part in inner]):
        made = guess_of(time, height, good, run, fall, max(usual, 1e-12))
        if made is not None:
            guesses.append(made)
            taken.update(run)
    return FoundDrops(guesses, [float(time[k]) for k in lows if k not in taken])


def noise_of(height: Floats) -> float:
    """Return the noise of one height, from third differences, which vanish for parabolas."""
    third = np.diff(height, 3)
    return MAD * float(np.median(np.abs(third))) / math.sqrt(20) if third.size else 0.0


def _without_spikes(time: Floats, height: Floats, noise: float) -> np.ndarray:
    """Return which frames lie on the parabola through the three before or the three after."""
    n = time.size
    good = np.zeros(n, bool)
    for side in (-1, 1):
        at = np.arange(n)[:, None] + side * np.array([1, 2, 3])
        there = np.all((at >= 0) & (at < n), axis=1)
        at = np.clip(at, 0, n - 1)
        t, y = time[at], height[at]
        a, b, c = t.T
        now = time
        with np.errstate(divide="ignore", invalid="ignore"):
            weight = np.stack(
                [
                    (now - b) * (now - c) / ((a - b) * (a - c)),
                    (now - a) * (now - c) / ((b - a) * (b - c)),
                    (now - a) * (now - b) / ((c - a) * (c - b)),
                ],
                axis=1,
            )
            off = np.abs(height - np.sum(weight * y, axis=1))
            limit = _SPIKE * noise * np.sqrt(1 + np.sum(weight**2, axis=1))
        good |= there & (off <= limit)
    return good


def _lowest(time: Floats, height: Floats, good: np.ndarray, noise: float) -> list[int]:
    """Return the frames of the lowest points, between which the ball rises detectably."""
    at = np.flatnonzero(good)
    if at.size < 2 * LEAST_FRAMES:
        return []
    step = float(np.median(np.diff(time)))
    size = max(int(_SMOOTH / step) // 2 * 2 + 1, 1)
    smooth = ndimage.median_filter(height[at], size, mode="nearest")
    rise = _STANDS_OUT * noise / math.sqrt(size)
    peaks, _ = signal.find_peaks(-smooth, prominence=max(rise, 1e-3 * float(np.ptp(smooth))))
    # Use the lowest frame itself, near that of the average.
    found = []
    for k in peaks:
        low, high = max(k - size // 2, 0), k + size // 2 + 1
        found.append(int(at[low + np.argmin(height[at[low:high]])]))
    return sorted(set(found))


def _part(time: Floats, height: Floats, first: int, last: int, good: np.ndarray) -> _Part:
    """Return the best parabola between two lowest points, which are excluded."""
    at = np.arange(first + 1, last)
    at = at[good[at]]
    if at.size < LEAST_FRAMES:
        return _Part(first + 1, last, math.nan, math.inf, math.nan, 0.0)
    t = time[at] - time[at].mean()
    scale = max(float(np.max(np.abs(t))), 1e-300)
    columns = np.stack([np.ones_like(t), t / scale, (t / scale) ** 2], axis=1)
    coefficients, keep, noise = trimmed(columns, height[at])
    error = math.inf
    if keep.sum() > 3:
        size = np.linalg.pinv(columns[keep].T @ columns[keep])[2, 2]
        error = 2 * max(noise, 1e-300) * math.sqrt(size) / scale**2
    return _Part(
        first + 1, last, -2 * float(coefficients[2]) / scale**2, error, noise, float(keep.mean())
    )


def _common_fall(parts: list[_Part]) -> float | None:
    """Return the acceleration that most frames between impacts have, or None."""
    some = [p for p in parts[1:-1] if p.fall > 0 and p.error < 0.5 * p.fall]
    if not some:
        return None
    fall = np.array([p.fall for p in some])
    count = np.array([float(p.high - p.low) for p in some])
    order = np.argsort(fall)
    total = np.cumsum(count[order])
    return float(fall[order][np.searchsorted(total, total[-1] / 2)])


def _fits(part: _Part, fall: float) -> bool:
    """Return whether a part has the curvature of the flights."""
    if not part.high - part.low >= LEAST_FRAMES or not np.isfinite(part.fall):
        return False
    off = abs(part.fall - fall)
    return off <= _ALIKE * fall + _ERRORS * part.error and part.share >= SHARE


def _fall_of_one(
    time: Floats, height: Floats, good: np.ndarray, lows: list[int], noise: float
) -> float | None:
    """Return the acceleration if no flight is complete, from the ways to and from an impact."""
    falls = []
    for k in lows:
        for side in (-1, 1):
            at = _way(height, good, k, side)
            if at.size < LEAST_FRAMES:
                continue
            part = _part(time, height, int(at.min()) - 1, int(at.max()) + 1, good)
            if part.fall > 0 and part.error < 0.3 * part.fall:
                falls.append((part.fall, at.size))
    if not falls:
        return None
    return float(np.average([f for f, _ in falls], weights=[n for _, n in falls]))


def _way(height: Floats, good: np.ndarray, low: int, side: int) -> np.ndarray:
    """Return the frames from the lowest point to near the highest on one side."""
    at = np.arange(low - 1, -1, -1) if side < 0 else np.arange(low + 1, height.size)
    at = at[good[at]]
    if at.size < LEAST_FRAMES:
        return at
    rise = height[at] - height[low]
    above = np.flatnonzero(rise >= _NEAR * rise.max())
    return at[: above[0]]


def _turns(
    time: Floats, height: Floats, good: np.ndarray, lows: list[int], low: int, fall: float
) -> bool:
    """Return whether a ball moves down to a lowest point, and up from it."""
    k = lows.index(low)
    before = lows[k - 1] if k else 0
    after = lows[k + 1] if k + 1 < len(lows) else time.size - 1
    down = line(time, height, good, before, low, -1, fall)
    up = line(time, height, good, low, after, 1, fall)
    return down is not None and up is not None and down[1] < 0 < up[1]


def _runs(time: Floats, lows: list[int], good: list[bool]) -> list[list[int]]:
    """Return lowest points with flights between, in runs; single ones too."""
    runs = [[lows[0]]] if lows else []
    for k, fits in enumerate(good):
        before = time[lows[k]] - time[lows[k - 1]] if len(runs[-1]) > 1 else math.inf
        if fits and time[lows[k + 1]] - time[lows[k]] < _HIGHER * before:
            runs[-1].append(lows[k + 1])
        else:
            runs.append([lows[k + 1]])
    return runs
