"""Errors that readings share in addition to independent ones: their sizes and consequences.

With the matrix B of the shared part, of mean variance 1, errors have the covariance σ² V(s) = σ²
((1 - s) I + s B). If neither σ nor the share s is known, few readings leave s open.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import stdtrit

from ... import Fit
from ...extend import basis_of
from .pairs import standardised

_ODDS = np.concatenate([[0], np.geomspace(1e-2, 1e6, 40)])
_SHARES = _ODDS / (1 + _ODDS)

_ANGLES = np.arctan(np.sqrt(_ODDS))
"""Angles of the two standard deviations, √(1 - s) and √s; all are equally probable a priori."""

_PRIOR = np.gradient(_ANGLES)

_LEVEL = 0.95
_DRAWS, _MANY, _EVERY = 1000, 300, 2
"""Simulated data sets for every second share; beyond `_MANY` points, fewer sets."""

_ROUNDS = 2
_NOTHING = 1e-300


class SharedNoise(NamedTuple):
    """The errors of points: relative `variance` (n,), `correlation` (n, n) and `share`.

    `share` is that of the shared part in the mean variance. `unit` is the mean variance of the
    given B.
    """

    variance: Float[np.ndarray, " n"]
    correlation: Float[np.ndarray, "n n"]
    share: float
    unit: float


class _Seen(NamedTuple):
    """Results of draws of residuals (n, draws).

    The `weight` (s, draws) of each share, and the mean `angle` (draws,), with whose share they are
    fitted. `moved` (k, draws) is the resulting shift of the parameters, `alone` its variance at
    that share, and `whole` its variance over all shares.
    """

    weight: Float[np.ndarray, "s draws"]
    angle: Float[np.ndarray, " draws"]
    moved: Float[np.ndarray, "k draws"]
    alone: Float[np.ndarray, "k draws"]
    whole: Float[np.ndarray, "k draws"]


class _Shares:
    """V(s) of all shares beside a fit, linearised about its end.

    In the `vectors` of B it is the diagonal `variance` (s, n). `slope` (n, rank) spans what the
    parameters can move, and `to_parameters` (k, rank) leads back to them. `inverse` (s, rank, rank)
    is that of XᵀV⁻¹X, and `volume` (s,) the contribution of its determinant and that of V to the
    likelihood. `unit` is the mean variance of the given B, and `residual` (n, 1) that of the fit.
    """

    def __init__(
        self, found: Fit, used: Bool[np.ndarray, " n"], shape: Float[np.ndarray, "n n"]
    ) -> None:
        slope = slope_of(found)[used]
        basis, length = basis_of(slope), np.linalg.norm(slope, axis=0)
        told = (length > 0) & np.isfinite(found.errors)
        inverse = np.linalg.pinv(slope[:, length > 0] / length[length > 0])
        self.to_parameters: np.ndarray = (inverse @ basis)[told[length > 0]]
        self.residual: np.ndarray = found.residuals[used][:, None]
        self.unit: float = float(np.mean(np.diag(shape)[used]))
        size, self.vectors = np.linalg.eigh((shape / self.unit)[np.ix_(used, used)])
        self.variance: np.ndarray = (1 - _SHARES)[:, None] + _SHARES[:, None] * np.maximum(size, 0)
        self.slope: np.ndarray = self.vectors.T @ basis
        information = np.einsum("sn,na,nb->sab", 1 / self.variance, self.slope, self.slope)
        volume = np.sum(np.log(self.variance), axis=1) + np.linalg.slogdet(information)[1]
        self.inverse: np.ndarray = np.linalg.inv(information)
        self.volume: np.ndarray = -volume / 2

    def weigh(self, r: Float[np.ndarray, "n draws"]) -> _Seen:
        """Return what draws of residuals make of shares and parameters."""
        r, precision = self.vectors.T @ r, 1 / self.variance
        pull = np.stack([precision @ (column[:, None] * r) for column in self.slope.T], axis=1)
        moved = self.inverse @ pull
        left = np.maximum(precision @ r**2 - np.sum(pull * moved, axis=1), _NOTHING)
        n, rank = self.slope.shape
        log = -(n - rank) / 2 * np.log(left) + self.volume[:, None]
        weight = _PRIOR[:, None] * np.exp(log - log.max(axis=0))
        weight /= weight.sum(axis=0)
        moved = self.to_parameters @ moved
        covariance = self.to_parameters @ self.inverse @ self.to_parameters.T
        spread = np.diagonal(covariance, axis1=1, axis2=2)[:, :, None] * left[:, None] / (n - rank)
        middle = np.einsum("sd,skd->kd", weight, moved)
        whole = np.einsum("sd,skd->kd", weight, spread + (moved - middle) ** 2)
        angle = _ANGLES @ weight
        at, draws = np.argmin(np.abs(_ANGLES[:, None] - angle), axis=0), np.arange(angle.size)
        return _Seen(weight, angle, moved[at, :, draws].T, spread[at, :, draws].T, whole)


def shared_noise(
    found: Fit, used: Bool[np.ndarray, " n"], shape: Float[np.ndarray, "n n"]
) -> SharedNoise:
    """Estimate the share of errors with a covariance like `shape` (n, n) in the residuals of a fit.

    By restricted likelihood, -2 ln L = (n - k) ln(rᵀ P r) + ln|V| + ln|Xᵀ V⁻¹ X|, with the fit
    linearised about its end (Patterson & Thompson 1971, doi 10.1093/biomet/58.3.545). The angle of
    the two standard deviations is averaged with the weight L.
    """
    shares = _Shares(found, used, shape)
    share = float(np.sin(shares.weigh(shares.residual).angle[0]) ** 2)
    whole = (1 - share) * np.eye(used.size) + share * shape / shares.unit
    size, correlation = standardised(whole)
    return SharedNoise(size**2, correlation, share, shares.unit)


def widening(found: Fit, used: Bool[np.ndarray, " n"], shape: Float[np.ndarray, "n n"]) -> float:
    """Return the factor by which the uncertainty of the share widens squared standard errors.

    Intervals of Student's t with n - k degrees of freedom then cover the truth in 95 % of cases.
    The quantile of (estimate - truth)/(standard error) is simulated for each share, averaged with
    its likelihood, and simulated again with that average (prepivoting: Beran 1987, doi
    10.1093/biomet/74.3.457).
    """
    shares = _Shares(found, used, shape)
    seen = shares.weigh(shares.residual)
    n, rank = shares.slope.shape
    noise = np.random.default_rng(0).normal(size=(n, int(_DRAWS * min(1, _MANY / n))))
    ratios, weights = [], []
    for variance in shares.variance[::_EVERY]:
        one = shares.weigh(shares.vectors @ (np.sqrt(variance)[:, None] * noise))
        ratios.append(np.log(np.maximum(np.abs(one.moved), _NOTHING) / np.sqrt(one.whole)))
        weights.append(one.weight)

    def quantile_of(ratios: list[np.ndarray]) -> Float[np.ndarray, "s k"]:
        some = np.array([np.quantile(ratio, _LEVEL, axis=1) for ratio in ratios])
        return np.stack([np.interp(_ANGLES, _ANGLES[::_EVERY], one) for one in some.T], axis=1)

    quantile = quantile_of(ratios)
    for _ in range(_ROUNDS):
        left = [r - quantile.T @ weight for r, weight in zip(ratios, weights, strict=True)]
        quantile = quantile + quantile_of(left)
    half = np.exp(quantile.T @ seen.weight) * np.sqrt(seen.whole)
    t = float(stdtrit(n - rank, (1 + _LEVEL) / 2))
    return float(np.mean((half / t) ** 2 / seen.alone))


def slope_of(found: Fit) -> Float[np.ndarray, "n k"]:
    """Return the derivative of the residuals themselves, neither weighted nor whitened."""
    factor, whitener = np.asarray(found.problem.factor), found.problem.whitener
    slope = found._jacobian
    if whitener is not None:
        slope = np.linalg.solve(np.asarray(whitener), slope)
    return slope / np.where(factor > 0, factor, 1)[:, None]
