"""Confidence intervals of the parameters, and bands of the prediction."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ..._entry import FRACTION, POSITIVE, as_numbers, rendered, require_number
from ..data import FitData
from .profile import held_at, quantile_of

_ROUNDS = 30
_ASIDE = 0.05
_NEAR = 0.1
_MET = 1e-3
"""Relative error of a deviation at the end of an interval: a thousandth of a standard error."""

_STRIDE = 2.0
"""Largest ratio of the distance of a probe to that of the last one."""

_FAR = 40.0
"""Distance of a logarithm or logit that is its bound, or beyond all data."""

_FREE_FAR = 1e6
"""Distance in standard errors of a number without a unit that is beyond all data."""


def interval(fit: FitData, level: float = 0.95) -> dict[str, tuple[float, float]]:
    """Return the confidence interval (low, high) of each parameter, by its profile likelihood.

    At an end, 2 (loss - best)/s², with the other parameters refitted, is the square of the
    quantile. It is that of a normal distribution if `sigma` was given, otherwise of Student's t
    with `dof`. No end lies beyond a bound. If the data do not limit a parameter, the end is the
    bound, which may be infinite.

    With `groups`, the likelihood cannot include the correlation. The interval is then that of the
    sandwich in the logarithm or logit of the parameter, with Student's t for the number of groups
    less one. An end is NaN if it was not found because fits of the others did not converge.

    Raises ValueError for a level outside (0, 1), and for a fit that did not converge.

    Source: Bates & Watts (1988), doi 10.1002/9780470316757, ch. 6.
    """
    level = require_number("level", level, FRACTION)
    _require_converged(fit, "intervals")
    space = fit.problem.space
    bounds = np.stack([np.asarray(space.low), np.asarray(space.high)])
    quantile = _quantile(fit, level)
    error = fit.scaled_errors
    known = np.isfinite(error) & np.isfinite(quantile)
    ends = bounds.copy()
    if fit.by_group:
        theta = fit._theta + np.array([[-1.0], [1.0]]) * np.where(known, quantile * error, 0)
        ends = np.where(known, _values(fit, theta), bounds)
    else:
        at_bound = np.array([name in fit.at_bound for name in fit.names])
        free = known | (at_bound & np.isfinite(quantile))
        sides = [(i, sign) for i in map(int, np.flatnonzero(free)) for sign in (-1, 1)]
        lanes = [(i, sign) for i, sign in sides if not (at_bound[i] and _outwards(fit, i, sign))]
        if lanes:
            found = _ends(fit, np.array(lanes), np.where(known, error, np.nan), quantile)
            for (i, sign), end in zip(lanes, found, strict=True):
                ends[(sign + 1) // 2, i] = end
    return {name: (float(ends[0, i]), float(ends[1, i])) for i, name in enumerate(fit.names)}


def confidence_band(
    fit: FitData, x: Any = None, *, level: float = 0.95
) -> tuple[np.ndarray, np.ndarray]:
    """Return the band low, high (n,) that holds the true curve, pointwise with probability `level`.

    The band is the prediction ± q √(g Cov gᵀ) with g = d prediction/dp. q is the quantile of a
    normal distribution if `sigma` was given, otherwise of Student's t with `dof` (with groups, for
    their number less one). `x` as in `predict`; several columns follow each other. Raises
    ValueError for a level outside (0, 1), and for a fit that did not converge.

    Source: Seber & Wild (1989), doi 10.1002/0471725315, ch. 5.
    """
    level = require_number("level", level, FRACTION)
    _require_converged(fit, "bands")
    curve, error = fit.predict_with_error(x)
    half = _quantile(fit, level) * error
    return curve - half, curve + half


def prediction_band(
    fit: FitData, x: Any = None, *, level: float = 0.95, sigma: Any = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return the band low, high (n,) that holds a new reading, pointwise with probability `level`.

    As `confidence_band`, with the scatter of a reading: q √(g Cov gᵀ + σ²). `sigma` is the standard
    deviation of the new readings, one number or one for each. By default it is that of the data, or
    the median of their column if `x` is given and they differ. Raises ValueError as
    `confidence_band` does, and for a `sigma` that is not positive or has another shape.
    """
    level = require_number("level", level, FRACTION)
    _require_converged(fit, "bands")
    curve, error = fit.predict_with_error(x)
    spread = scatter(fit)
    if sigma is not None:
        spread = as_numbers(sigma, "sigma")
        if spread.shape not in ((), curve.shape) or not POSITIVE.holds(spread).all():
            raise ValueError(
                f"Argument `sigma` must be positive, one number or one for each of {curve.size}, "
                f"but is {rendered(sigma)}."
            )
    elif x is not None:
        columns = np.split(spread, np.cumsum([math.prod(s) for s in fit.problem.shapes])[:-1])
        sizes = [np.size(leaf) for leaf in jax.tree.leaves(fit.predict(x))]
        spread = np.repeat([np.nanmedian(column) for column in columns], sizes)
    half = _quantile(fit, level) * np.hypot(error, spread)
    return curve - half, curve + half


def scatter(fit: FitData) -> np.ndarray:
    """Return the standard deviation of each reading (n,); NaN for one without weight."""
    factor = np.asarray(fit.problem.factor)
    used = factor > 0
    return np.where(used, np.sqrt(fit.noise) / np.where(used, factor, 1), np.nan)


def _require_converged(fit: FitData, what: str) -> None:
    if not fit.converged:
        raise ValueError(f"A fit that did not converge has no {what}: {fit.reason}.")


def _quantile(fit: FitData, level: float) -> float:
    """Return the factor of a standard error; NaN without a degree of freedom."""
    if fit.by_group and fit.groups is not None:
        used = np.asarray(fit.problem.factor) > 0
        return quantile_of(False, len(np.unique(fit.groups[used])) - 1, level)
    return quantile_of(fit._absolute, fit.dof, level)


def _values(fit: FitData, theta: np.ndarray) -> np.ndarray:
    """Return the parameters at free coordinates (rows, k)."""
    with jax.enable_x64(True):
        return np.asarray(jax.vmap(fit.problem.space.values)(jnp.asarray(theta)))


def _outwards(fit: FitData, i: int, sign: int) -> bool:
    """Return whether this side of a parameter at its bound lies outside the bound."""
    space = fit.problem.space
    above = space.bounded_above[i] and fit._theta[i] > 0
    return (sign > 0) == above


class _Ray(NamedTuple):
    """Searches (lanes,) for interval ends of parameters `at` to one `side`, -1 or 1.

    A distance along a ray is one of the parameter's free coordinate. `drift` (lanes, k) is the
    accompanying change of the others, to first order. `stride` is the distance at which the end is
    expected; beyond `limit` the end is the `bound`.
    """

    at: np.ndarray
    side: np.ndarray
    drift: np.ndarray
    stride: np.ndarray
    limit: np.ndarray
    bound: np.ndarray


def _rays(fit: FitData, lanes: np.ndarray, error: np.ndarray, quantile: float) -> _Ray:
    space = fit.problem.space
    at, side = lanes[:, 0], lanes[:, 1].astype(float)
    known = np.isfinite(error[at])
    # From its bound, which is far out, a parameter first returns to the middle.
    stride = np.where(known, quantile * np.where(known, error[at], 1), np.abs(fit._theta[at]))
    limit = np.where(space.has_unit[at], np.maximum(_FAR, 2 * stride), _FREE_FAR * stride)
    limit = np.where(known, limit, 2 * stride)
    stretch = space.stretch(fit.values)
    with np.errstate(invalid="ignore", divide="ignore"):
        together = fit.covariance[at] / np.diag(fit.covariance)[at, None]
        drift = np.nan_to_num(together * (stretch[at, None] / stretch), posinf=0, neginf=0)
    drift[np.arange(at.size), at] = 1
    bound = np.where(side > 0, np.asarray(space.high)[at], np.asarray(space.low)[at])
    return _Ray(at, side, drift, stride, limit, bound)


def _ends(fit: FitData, lanes: np.ndarray, error: np.ndarray, quantile: float) -> np.ndarray:
    """Return where the deviation of a parameter is the quantile, for lanes (parameter, side)."""
    ray = _rays(fit, lanes, error, quantile)
    rows = np.arange(ray.at.size), ray.at
    inside, inner = np.zeros(ray.at.size), np.zeros(ray.at.size)
    outside, outer = np.full(ray.at.size, np.inf), np.full(ray.at.size, np.nan)
    probe, end, done = ray.stride, outer, np.zeros(ray.at.size, bool)
    for _ in range(_ROUNDS):
        theta = fit._theta + ray.drift * (ray.side * probe)[:, None]
        held = np.full_like(theta, np.nan)
        held[rows] = _values(fit, theta)[rows]
        deviation, _ = held_at(fit, held, theta)
        below = deviation < quantile
        met, beyond = abs(deviation / quantile - 1) < _MET, below & (probe >= ray.limit)
        end = np.where(done, end, np.where(met, held[rows], np.where(beyond, ray.bound, end)))
        done |= met | beyond
        if done.all():
            break
        # A failed probe counts as one that went too far.
        inside, inner = np.where(below, [probe, deviation], [inside, inner])
        outside, outer = np.where(below, [outside, outer], [probe, deviation])
        probe = np.minimum(_between(inside, inner, outside, outer, quantile), ray.limit)
    return end


def _between(
    inside: np.ndarray, inner: np.ndarray, outside: np.ndarray, outer: np.ndarray, quantile: float
) -> np.ndarray:
    """Return the next probe: deviations are nearly linear in a free coordinate."""
    with np.errstate(invalid="ignore", divide="ignore"):
        onwards = inside * np.clip(quantile / inner, 1.1, _STRIDE)
        met = inside + (outside - inside) * (quantile - inner) / (outer - inner)
        # Keep some distance from both, so that both converge.
        aside = _ASIDE * (outside - inside)
        met = np.clip(met, inside + aside, outside - aside)
        half = (inside + outside) / 2
    # Returning from a bound, where a deviation rises exponentially.
    near = np.isfinite(met) & (inner > _NEAR * quantile) & (outer < quantile / _NEAR)
    return np.where(near, met, np.where(np.isfinite(outside), half, onwards))
