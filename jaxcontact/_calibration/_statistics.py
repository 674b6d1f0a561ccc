"""Standard errors and the comparison of fits, for measurements that come in trials."""

from __future__ import annotations

import dataclasses
import math
from typing import Literal

import numpy as np

from .._flight import Floats
from .._measurements._pairs import Ints

LEAST_CLUSTERS = 8
"""Trials needed before their scatter says anything about standard errors."""

ErrorKind = Literal["by trial", "by pair"]


@dataclasses.dataclass(frozen=True)
class Information:
    """What n standardised residuals z (n,) and their slopes J = d ln e/dθ /σ (n,) tell of θ.

    `variance` of θ; `kind` "by trial" is the sandwich H⁻¹ (Σ_trials (Σ J z)²) H⁻¹ C/(C-1) with
    H = Σ J² and C trials, which stands whatever the correlation inside a trial (two successive
    ratios share an interval, and an error of it moves them in opposite ways); with fewer than
    `LEAST_CLUSTERS` trials it is "by pair", s²/H with s² = Σ z²/(n-1), which takes pairs as
    independent.
    """

    variance: float
    kind: ErrorKind


def information(z: Floats, slope: Floats, cluster: Ints) -> Information:
    """The variance of θ from residuals z (n,), slopes (n,) and trial numbers (n,)."""
    curvature = float(np.sum(slope**2))
    if curvature == 0:
        return Information(math.inf, "by pair")
    names, place = np.unique(cluster, return_inverse=True)
    count = len(names)
    if count < LEAST_CLUSTERS:
        return Information(float(np.sum(z**2)) / (len(z) - 1) / curvature, "by pair")
    score = np.bincount(place, weights=slope * z, minlength=count)
    meat = float(np.sum(score**2)) * count / (count - 1)
    return Information(meat / curvature**2, "by trial")


def aicc(z: Floats, sigma: Floats, parameters: int) -> float:
    """Akaike's criterion with the small-sample term, of normal residuals whose size is fitted too.

    n ln(Σ z²/n) + 2 Σ ln σ + 2 k + 2 k (k+1)/(n-k-1) with k = `parameters` + 1, up to a constant
    that is the same for all fits to the same data. Raises ValueError where n ≤ k + 1.
    """
    n, k = len(z), parameters + 1
    if n <= k + 1:
        raise ValueError(f"Argument `z` must have more than {k + 1} values, but has {n}.")
    return _deviance(z, sigma) + 2 * k + 2 * k * (k + 1) / (n - k - 1)


def bic(z: Floats, sigma: Floats, parameters: int) -> float:
    """Schwarz' criterion, with k ln n in place of the terms of `aicc` in k."""
    return _deviance(z, sigma) + (parameters + 1) * math.log(len(z))


def _deviance(z: Floats, sigma: Floats) -> float:
    # Data without noise fit exactly; the logarithm then needs a number.
    mean_square = max(float(np.mean(z**2)), np.finfo(np.float64).tiny)
    return len(z) * math.log(mean_square) + 2 * float(np.sum(np.log(sigma)))


def preference(z: Floats, other: Floats, cluster: Ints) -> float | None:
    """How many standard errors, by trial, the first fit is better than the other (Vuong's test).

    The advantage ½ (z'² - z²) of each pair, in units of the mean square residual, is summed within
    each trial; the result is the total over its standard error. None with fewer than
    `LEAST_CLUSTERS` trials, or where the two fits are the same.
    """
    names, place = np.unique(cluster, return_inverse=True)
    count = len(names)
    scale = float(np.mean(z**2) + np.mean(other**2)) / 2
    if count < LEAST_CLUSTERS or scale == 0:
        return None
    gain = np.bincount(place, weights=(other**2 - z**2) / (2 * scale), minlength=count)
    spread = math.sqrt(count * float(np.var(gain, ddof=1)))
    return float(np.sum(gain)) / spread if spread > 0 else None


@dataclasses.dataclass(frozen=True)
class Line:
    """A free line ln e = a + b v, no law: the yardstick that shows what any smooth curve could do.

    `slope` b in s/m with its standard error, `aicc`, and the reduced χ².
    """

    level: float
    slope: float
    slope_error: float
    aicc: float
    reduced_chi2: float


def fit_line(velocity: Floats, y: Floats, sigma: Floats, cluster: Ints) -> Line:
    """The weighted least-squares line through ln e (n,) at speeds (n,) in m/s."""
    centre = float(np.average(velocity, weights=sigma**-2))
    design = np.stack([np.ones_like(velocity), velocity - centre], axis=1) / sigma[:, None]
    target = y / sigma
    solution = np.linalg.lstsq(design, target, rcond=None)[0]
    z = target - design @ solution
    # About the weighted mean speed the two columns are orthogonal: one slope, one variance.
    variance = information(z, design[:, 1], cluster).variance
    return Line(
        level=float(solution[0] - solution[1] * centre),
        slope=float(solution[1]),
        slope_error=math.sqrt(variance),
        aicc=aicc(z, sigma, 2) if len(z) > 4 else math.inf,
        reduced_chi2=float(np.sum(z**2)) / (len(z) - 2),
    )
