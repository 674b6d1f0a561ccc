"""Flights in a track: parts between lowest points with equal curvature."""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from scipy import ndimage, signal

from ..signals import Doubtful
from .fitting import LEAST_FRAMES, MAD, Guess, fit_drop
from .model import Drop, Floats, Frames, Track

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

_HEAVY = 1 / 3
"""Fraction of frames within flights that are off; with more, the result is not a drop."""

_MOST = 1.2
"""Largest ratio of successive flights."""

_ROUGH, _BENT = 2.5, 0.02
"""Limits of the residual: times the difference of neighbours, and as a fraction of the height.

Above both, the motion is not free flight. Measured values are up to 1.4 for balls, and from 2.8 and
5 % for swings.
"""

SHARE = 0.6
"""Least fraction of the frames of a flight on its parabola."""

_BEGIN = 0.03
"""Time in s beside an impact during which a ball flies freely."""


class _Arc(NamedTuple):
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


class _Side(NamedTuple):
    """The parabola beside a lowest point: height and speed there, and its farthest frame."""

    height: float
    speed: float
    reach: int


class _TrackedHeights(NamedTuple):
    """Heights (n,) over time, their noise, and which frames are no spikes."""

    time: Floats
    height: Floats
    noise: float
    good: np.ndarray

    @property
    def step(self) -> float:
        return float(np.median(np.diff(self.time)))

    def between(self, first: int, last: int) -> np.ndarray:
        """Return the good frames between two lowest points."""
        at = np.arange(first + 1, last)
        return at[self.good[at]]

    def beside(self, low: int, side: int) -> np.ndarray:
        """Return the good frames before a lowest point (`side` -1) or after it, nearest first."""
        at = np.arange(low - 1, -1, -1) if side < 0 else np.arange(low + 1, self.time.size)
        return at[self.good[at]]

    def flight(self, at: np.ndarray, low: int, fall: float) -> tuple[_Side, Floats, Floats]:
        """Fit frames with a known acceleration; return also residuals and times since `low`."""
        since = self.time[at] - self.time[low]
        columns = np.stack([np.ones_like(since), since], axis=1)
        values = self.height[at] + fall * since**2 / 2
        found, _, _ = trimmed(columns, values)
        return _Side(float(found[0]), float(found[1]), low), values - columns @ found, since

    def line(self, first: int, last: int, side: int, fall: float) -> _Side | None:
        """Return height and speed at one end of a part (`side` -1: the last); None if too short.

        Only the half of a long part near that end counts, since a ball may be held at the other.
        """
        at = self.between(first, last)[::side]
        if at.size < LEAST_FRAMES - 1:
            return None
        at = at[: max(LEAST_FRAMES, at.size // 2)]
        return self.flight(at, last if side < 0 else first, fall)[0]

    def sides(self, lows: list[int], k: int, fall: float) -> tuple[_Side | None, _Side | None]:
        """Return the flights to and from the lowest point number `k`."""
        before = lows[k - 1] if k else 0
        after = lows[k + 1] if k + 1 < len(lows) else self.time.size - 1
        return self.line(before, lows[k], -1, fall), self.line(lows[k], after, 1, fall)


def find(time: Floats, height: Floats) -> FoundDrops:
    """Find the drops in a track whose heights (n,) increase upwards."""
    noise = noise_of(height)
    seen = _TrackedHeights(time, height, noise, _without_spikes(time, height, noise))
    lows = _lowest(seen)
    while True:
        ends = zip([0, *lows], [*lows, time.size - 1], strict=True)
        parts = [_part(seen, first, last) for first, last in ends]
        fall = _common_fall(parts) or _fall_of_one(seen, lows)
        if fall is None:
            return FoundDrops([], [float(time[k]) for k in lows])
        # A point that a ball passes without turning is not an impact.
        both = [seen.sides(lows, k, fall) for k in range(len(lows))]
        turns = [d is not None and u is not None and d.speed < 0 < u.speed for d, u in both]
        if all(turns):
            break
        lows = [k for k, turn in zip(lows, turns, strict=True) if turn]
        if not lows:
            return FoundDrops([], [])
    guesses, taken = [], set()
    inner = parts[1:-1]
    usual = float(np.median([p.noise for p in inner if _fits(p, fall)] or [noise]))
    for run in _runs(time, lows, [_fits(part, fall) for part in inner]):
        made = _guess_of(seen, run, fall, max(usual, 1e-12))
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
        t = time[at].T
        with np.errstate(divide="ignore", invalid="ignore"):
            weight = np.stack(
                [
                    (time - b) * (time - c) / ((a - b) * (a - c))
                    for a, b, c in (t, t[[1, 0, 2]], t[[2, 0, 1]])
                ],
                axis=1,
            )
            off = np.abs(height - np.sum(weight * height[at], axis=1))
            limit = _SPIKE * noise * np.sqrt(1 + np.sum(weight**2, axis=1))
        good |= there & (off <= limit)
    return good


def _lowest(seen: _TrackedHeights) -> list[int]:
    """Return the frames of the lowest points, between which the ball rises detectably."""
    at, height = np.flatnonzero(seen.good), seen.height
    if at.size < 2 * LEAST_FRAMES:
        return []
    size = max(int(_SMOOTH / seen.step) // 2 * 2 + 1, 1)
    smooth = ndimage.median_filter(height[at], size, mode="nearest")
    rise = _STANDS_OUT * seen.noise / math.sqrt(size)
    peaks, _ = signal.find_peaks(-smooth, prominence=max(rise, 1e-3 * float(np.ptp(smooth))))
    # Use the lowest frame itself, near that of the average.
    near = [at[max(k - size // 2, 0) : k + size // 2 + 1] for k in peaks]
    return sorted({int(some[np.argmin(height[some])]) for some in near})


def _part(seen: _TrackedHeights, first: int, last: int) -> _Arc:
    """Return the best parabola between two lowest points, which are excluded."""
    at = seen.between(first, last)
    if at.size < LEAST_FRAMES:
        return _Arc(first + 1, last, math.nan, math.inf, math.nan, 0.0)
    t = seen.time[at] - seen.time[at].mean()
    scale = max(float(np.max(np.abs(t))), 1e-300)
    columns = np.stack([np.ones_like(t), t / scale, (t / scale) ** 2], axis=1)
    coefficients, keep, noise = trimmed(columns, seen.height[at])
    error = math.inf
    if keep.sum() > 3:
        size = np.linalg.pinv(columns[keep].T @ columns[keep])[2, 2]
        error = 2 * max(noise, 1e-300) * math.sqrt(size) / scale**2
    fall = -2 * float(coefficients[2]) / scale**2
    return _Arc(first + 1, last, fall, error, noise, float(keep.mean()))


def _common_fall(parts: list[_Arc]) -> float | None:
    """Return the acceleration that most frames between impacts have, or None."""
    some = [p for p in parts[1:-1] if p.fall > 0 and p.error < 0.5 * p.fall]
    if not some:
        return None
    fall = np.array([p.fall for p in some])
    count = np.array([float(p.high - p.low) for p in some])
    order = np.argsort(fall)
    total = np.cumsum(count[order])
    return float(fall[order][np.searchsorted(total, total[-1] / 2)])


def _fits(part: _Arc, fall: float) -> bool:
    """Return whether a part has the curvature of the flights."""
    if not part.high - part.low >= LEAST_FRAMES or not np.isfinite(part.fall):
        return False
    off = abs(part.fall - fall)
    return off <= _ALIKE * fall + _ERRORS * part.error and part.share >= SHARE


def _fall_of_one(seen: _TrackedHeights, lows: list[int]) -> float | None:
    """Return the acceleration if no flight is complete, from the ways to and from an impact."""
    falls, sizes = [], []
    for k in lows:
        for side in (-1, 1):
            # From the lowest point to near the highest on this side.
            at = seen.beside(k, side)
            rise = seen.height[at] - seen.height[k]
            at = at[: np.argmax(rise >= _NEAR * rise.max())] if at.size >= LEAST_FRAMES else at
            if at.size < LEAST_FRAMES:
                continue
            part = _part(seen, int(at.min()) - 1, int(at.max()) + 1)
            if part.fall > 0 and part.error < 0.3 * part.fall:
                falls.append(part.fall)
                sizes.append(at.size)
    return float(np.average(falls, weights=sizes)) if falls else None


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


def follow(frames: Frames) -> Track:
    """Find the flights of a ball and fit them; a track without an impact has no drops.

    Heights that count downwards are inverted, so that flights curve towards the floor.
    """
    best: Track | None = None
    for sign in (1, -1):
        turned = dataclasses.replace(frames, height=sign * frames.height, sign=sign)
        found = _fit_drops(turned, find(turned.time, turned.height))
        if best is None or _count(found) > _count(best):
            best = found
    assert best is not None  # for the type checker
    return best


def _count(track: Track) -> int:
    return sum(int(drop.used.sum()) for drop in track.drops)


def _fit_drops(frames: Frames, found: FoundDrops) -> Track:
    drops: list[Drop] = []
    skipped = [Doubtful(time, "no flights on both sides") for time in found.others]
    for guess in found.guesses:
        drop = fit_drop(frames, guess)
        impacts = guess.times[1:-1]
        why = "no parabolas" if drop is None else _doubt(drop)
        if drop is None or why:
            skipped += [Doubtful(float(time), why) for time in impacts]
        else:
            drops.append(drop)
    skipped.sort()
    return Track(frames, tuple(drops), tuple(skipped))


def _doubt(drop: Drop) -> str:
    """Return why a fit is not a drop, "" if it may be one."""
    if drop.off.sum() > _HEAVY * (drop.off.sum() + drop.used.sum()):
        return "too many frames off the parabolas"
    seconds, off = drop.seconds, drop.noise[1]
    highest = drop.camera.fall * float(seconds.max()) ** 2 / 8
    if off > max(_ROUGH * noise_of(drop.frames.height[drop.used]), _BENT * highest):
        return "no parabolas"
    error = np.sqrt(np.diag(drop.covariance))
    # A flight longer than the one before by more than its errors was thrown.
    ratio, spread = seconds[1:] / seconds[:-1], error[1:] / seconds[1:] + error[:-1] / seconds[:-1]
    if np.any(ratio > _MOST + 3 * spread):
        return "a flight longer than the one before"
    if np.any(spread > 0.5):
        return f"flights with too few frames, about {LEAST_FRAMES}"
    return ""


def trimmed(columns: np.ndarray, values: Floats) -> tuple[Floats, np.ndarray, float]:
    """Fit least squares without outliers, found iteratively; return also the noise of the rest."""
    keep = np.ones(values.size, bool)
    for _ in range(8):
        found = np.linalg.lstsq(columns[keep], values[keep])[0]
        rest = np.abs(values - columns @ found)
        noise = MAD * float(np.median(rest))
        now = rest <= max(4 * noise, np.partition(rest, columns.shape[1])[columns.shape[1]])
        if np.array_equal(now, keep):
            break
        keep = now
    freedom = max(int(keep.sum()) - columns.shape[1], 1)
    return found, keep, math.sqrt(float(np.sum(rest[keep] ** 2)) / freedom)


def _guess_of(seen: _TrackedHeights, run: list[int], fall: float, noise: float) -> Guess | None:
    """Return the drop around a run of lowest points; None if there is no flight before or after.

    Lines are fitted to heights beside lowest points, after removal of the known acceleration.
    """
    begin, finish = _edge(seen, run[0], -1, fall, noise), _edge(seen, run[-1], 1, fall, noise)
    times, floors = [], []
    for k, low in enumerate(run):
        left, right = seen.sides(run, k, fall)
        left, right = begin if k == 0 else left, finish if k == len(run) - 1 else right
        times.append(float(seen.time[low]))
        if left is not None and right is not None and right.speed > left.speed:
            # Both have the same acceleration: they meet where two lines do.
            since = (left.height - right.height) / (right.speed - left.speed)
            since = float(np.clip(since, -2 * seen.step, 2 * seen.step))
            floors.append(left.height + left.speed * since - fall * since**2 / 2)
            times[-1] += since
    floor = float(np.median(floors or seen.height[run]))
    low, high = run[0], run[-1] + 1
    if begin is not None:
        times.insert(0, times[0] - 2 * max(-begin.speed, 1e-9) / fall)
        low = begin.reach
    if finish is not None:
        times.append(times[-1] + 2 * max(finish.speed, 1e-9) / fall)
        high = finish.reach + 1
    if len(times) < 3 or not np.all(np.diff(times) > 0):
        return None
    return Guess(np.array(times), floor, fall, noise, low, high)


def _edge(seen: _TrackedHeights, low: int, side: int, fall: float, noise: float) -> _Side | None:
    """Return the flight before the first impact or after the last, as far as it is a parabola.

    The range grows by 40 % as long as most of its frames lie on the parabola.
    """
    at = seen.beside(low, side)
    at = at[np.abs(seen.time[at] - seen.time[low]) > 0.6 * seen.step]
    if at.size < LEAST_FRAMES:
        return None
    count, best = max(LEAST_FRAMES, int(_BEGIN / seen.step)), None
    while True:
        some = at[:count]
        found, off, since = seen.flight(some, low, fall)
        on = np.abs(off) <= 5 * noise + 0.02 * fall * since**2
        if (found.speed < 0) != (side < 0) or on.mean() < SHARE or on[-3:].sum() == 0:
            break
        best = found._replace(reach=int(some[on][-1]))
        if count >= at.size:
            break
        count = min(max(count + 1, int(1.4 * count)), at.size)
    return best
