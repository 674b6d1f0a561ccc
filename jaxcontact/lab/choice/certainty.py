"""Certainty of the choice of a law, and restitution without one: a line, a free smooth curve."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.special import fdtrc, gammaincc

from ... import Fit
from ...extend import (
    CLEAR_AICC,
    LEAST_GROUPS,
    FitData,
    criteria_of,
    listed,
    sandwich,
)
from .kind import Kind

EXCLUDED = 0.01
"""p below which a law is excluded; a right law is excluded by a wrong one at most this often."""

BETTER = 0.05
"""p below which a law is clearly better than its special case, or a free curve than a law."""

_SAME = 5e-3
"""Difference of AICc that is only rounding."""


class Squares(NamedTuple):
    """The sum of squares of a fit: ½ Σ z², the whitened residuals z, and degrees of freedom."""

    loss: float
    z: np.ndarray
    dof: int


@dataclasses.dataclass(frozen=True)
class Standing:
    """The certainty of choosing `kind`: whether it is `sure`, and the laws `containing` it.

    The choice of X is sure if every law that does not contain X is excluded, no law that contains X
    is clearly better, and X describes the data.
    """

    sure: bool
    kind: str
    containing: frozenset[str]
    rivals: tuple[str, ...]
    """Laws that prevent certainty: not excluded, or clearly better."""


@dataclasses.dataclass(frozen=True)
class Certainty:
    """Which of the fitted `kinds` the data exclude."""

    fits: Mapping[str, Fit]
    kinds: Sequence[Kind]

    @functools.cached_property
    def reduced(self) -> dict[str, str]:
        """The laws whose fit is no better than that of a special case, and the latter."""
        converged = [kind for kind in self.kinds if self.fits[kind.name].converged]
        own = {kind.name: self.fits[kind.name].criteria for kind in converged}
        return {
            kind.name: other.name
            for kind in converged
            for other in converged
            if kind.contains(other)
            for (k, aicc, _), (least, lower, _) in [(own[kind.name], own[other.name])]
            if k <= least and aicc > lower - _SAME
        }

    def standing(self, kind: str) -> Standing:
        """Return the standing of one kind among all."""
        by_name, found = {one.name: one for one in self.kinds}, self.fits[kind]
        own = by_name[kind]
        containing = frozenset(name for name, one in by_name.items() if one.contains(own))
        rivals = tuple(
            name
            for name, other in by_name.items()
            if name not in {kind, *self.reduced}
            if _keeps_open(found, own, self.fits[name], other)
        )
        good = found.converged and found.adequate is True and len(self.fits) > 1
        return Standing(good and not rivals, kind, containing, rivals)

    @functools.cached_property
    def sure(self) -> Standing | None:
        """The standing of the one law that is sure, or None."""
        found = (self.standing(kind.name) for kind in self.kinds)
        return next((one for one in found if one.sure), None)

    def sentence(
        self, best: str | None, sure: Standing | None, said: Collection[str | None], beyond: bool
    ) -> str:
        """Return whether the choice of `best` is sure, as a sentence that follows the verdict.

        `said` are the laws that the verdict already calls indistinguishable from it. `beyond`:
        whether a free curve may describe the data better than any law.
        """
        if sure is not None and len(self.fits) == 2:
            (other,) = self.fits.keys() - {sure.kind}
            how = f"excluded (p < {EXCLUDED:g})"
            if other in sure.containing:
                how = f"not clearly better (p ≥ {BETTER:g})"
            return f" The choice is sure between the two: {other} is {how}."
        if sure is not None:
            but = " that does not contain it" if sure.containing else ""
            return f" The choice is sure: every other law{but} is excluded (p < {EXCLUDED:g} each)."
        if best is None or self.fits[best].adequate is False:
            return ""
        open_ = " The choice is not sure: "
        rivals = self.standing(best).rivals
        if rest := [name for name in rivals if name not in said]:
            return f"{open_}{listed(rest)} {'is' if len(rest) == 1 else 'are'} not ruled out."
        if rivals:
            return ""
        if self.fits[best].adequate is None:
            return f"{open_}the fit could not be tested."
        return f"{open_}a free smooth curve has an AICc lower by more than 2." if beyond else ""


def _keeps_open(found: FitData, own: Kind, fit: FitData, other: Kind) -> bool:
    """Return whether another law, which may contain this one, prevents certainty."""
    if not (found.converged and fit.converged):
        return True
    more = len(fit.names) - len(found.names)
    if other.contains(own):
        return excess_p(fit, found, more) < BETTER
    # A law that does not contain the other can approach it along one more direction.
    numbers = max(-more, 0) + (0 if own.contains(other) else 1)
    return excess_p(found, fit, numbers) >= EXCLUDED


def excess_p(better: FitData | Squares, worse: FitData, numbers: int) -> float:
    """Return the probability of so much larger a sum of squares if `numbers` parameters are idle.

    F = (Σz'² - Σz²)/numbers/s², with s² of the better fit, or 1 if the noise is known. If points of
    a trial may be correlated, the result is the larger of this and the probability by trial. The
    latter uses the noise along the difference d = z' - z of the two curves, Σ_g (Σ_i d_i z_i)²/Σ d²
    over the trials g.
    """
    gain = 2 * (worse.loss - better.loss)
    if gain <= 0 or better.dof < 1:
        return 1.0
    if better.loss == 0:
        return 0.0
    if worse._absolute:
        p = float(gammaincc(numbers / 2, gain / 2))
    else:
        p = float(fdtrc(numbers, better.dof, gain / numbers / (2 * better.loss / better.dof)))
    return max(p, _by_trial(better, worse, gain, numbers))


def _by_trial(better: FitData | Squares, worse: FitData, gain: float, numbers: int) -> float:
    """Return the probability by trial; 0 if every point is its own trial."""
    if not worse.has_trials:
        return 0.0
    assert worse.groups is not None  # for the type checker
    used = np.asarray(worse.problem.factor) > 0
    trial = np.unique(worse.groups[used], return_inverse=True)[1]
    count = int(trial.max()) + 1
    if count < 2:
        return 1.0
    z, difference = better.z, worse.z - better.z
    along = np.bincount(trial, weights=difference * z)
    noise = float(along @ along) * count / (count - 1) / float(difference @ difference)
    return float(fdtrc(numbers, count - 1, gain / numbers / noise)) if noise > 0 else 0.0


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

    @property
    def falls(self) -> bool:
        """True if the slope is negative by two standard errors."""
        return self.slope_error is not None and self.slope <= -2 * self.slope_error


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
        place = _place(velocity, self.slowest, self.fastest)
        return np.exp(np.polynomial.chebyshev.chebval(place, self.coefficients))


def _fitted(
    fit: FitData, columns: Float[np.ndarray, "n k"]
) -> tuple[Float[np.ndarray, " k"], Squares, Float[np.ndarray, "k k"]]:
    """Fit columns to ln e, the first n data of a fit, with their weights and groups.

    Return the coefficients, their squares, and their covariance, NaN if it is singular.
    """
    points = len(columns)
    factor, whitener = np.asarray(fit.problem.factor)[:points], fit.problem.whitener
    used = factor > 0
    weighted = columns * factor[:, None]
    y = np.where(used, fit.data[:points], 0) * factor
    if whitener is not None:
        # Other data are uncorrelated. The part of ln e is the corner, because the factor is lower
        # triangular.
        own = np.asarray(whitener)[:points, :points]
        weighted, y = own @ weighted, own @ y
    weighted, y = weighted[used], y[used]
    n, k = weighted.shape
    coefficients, _, rank, _ = np.linalg.lstsq(weighted, y)
    z = weighted @ coefficients - y
    covariance = np.full((k, k), np.nan)
    if rank == k and n > k:
        inverse = np.linalg.inv(weighted.T @ weighted)
        covariance = inverse * (1.0 if fit._absolute else float(z @ z) / (n - k))
        number = None if fit.groups is None else fit.groups[:points][used]
        if number is not None and len(np.unique(number)) >= LEAST_GROUPS:
            covariance = sandwich(inverse, weighted * z[:, None], number)
    return coefficients, Squares(float(z @ z) / 2, z, n - k), covariance


def line_of(fit: FitData, velocity: Floats) -> Line:
    """Return the line through the data of a fit of ln e, with their weights and groups."""
    columns = np.stack([np.ones_like(velocity), velocity], axis=1)
    (level, slope), _, covariance = _fitted(fit, columns)
    variance = float(covariance[1, 1])
    return Line(
        float(level), float(slope), math.sqrt(variance) if 0 <= variance < math.inf else None
    )


def curve_of(fits: Iterable[FitData], velocity: Floats) -> Curve:
    """Return the free curve through the data of fits of ln e, with their weights."""
    fit, *_ = fits = tuple(fits)
    factor = np.asarray(fit.problem.factor)[: len(velocity)]
    v, factor = velocity[factor > 0], factor[factor > 0]
    ends = float(v.min()), float(v.max())
    most = min(_MOST, len(v) - 1, len(np.unique(v)) - 1)
    columns = np.polynomial.chebyshev.chebvander(_place(velocity, *ends), max(most, 0))
    degrees = columns.shape[1]
    found = {}
    for k in range(1, degrees + 1):
        coefficients, squares, _ = _fitted(fit, columns[:, :k])
        aicc = criteria_of(squares.loss, k, factor, fit._absolute)[0]
        found.setdefault(aicc, (k, coefficients, squares))
    aicc = min(found)
    k, coefficients, squares = found[aicc]
    # Contact times and forces are other data, with another criterion.
    known = math.isfinite(aicc) and fit.data.size == velocity.size
    laws = [(one, one.criteria) for one in fits if one.converged and known]
    better = bool(laws) and all(
        lowest - aicc > CLEAR_AICC
        # A curve that does not contain the law can approach it along one more direction.
        and degrees * excess_p(squares, law, max(k - own, 0) + 1) < BETTER
        for law, (own, lowest, _) in laws
    )
    return Curve(tuple(map(float, coefficients)), *ends, aicc if known else None, better)


def _place(velocity: Floats, slowest: float, fastest: float) -> Floats:
    """Return ln v scaled to [-1, 1]."""
    if not fastest > slowest:
        return np.zeros_like(velocity)
    return 2 * np.log(velocity / slowest) / np.log(fastest / slowest) - 1
