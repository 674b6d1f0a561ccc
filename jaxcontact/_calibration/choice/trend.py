"""Restitution without a law: a straight line, and a free smooth curve."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..._fit import CLEAR_AICC, LEAST_GROUPS, FitData, criteria, criteria_of, sandwich
from .certainty import BETTER, Squares, excess_p

_MOST = 6
"""Largest degree of the free curve; laws do not have more turns within the data."""

Floats = Float[np.ndarray, " n"]


@dataclasses.dataclass(frozen=True)
class Line:
    """The straight line ln e = a + b v through the data.

    `level` a; `slope` b in s/m, with its standard error, None if the speeds do not determine it.
    """

    level: float
    slope: float
    slope_error: float | None


@dataclasses.dataclass(frozen=True)
class Curve:
    """A free smooth curve: ln e as a polynomial of ln v, of the degree with the least AICc.

    It is not a candidate, but shows what any law could reach. `coefficients` are those of Chebyshev
    polynomials over ln v from `slowest` to `fastest` in m/s. `aicc` is comparable with that of the
    laws, None with too few points. `better`: whether it is clearly better than every law. Its AICc
    is then lower by more than 2, and each law is excluded by F of its larger sum of squares (p <
    0.05, divided by the number of degrees tried).
    """

    coefficients: tuple[float, ...]
    slowest: float
    fastest: float
    aicc: float | None
    better: bool

    def __call__(self, velocity: Floats) -> Floats:
        """Return e at closing speeds (n,) in m/s."""
        return np.exp(np.polynomial.chebyshev.chebval(self._place(velocity), self.coefficients))

    def _place(self, velocity: Floats) -> Floats:
        return _place(velocity, self.slowest, self.fastest)


class _Linear(NamedTuple):
    """A linear least-squares fit: coefficients, its squares, and the covariance."""

    coefficients: np.ndarray
    squares: Squares
    covariance: Float[np.ndarray, "k k"]


class _Data(NamedTuple):
    """ln e of a fit, roots of its weights, groups, whether the noise is known, and the whitener."""

    y: Floats
    factor: Floats
    groups: np.ndarray | None
    absolute: bool
    whitener: Float[np.ndarray, "n n"] | None

    def fitted(self, columns: Float[np.ndarray, "n k"]) -> _Linear:
        """Fit columns; the covariance is NaN if it is singular."""
        used = self.factor > 0
        weighted = columns * self.factor[:, None]
        y = np.where(used, self.y, 0) * self.factor
        if self.whitener is not None:
            weighted, y = self.whitener @ weighted, self.whitener @ y
        weighted, y = weighted[used], y[used]
        n, k = weighted.shape
        coefficients, _, rank, _ = np.linalg.lstsq(weighted, y)
        z = weighted @ coefficients - y
        covariance = np.full((k, k), np.nan)
        if rank == k and n > k:
            inverse = np.linalg.inv(weighted.T @ weighted)
            covariance = inverse * (1.0 if self.absolute else float(z @ z) / (n - k))
            number = None if self.groups is None else self.groups[used]
            if number is not None and len(np.unique(number)) >= LEAST_GROUPS:
                covariance = sandwich(inverse, weighted * z[:, None], number)
        return _Linear(coefficients, Squares(float(z @ z) / 2, z, n - k), covariance)


def _data_of(fit: FitData, n: int) -> _Data:
    """Return the first column of n points, which is ln e."""
    groups = None if fit.groups is None else fit.groups[:n]
    whitener = fit.problem.whitener
    # Other columns are uncorrelated. The first column's part is the corner, because the factor is
    # lower triangular.
    own = None if whitener is None else np.asarray(whitener)[:n, :n]
    return _Data(fit.data[:n], np.asarray(fit.problem.factor)[:n], groups, fit._absolute, own)


def line_of(fit: FitData, velocity: Floats) -> Line:
    """Return the line through the data of a fit of ln e, with their weights and groups."""
    data = _data_of(fit, len(velocity))
    found = data.fitted(np.stack([np.ones_like(velocity), velocity], axis=1))
    error = math.sqrt(found.covariance[1, 1]) if found.covariance[1, 1] >= 0 else math.nan
    level, slope = map(float, found.coefficients)
    return Line(level, slope, error if math.isfinite(error) else None)


def curve_of(fits: Iterable[FitData], velocity: Floats) -> Curve:
    """Return the free curve through the data of fits of ln e, with their weights."""
    fit, *_ = fits = tuple(fits)
    data = _data_of(fit, len(velocity))
    v = velocity[data.factor > 0]
    ends = float(v.min()), float(v.max())
    n = len(v)
    most = min(_MOST, n - 1, len(np.unique(v)) - 1)
    columns = np.polynomial.chebyshev.chebvander(_place(velocity, *ends), max(most, 0))
    degrees, factor = columns.shape[1], data.factor[data.factor > 0]
    found = {}
    for k in range(1, degrees + 1):
        one = data.fitted(columns[:, :k])
        found.setdefault(criteria_of(one.squares.loss, k, factor, fit._absolute)[0], (k, one))
    aicc = min(found)
    k, best = found[aicc]
    # Contact times and forces are other data, with another criterion.
    known = math.isfinite(aicc) and fit.data.size == velocity.size
    laws = [(one, criteria(one)) for one in fits if one.converged and known]
    better = bool(laws) and all(
        lowest - aicc > CLEAR_AICC
        # A curve that does not contain the law can approach it along one more direction.
        and degrees * excess_p(best.squares, law, max(k - own, 0) + 1) < BETTER
        for law, (own, lowest, _) in laws
    )
    return Curve(tuple(map(float, best.coefficients)), *ends, aicc if known else None, better)


def _place(velocity: Floats, slowest: float, fastest: float) -> Floats:
    """Return ln v scaled to [-1, 1]."""
    if not fastest > slowest:
        return np.zeros_like(velocity)
    return 2 * np.log(velocity / slowest) / np.log(fastest / slowest) - 1
