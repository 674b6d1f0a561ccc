"""Spurious and missed triggers: a robust rule finds them, and says what they may be.

The rule knows nothing of e = 1. It takes ln e about a robust trend in speed, in units of its
scatter at that interval (see `_noise`), and marks a pair beyond `THRESHOLD` of them.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from .._flight import Floats
from ._noise import Noise, estimate_noise, mad_sigma
from ._pairs import Pairs
from ._recording import Interval

Flags = NDArray[np.bool_]

THRESHOLD = 6.0
"""Marked beyond this many robust standard deviations. Real scatter has longer tails than the normal
distribution: that of the shipped balls ends at 4.9 (blue) and 5.8 (pingpong, drag taken out), and
the next deviations are 7.9 and 11.9."""

_LINE_POINTS = 10
_ROUNDS = 20
_LARGEST_FOR_ALL_SLOPES = 400

_GUESS_TOLERANCE = 0.06
_LATE_TOLERANCE = 0.25  # of the deviation that a late trigger is to explain
_MOST_MERGED = 5


@dataclasses.dataclass(frozen=True)
class Trend:
    """A robust trend of ln e: `level` + `slope` · x, with x nothing, speed, or its logarithm."""

    kind: str
    level: float
    slope: float

    def __call__(self, velocity: Floats) -> Floats:
        """ln e at speeds in m/s."""
        if self.kind == "constant":
            return np.full_like(velocity, self.level)
        return self.level + self.slope * (velocity if self.kind == "speed" else np.log(velocity))


@dataclasses.dataclass(frozen=True)
class Outliers:
    """What the rule found among n pairs.

    `flagged` (n,) bool; `deviation` (n,) in robust standard deviations, positive for a ratio that
    is too large; `guess` names for each flagged pair what may have happened; `trend` and `noise`
    are what it was measured against.
    """

    flagged: Flags
    deviation: Floats
    guess: dict[int, str]
    trend: Trend
    noise: Noise


def find_outliers(pairs: Pairs) -> Outliers:
    """Mark the pairs that lie more than `THRESHOLD` robust standard deviations off the trend.

    The trend (constant, or a Theil-Sen line in speed or in its logarithm, whichever leaves the
    least scatter) and the noise are estimated, pairs marked, and both estimated again from the
    rest, until the marks stay the same.
    """
    y = np.log(pairs.restitution)
    keep = np.ones(len(pairs), dtype=bool)
    # The first round has all the outliers in it and so rests on the median alone, where half the
    # pairs may be wrong; slopes come in when the gross ones are out.
    trend = Trend("constant", float(np.median(y)), 0.0)
    deviation = np.zeros(len(pairs))
    noise = Noise(0.0, 0.0)
    seen: set[bytes] = set()
    for round_number in range(_ROUNDS):
        if round_number:
            trend = _robust_trend(pairs.velocity[keep], y[keep])
        residual = y - trend(pairs.velocity)
        noise = estimate_noise(residual[keep], pairs.reading_factor[keep], robust=True)
        deviation = residual / noise.sigma(pairs.reading_factor)
        new = np.abs(deviation) <= THRESHOLD
        # The rule may swing between two sets; the second visit to one of them ends it.
        if round_number and new.tobytes() in seen:
            keep = new
            break
        seen.add(new.tobytes())
        keep = new
    flagged = ~keep
    guess = _guess(pairs, flagged, trend) if pairs.layout == "intervals" else {}
    for k in np.flatnonzero(flagged):
        guess.setdefault(int(k), "unclear")
    return Outliers(flagged, deviation, guess, trend, noise)


def _robust_trend(velocity: Floats, y: Floats) -> Trend:
    constant = Trend("constant", float(np.median(y)), 0.0)
    if len(y) < _LINE_POINTS:
        return constant
    trends = [constant]
    for kind, x in (("speed", velocity), ("log speed", np.log(velocity))):
        slope = _theil_sen(x, y)
        trends.append(Trend(kind, float(np.median(y - slope * x)), slope))
    return min(trends, key=lambda trend: mad_sigma(y - trend(velocity)))


def _theil_sen(x: Floats, y: Floats) -> float:
    """Median of the slopes between pairs of points: a line that a quarter of them cannot move."""
    if len(x) > _LARGEST_FOR_ALL_SLOPES:
        # All slopes of a long recording would not fit in memory: join each point to those a
        # fixed number of ranks away, at all distances.
        order = np.argsort(x, kind="stable")
        x, y = x[order], y[order]
        shifts = np.unique(np.linspace(1, len(x) - 1, _LARGEST_FOR_ALL_SLOPES).astype(int))
        dx = np.concatenate([x[s:] - x[:-s] for s in shifts])
        dy = np.concatenate([y[s:] - y[:-s] for s in shifts])
    else:
        i, j = np.triu_indices(len(x), 1)
        dx, dy = x[j] - x[i], y[j] - y[i]
    apart = np.abs(dx) > 1e-9 * max(float(np.max(np.abs(x))), 1e-300)
    return float(np.median(dy[apart] / dx[apart])) if np.any(apart) else 0.0


def _guess(pairs: Pairs, flagged: Flags, trend: Trend) -> dict[int, str]:
    """What may have happened to the flagged pairs, from the intervals around each."""
    interval: dict[tuple[float, str, int], float] = {}
    for first, second in pairs.sources:
        for record in (first, second):
            assert isinstance(record, Interval)  # the caller checks the layout
            interval[record.drop_height, record.trial, record.bounce] = record.seconds
    e = float(np.exp(np.median(trend(pairs.velocity[~flagged]))))
    guess: dict[int, str] = {}
    for k in np.flatnonzero(flagged):
        first, second = pairs.sources[k]
        assert isinstance(first, Interval)
        assert isinstance(second, Interval)
        near = [
            interval.get((first.drop_height, first.trial, first.bounce + step))
            for step in range(-2, 4)
        ]
        guess[int(k)] = _guess_one(near, e)
    return guess


def _close(ratio: float | None, expected: float) -> bool:
    return ratio is not None and abs(ratio / expected - 1) < _GUESS_TOLERANCE


def _ratio(above: float | None, below: float | None) -> float | None:
    return None if above is None or below is None else above / below


def _sum(a: float | None, b: float | None) -> float | None:
    return None if a is None or b is None else a + b


def _guess_one(near: list[float | None], e: float) -> str:
    """`near` are the intervals k-2 ... k+3 about the pair (k, k+1); `e` is the usual ratio."""
    two_before, before, first, second, after, two_after = near
    assert first is not None  # a pair has both
    assert second is not None
    # A flight cut in two: the parts together fit their neighbours, and each is too short.
    # Asked first: neighbours on both sides are better evidence than one ratio.
    cuts = (
        (_ratio(_sum(first, second), before), _ratio(after, _sum(first, second))),
        (_ratio(_sum(second, after), first), _ratio(two_after, _sum(second, after))),
        (_ratio(_sum(before, first), two_before), _ratio(second, _sum(before, first))),
    )
    for into, out_of in cuts:
        matches = [_close(r, e) for r in (into, out_of) if r is not None]
        if matches and all(matches):
            return "spurious trigger (one flight cut in two)"
    # An interval that holds m flights is 1 + e + ... times as long.
    for m in range(2, _MOST_MERGED + 1):
        whole = (1 - e**m) / (1 - e) if e < 1 else float(m)
        if _close(second / first, e * whole):
            return f"missed trigger ({m} flights in the second interval)"
        if _close(second / first, e**m / whole):
            return f"missed trigger ({m} flights in the first interval)"
    # A trigger between two good ones that came late or early: one interval is too long, its
    # neighbour too short, and their sum is right, much more nearly than the ratio.
    off = abs(math.log(second / first / e))
    shifts = (
        (two_before, before, first),
        (before, first, second),
        (first, second, after),
    )
    for reference, a, b in shifts:
        both, between = _ratio(_sum(a, b), reference), _ratio(b, a)
        if both is None or between is None:
            continue
        tolerance = min(_LATE_TOLERANCE * off, _GUESS_TOLERANCE)
        right = abs(math.log(both / (e + e * e))) < tolerance
        # Two good intervals also have the right sum: the fault must lie between these two.
        if right and abs(math.log(between / e)) > off / 2:
            return "late or early trigger"
    return "unclear"
