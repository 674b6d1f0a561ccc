"""Certainty of the choice of a law, and restitution without one: a line, a free smooth curve."""

from __future__ import annotations

import dataclasses
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
    SAME,
    FitData,
    criteria,
    criteria_of,
    has_trials,
    listed,
    sandwich,
)
from .kind import AbstractKind

EXCLUDED = 0.01
"""p below which a law is excluded; a right law is excluded by a wrong one at most this often."""

BETTER = 0.05
"""p below which a law is clearly better than its special case, or a free curve than a law."""


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


def standing_of(fits: Mapping[str, Fit], kinds: Sequence[AbstractKind], kind: str) -> Standing:
    """Return the standing of one kind among all that were fitted."""
    by_name = {one.name: one for one in kinds}
    own, found, reduced = by_name[kind], fits[kind], reduced_of(fits, kinds)
    containing = frozenset(name for name, one in by_name.items() if one.contains(own))
    rivals = [
        name
        for name, other in by_name.items()
        if name != kind and name not in reduced and _keeps_open(found, own, fits[name], other)
    ]
    good = found.converged and found.adequate is True and len(fits) > 1
    return Standing(good and not rivals, kind, containing, tuple(rivals))


def reduced_of(fits: Mapping[str, FitData], kinds: Sequence[AbstractKind]) -> dict[str, str]:
    """Return the laws whose fit is no better than that of a special case, and the latter.

    These fits have no more identifiable parameters than the special case.
    """
    converged = [kind for kind in kinds if fits[kind.name].converged]
    return {
        kind.name: other.name
        for kind in converged
        for other in converged
        if kind.contains(other) and _same(fits[kind.name], fits[other.name])
    }


def _same(fit: FitData, special: FitData) -> bool:
    (k, aicc, _), (least, lower, _) = criteria(fit), criteria(special)
    return k <= least and aicc > lower - SAME


def sure_of(fits: Mapping[str, Fit], kinds: Sequence[AbstractKind]) -> Standing | None:
    """Return the one law that is sure, or None."""
    found = (standing_of(fits, kinds, kind.name) for kind in kinds)
    return next((one for one in found if one.sure), None)


def rivals_of(
    fits: Mapping[str, Fit], kinds: Sequence[AbstractKind], best: str | None, sure: Standing | None
) -> tuple[str, ...]:
    """Return the converged laws other than the best that are not ruled out."""
    if best is None or sure is not None:
        return ()
    return tuple(n for n in standing_of(fits, kinds, best).rivals if fits[n].converged)


def _keeps_open(found: FitData, own: AbstractKind, fit: FitData, other: AbstractKind) -> bool:
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
    if not has_trials(worse):
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


def sure_sentence(
    fits: Mapping[str, Fit],
    kinds: Sequence[AbstractKind],
    best: str | None,
    sure: Standing | None,
    said: Collection[str | None],
    *,
    beyond: bool,
) -> str:
    """Return whether the choice of `best` is sure, as a sentence that follows the verdict.

    `said` are the laws that the verdict already calls indistinguishable from it. `beyond`: whether
    a free curve may describe the data better than any law.
    """
    if sure is not None and len(fits) == 2:
        (other,) = fits.keys() - {sure.kind}
        how = f"excluded (p < {EXCLUDED:g})"
        if other in sure.containing:
            how = f"not clearly better (p ≥ {BETTER:g})"
        return f" The choice is sure between the two: {other} is {how}."
    if sure is not None:
        but = " that does not contain it" if sure.containing else ""
        return f" The choice is sure: every other law{but} is excluded (p < {EXCLUDED:g} each)."
    if best is None or fits[best].adequate is False:
        return ""
    standing = standing_of(fits, kinds, best)
    rest = [name for name in standing.rivals if name not in said]
    if rest:
        verb = "is" if len(rest) == 1 else "are"
        return f" The choice is not sure: {listed(rest)} {verb} not ruled out."
    if standing.rivals:
        return ""
    if fits[best].adequate is None:
        return " The choice is not sure: the fit could not be tested."
    if beyond:
        return " The choice is not sure: a free smooth curve has an AICc lower by more than 2."
    return ""


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
