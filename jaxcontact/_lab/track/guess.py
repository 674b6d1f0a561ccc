"""The start of the fit of a drop.

Lines are fitted to heights beside lowest points, after removal of the known acceleration.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from .fitting import LEAST_FRAMES, Guess
from .search import MAD
from .seen import Floats

SHARE = 0.6
"""Least fraction of the frames of a flight on its parabola."""

_BEGIN = 0.03
"""Time in s beside an impact during which a ball flies freely."""


class _Side(NamedTuple):
    """The parabola beside a lowest point: height and speed there, and its farthest frame."""

    height: float
    speed: float
    reach: int


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


def line(
    time: Floats, height: Floats, good: np.ndarray, first: int, last: int, side: int, fall: float
) -> tuple[float, float] | None:
    """Return height and speed at one end of a part with known acceleration (`side` -1: the last).

    Only the half of a long part near that end counts, since a ball may be held at the other.
    """
    at = np.arange(first + 1, last)
    at = at[good[at]]
    if at.size < LEAST_FRAMES - 1:
        return None
    at = at[::side]
    at = at[: max(LEAST_FRAMES, at.size // 2)]
    since = time[at] - time[last if side < 0 else first]
    columns = np.stack([np.ones_like(since), since], axis=1)
    found, _, _ = trimmed(columns, height[at] + fall * since**2 / 2)
    return float(found[0]), float(found[1])


def guess_of(
    time: Floats, height: Floats, good: np.ndarray, run: list[int], fall: float, noise: float
) -> Guess | None:
    """Return the drop around a run of lowest points; None if there is no flight before or after."""
    step = float(np.median(np.diff(time)))
    edges = [_edge(time, height, good, run[0], -1, fall, noise)]
    edges.append(_edge(time, height, good, run[-1], 1, fall, noise))
    impacts, floors = [], []
    for k, low in enumerate(run):
        left = (
            edges[0]
            if k == 0
            else _Side(*_none_to_nan(line(time, height, good, run[k - 1], low, -1, fall)), low)
        )
        right = (
            edges[1]
            if k == len(run) - 1
            else _Side(*_none_to_nan(line(time, height, good, low, run[k + 1], 1, fall)), low)
        )
        if left is not None and right is not None and right.speed > left.speed:
            # Both have the same acceleration: they meet where two lines do.
            since = (left.height - right.height) / (right.speed - left.speed)
            since = float(np.clip(since, -2 * step, 2 * step))
            floors.append(left.height + left.speed * since - fall * since**2 / 2)
            impacts.append(float(time[low]) + since)
        else:
            impacts.append(float(time[low]))
    floor = float(np.median(floors)) if floors else float(np.median(height[run]))
    times = list(impacts)
    low, high = run[0], run[-1] + 1
    if edges[0] is not None:
        times.insert(0, times[0] - 2 * max(-edges[0].speed, 1e-9) / fall)
        low = edges[0].reach
    if edges[1] is not None:
        times.append(times[-1] + 2 * max(edges[1].speed, 1e-9) / fall)
        high = edges[1].reach + 1
    if len(times) < 3 or not np.all(np.diff(times) > 0):
        return None
    return Guess(np.array(times), floor, fall, noise, low, high)


def _none_to_nan(line: tuple[float, float] | None) -> tuple[float, float]:
    return (math.nan, math.nan) if line is None else line


def _edge(
    time: Floats,
    height: Floats,
    good: np.ndarray,
    low: int,
    side: int,
    fall: float,
    noise: float,
) -> _Side | None:
    """Return the flight before the first impact or after the last, as far as it is a parabola.

    The range grows by 40 % as long as most of its frames lie on the parabola.
    """
    step = float(np.median(np.diff(time)))
    at = np.arange(low - 1, -1, -1) if side < 0 else np.arange(low + 1, time.size)
    at = at[good[at] & (np.abs(time[at] - time[low]) > 0.6 * step)]
    if at.size < LEAST_FRAMES:
        return None
    count, best = max(LEAST_FRAMES, int(_BEGIN / step)), None
    while True:
        some = at[:count]
        since = time[some] - time[low]
        columns = np.stack([np.ones_like(since), since], axis=1)
        values = height[some] + fall * since**2 / 2
        found, _, _ = trimmed(columns, values)
        rest = np.abs(values - columns @ found)
        allowed = 5 * noise + 0.02 * fall * since**2
        on = rest <= allowed
        if (found[1] < 0) != (side < 0) or on.mean() < SHARE or on[-3:].sum() == 0:
            break
        far = some[on][-1]
        best = _Side(float(found[0]), float(found[1]), int(far))
        if count >= at.size:
            break
        count = min(max(count + 1, int(1.4 * count)), at.size)
    return best
