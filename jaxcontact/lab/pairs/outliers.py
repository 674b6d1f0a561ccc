"""A robust rule that marks outliers, such as spurious and missed triggers.

A pair is marked if ln e lies more than `THRESHOLD` standard deviations off every law that describes
the data. Without such a law it is marked if it lies so far off a robust trend in speed, and in a
table also off a smooth curve. The standard deviation is that of its reading (see `noise`), or the
known error of the reading. e > 1 alone does not mark a pair.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import NDArray

from ... import Fit
from ...extend import Floats
from .pairs import LEAST_PAIRS, RELATIVE_FLOOR, Noise, Pairs, estimate_noise, mad_sigma, pairs_of

THRESHOLD = 6.0
"""Robust standard deviations beyond which pairs are marked.

Real scatter has longer tails than the normal distribution. For the shipped balls it ends at 4.9
(blue) and 5.8 (pingpong, drag removed); the next deviations are 7.9 and 11.9.
"""

_LINE_POINTS = 10
_BENDS = 7
"""Largest degree of the curve on which no pair is marked: a coefficient for each four pairs."""

_CURVE_STEPS = 25
_BIWEIGHT = 4.685
"""Standard deviations beyond which a point has no weight: 95 % efficient for normal scatter."""

_MOST_SHIFTS = 400


@dataclasses.dataclass(frozen=True)
class Trend:
    """A robust trend of ln e: `level` + `slope` · x; x is the speed, its logarithm, or absent."""

    kind: str
    level: float
    slope: float

    def columns(self, velocity: Floats) -> Floats:
        """Return the columns (n, 1 or 2) at speeds in m/s: 1, and x if it has a slope."""
        x = _AXES[self.kind](velocity)
        one = np.ones_like(velocity)
        return np.stack([one] if self.kind == "constant" else [one, x], axis=1)

    def __call__(self, velocity: Floats) -> Floats:
        """Return ln e at speeds in m/s."""
        return self.level + self.slope * _AXES[self.kind](velocity)


_AXES: dict[str, Callable[[Floats], Floats]] = {
    "constant": np.zeros_like,
    "speed": np.asarray,
    "log speed": np.log,
}


@dataclasses.dataclass(frozen=True)
class Outliers:
    """Marked pairs among n, and the grounds.

    `flagged` (n,) bool. `deviation` (n,) from `trend`, or from the law `about`, in standard
    deviations of `noise`, positive for a ratio that is too large. `guess`, for each flagged pair,
    the probable cause.
    """

    flagged: NDArray[np.bool_]
    deviation: Floats
    guess: dict[int, str]
    trend: Trend
    noise: Noise
    about: str = ""

    def scatter(self, pairs: Pairs) -> float:
        """Return the scatter of ln e in a typical pair."""
        return float(np.median(self.noise.sigma(pairs.reading_factor)))

    def told(self, pairs: Pairs) -> Outliers:
        """Return these outliers with the probable causes."""
        usual = float(np.exp(np.median(self.trend(pairs.velocity[~self.flagged]))))
        told = pairs.guess(self.flagged, usual)
        marked = map(int, np.flatnonzero(self.flagged))
        return dataclasses.replace(self, guess={k: told.get(k, "unclear") for k in marked})

    def off_law(self, pairs: Pairs, law: str, log_e: Floats, error: Floats) -> Outliers:
        """Return the pairs off a law, which was fitted without the flagged ones.

        Pairs left out may miss its ln e (n or more,) by its standard `error` in addition. Few pairs
        may lie on the curve by chance: then only flagged ones are marked.
        """
        n, keep = len(pairs), ~self.flagged
        residual = np.log(pairs.restitution) - log_e[:n]
        more = np.where(keep, 0.0, error[:n])
        known = _known_errors(pairs)
        deviation, noise = deviations(residual, pairs.reading_factor, keep, known, more)
        off = (np.abs(deviation) > THRESHOLD) & (self.flagged | (keep.sum() >= _LINE_POINTS))
        return Outliers(off, deviation, {}, self.trend, noise, law)


def deviations(
    residual: Floats,
    reading_factor: Floats,
    keep: NDArray[np.bool_],
    least: Floats | float = 0.0,
    more: Floats | float = 0.0,
) -> tuple[Floats, Noise]:
    """Return residuals (n,) over the robust noise of those to `keep`, and this noise.

    Standard deviations are at least `least`, with `more` in addition.
    """
    noise = estimate_noise(residual[keep], reading_factor[keep], robust=True)
    size = np.maximum(noise.sigma(reading_factor), least)
    return residual / np.hypot(size, more), noise


def unusable(found: Fit, reason: str) -> Fit:
    """Return a fit as not converged for this reason, without standard errors."""
    unknown = np.full_like(found.covariance, np.nan)
    return dataclasses.replace(
        found, converged=False, reason=reason, covariance=unknown, unidentified=()
    )


def _known_errors(pairs: Pairs) -> Floats:
    """Return the known errors of ln e: few pairs may agree by chance to less than these."""
    n = len(pairs)
    return np.zeros(n) if pairs.covariance is None else np.sqrt(np.diag(pairs.covariance))


def _off_curve(pairs: Pairs) -> NDArray[np.bool_]:
    """Return which pairs also lie off a polynomial of ln v, by Tukey's biweight from an L1 fit."""
    n, y = len(pairs), np.log(pairs.restitution)
    degree = min(_BENDS, n // 4, len(np.unique(pairs.velocity)) - 1)
    place = np.log(pairs.velocity)
    size = np.ptp(place)
    columns = np.polynomial.chebyshev.chebvander(
        2 * (place - place.min()) / (size if size > 0 else 1) - 1, degree
    )
    weight, residual = np.ones(n), y
    for step in range(2 * _CURVE_STEPS):
        root = np.sqrt(weight)
        residual = y - columns @ np.linalg.lstsq(columns * root[:, None], y * root)[0]
        scale = max(mad_sigma(residual), RELATIVE_FLOOR)
        if step < _CURVE_STEPS:
            weight = 1 / np.maximum(np.abs(residual), 1e-3 * scale)
        else:
            weight = np.square(np.clip(1 - np.square(residual / (_BIWEIGHT * scale)), 0, None))
    keep = np.abs(residual) <= THRESHOLD * max(mad_sigma(residual), RELATIVE_FLOOR)
    # Readings differ in their noise.
    return np.abs(deviations(residual, pairs.reading_factor, keep)[0]) > THRESHOLD


def marked_in(
    velocity: Floats, e: Floats, sigma: Floats | None = None
) -> tuple[NDArray[np.bool_], Floats]:
    """Return which rows (n,) of a table are marked, and e on the trend; NaN in `e` is no row."""
    there = (velocity > 0) & (e > 0)
    marked = np.zeros(e.shape, bool)
    if there.sum() < LEAST_PAIRS:
        return marked, np.where(there, e, 1.0)
    known = None if sigma is None else sigma[there]
    found = find_outliers(pairs_of(velocity[there], e[there], known))
    marked[there] = found.flagged
    return marked, np.exp(found.trend(velocity))


def find_outliers(pairs: Pairs) -> Outliers:
    """Mark pairs as `mark` does, and guess the causes.

    In a table, pairs on a smooth curve are not marked, because e(v) may be steep and curved.
    Recordings of flights have spurious triggers, and speeds in a narrow range. Among fewer than
    `LEAST_PAIRS` a wrong one cannot be identified.
    """
    if len(pairs) < LEAST_PAIRS:
        level = Trend("constant", float(np.median(np.log(pairs.restitution))), 0.0)
        nothing = np.zeros(len(pairs))
        return Outliers(nothing > 0, nothing, {}, level, Noise(RELATIVE_FLOOR, 0.0))
    known = _known_errors(pairs)
    found = mark(pairs.velocity, pairs.restitution, pairs.reading_factor, known)
    if found.flagged.any() and not pairs.from_flights:
        found = dataclasses.replace(found, flagged=found.flagged & _off_curve(pairs))
    return found.told(pairs)


def mark(
    velocity: Floats,
    restitution: Floats,
    reading_factor: Floats,
    least: Floats | float = 0.0,
) -> Outliers:
    """Mark the pairs more than `THRESHOLD` robust standard deviations off the trend.

    `least` (n,) is a lower bound of the standard deviations. The trend is constant, or a Theil-Sen
    line in speed or in its logarithm, whichever leaves the least scatter. Trend and noise are
    estimated, pairs marked, and both estimated again from the unmarked pairs, until the marks stay
    the same.
    """
    y = np.log(restitution)
    keep = np.ones(len(y), dtype=bool)
    # The first round includes all outliers. It uses only the median, which is robust while fewer
    # than half the pairs are wrong. Later rounds, without the gross ones, fit slopes too.
    kinds: Iterable[str] = ["constant"]
    seen: set[bytes] = set()
    while True:
        trend = _robust_trend(kinds, velocity[keep], y[keep])
        deviation, noise = deviations(y - trend(velocity), reading_factor, keep, least)
        keep = np.abs(deviation) <= THRESHOLD
        # The marks may alternate between two sets: stop when a set recurs.
        if keep.tobytes() in seen:
            return Outliers(~keep, deviation, {}, trend, noise)
        seen.add(keep.tobytes())
        kinds = _AXES if keep.sum() >= _LINE_POINTS else ["constant"]


def _robust_trend(kinds: Iterable[str], velocity: Floats, y: Floats) -> Trend:
    """Return the kind of trend, each a Theil-Sen line, with the least scatter."""
    trends = []
    for kind in kinds:
        x = _AXES[kind](velocity)
        slope = _median_slope(x, y)
        trends.append(Trend(kind, float(np.median(y - slope * x)), slope))
    return min(trends, key=lambda trend: mad_sigma(y - trend(velocity)))


def _median_slope(x: Floats, y: Floats) -> float:
    """Return the median slope between pairs of points; a quarter of outliers cannot move it."""
    order = np.argsort(x, kind="stable")
    x, y = x[order], y[order]
    least = 1e-9 * np.max(np.abs(x))
    if x[-1] - x[0] <= least:
        return 0.0
    # All slopes of a long recording would not fit in memory: join each point to those a fixed
    # number of ranks away, at all distances.
    shifts = np.unique(np.linspace(1, len(x) - 1, min(len(x) - 1, _MOST_SHIFTS)).astype(int))
    dx = np.concatenate([x[s:] - x[:-s] for s in shifts])
    dy = np.concatenate([y[s:] - y[:-s] for s in shifts])
    return float(np.median(dy[dx > least] / dx[dx > least]))
