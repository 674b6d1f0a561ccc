"""Profile likelihoods, confidence intervals from them, and bands of the prediction."""

from __future__ import annotations

import dataclasses
import math
import operator
import statistics
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ..._entry import (
    FRACTION,
    POSITIVE,
    as_numbers,
    refusal,
    require_choice,
    require_count,
    require_number,
)
from ..._program import in_double, quick
from ..data import FitData, require_converged
from ..problem.problem import FitProblem
from ..search.minimum import FARTHEST, SearchOptions, assessed, searched
from ..search.verdict import creeping

_MOST_REFITS = 100
"""Most steps of the fits near a best one."""

_ROUNDS = 30
_ASIDE = 0.05
_NEAR = 0.1
_MET = 1e-3
"""Relative error of a deviation at the end of an interval: a thousandth of a standard error."""

_STRIDE = 2.0
"""Largest ratio of the distance of a probe to that of the last one."""

_FREE_FAR = 1e6
"""Distance in standard errors of a number without a unit that is beyond all data."""


@dataclasses.dataclass(frozen=True)
class Profile:
    """The lowest loss (points,) with one parameter held at each of `values` (points,).

    `deviation` (points,) is ±√(2 (loss - best)/s²), which is a straight line through the best value
    where the normal approximation holds. s² is the variance of the standardised residuals. Points
    whose fit of the other parameters did not converge are NaN.
    """

    name: str
    best: float
    values: np.ndarray
    loss: np.ndarray
    deviation: np.ndarray
    dof: int
    absolute: bool

    def interval(self, level: float = 0.95) -> tuple[float, float]:
        """Return where the deviation is the quantile of a normal distribution, or of Student's t.

        Student's t has `dof` degrees of freedom. An end beyond the profiled values is infinite.
        """
        # Imported here, since interpolation loads half of SciPy.
        from scipy.interpolate import PchipInterpolator

        wanted = self.quantile(level)
        good = np.isfinite(self.deviation)
        y, order = np.unique([*self.deviation[good], 0.0], return_index=True)
        x = np.array([*self.values[good], self.best])[order]
        curve = PchipInterpolator(y, x, extrapolate=False)
        low, high = float(curve(-wanted)), float(curve(wanted))
        return (-np.inf if np.isnan(low) else low, np.inf if np.isnan(high) else high)

    def quantile(self, level: float) -> float:
        """Return the deviation at the ends of an interval."""
        return quantile_of(self.absolute, self.dof, require_number("level", level, FRACTION))

    def __repr__(self) -> str:
        low, high = self.interval()
        return f"Profile of {self.name}: {self.best:.9g}, 95 % in [{low:.6g}, {high:.6g}]"


def quantile_of(absolute: bool, dof: int, level: float) -> float:
    """Return the quantile of a normal distribution for known noise, otherwise of Student's t.

    It is NaN without degrees of freedom.
    """
    tail = (1 + level) / 2
    if absolute:
        return statistics.NormalDist().inv_cdf(tail)
    # SciPy takes half a second to load.
    from scipy.special import stdtrit

    return float(stdtrit(dof, tail)) if dof > 0 else math.nan


def profile(
    fit: FitData, name: str, values: ArrayLike | None = None, *, points: int = 41, span: float = 4.0
) -> Profile:
    """Return the profile likelihood of one parameter: the lowest loss with it held at each value.

    By default `points` values over `span` standard errors to both sides, inside the bounds. Returns
    a `Profile`, whose `interval(level)` needs no normal approximation. Raises ValueError for an
    unknown name, for one without a standard error if no values are given, and for a fit that did
    not converge.

    Source: Venzon & Moolgavkar (1988), doi 10.2307/2347496.
    """
    require_choice("name", name, fit.names)
    points = require_count("points", points, 2)
    span = require_number("span", span, POSITIVE)
    require_converged(fit, "profile")
    place = fit.names.index(name)
    low, high = float(fit.problem.space.low[place]), float(fit.problem.space.high[place])
    best = float(fit.values[place])
    if values is None:
        error = fit.standard_errors[name]
        if not np.isfinite(error):
            raise ValueError(
                f"Argument `values` must be given for {name}, which has no standard error."
            )
        at = best + np.linspace(-span, span, points) * error
        at = at[(at > low) & (at < high)]
    else:
        at = np.sort(as_numbers(values, "values").ravel())
        if not at.size or not (np.isfinite(at) & (at > low) & (at < high)).all():
            raise refusal("values", f"be finite and in ({low:g}, {high:g}), at least one", values)
    rows = np.full((at.size, fit.values.size), np.nan)
    rows[:, place] = at
    deviation, loss = held_at(fit, rows, np.tile(fit._theta, (at.size, 1)))
    deviation *= np.sign(at - best)
    return Profile(name, best, at, loss, deviation, fit.dof, fit._absolute)


def held_at(
    fit: FitData, held: Float[np.ndarray, "lanes k"], starts: Float[np.ndarray, "lanes k"]
) -> tuple[Float[np.ndarray, " lanes"], Float[np.ndarray, " lanes"]]:
    """Return √(2 (loss - best)/s²) and the lowest loss with some numbers `held` (NaN: free).

    Both are NaN if the fit of the others did not converge.
    """
    _, loss, converged, step = refits(fit, _held, "space.held", held, starts)
    out = creeping(fit.problem.space, step) & np.isnan(held) & ~converged[:, None]
    if out.any():
        bound = np.where(step > 0, fit.problem.space.high, fit.problem.space.low)
        _, there, met, _ = refits(fit, _held, "space.held", np.where(out, bound, held), starts)
        # Lanes without a creeping coordinate are unchanged.
        better = met & (there <= loss)
        loss, converged = np.where(better, there, loss), better | converged
    loss = np.where(converged, loss, np.nan)
    # The rise of twice the loss at one standard error. The curvature of Huber's loss is mean ψ'
    # times that of squares.
    unit = fit.noise * float(np.mean(np.abs(fit.z) <= float(fit.problem.limit)))
    if fit._wider is not None:
        # A lane holds the one parameter that it profiles.
        unit = unit * fit._wider[np.argmax(~np.isnan(held), axis=1)]
    with np.errstate(invalid="ignore"):
        return np.sqrt(2 * np.maximum(loss - fit.loss, 0) / unit), loss


def refits(
    fit: FitData, compiled: Callable[..., Any], field: str, numbers: np.ndarray, starts: np.ndarray
) -> tuple[np.ndarray, ...]:
    """Return the `ends_of` fits near a fit, by the `compiled` function."""
    with in_double():
        options = SearchOptions(jnp.asarray(fit._rtol), max_steps=_MOST_REFITS)
        found = compiled(fit.problem, field, *jax.device_put((numbers, starts)), options)
    return tuple(map(np.asarray, found))


def ends_of(
    problem: FitProblem,
    field: str,
    numbers: Float[Array, "lanes m"],
    starts: Float[Array, "lanes k"],
    options: SearchOptions,
) -> tuple[Array, ...]:
    """Return the values, the losses, which have converged, and the remaining steps of fits, each
    with other `numbers` in a `field` of the problem.
    """

    def one(numbers: Float[Array, " m"], start: Float[Array, " k"]) -> tuple[Array, ...]:
        other = eqx.tree_at(operator.attrgetter(field), problem, numbers)
        found = assessed(other, searched(other, start, options), options.rtol)
        good = jnp.all(found.still) & jnp.isfinite(found.loss)
        return found.values, found.loss, good, found.step

    return jax.vmap(one)(numbers, starts)


_held = quick(ends_of)


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
    require_converged(fit, "intervals")
    space, quantile, error = fit.problem.space, _quantile(fit, level), fit.scaled_errors
    ends = np.stack([np.asarray(space.low), np.asarray(space.high)])
    known = np.isfinite(error) & np.isfinite(quantile)
    if fit.by_group:
        theta = fit._theta + np.array([[-1.0], [1.0]]) * np.where(known, quantile * error, 0)
        ends = np.where(known, _values(fit, theta), ends)
    else:
        at_bound = np.isin(fit.names, fit.at_bound)
        # The side of a parameter at its bound that lies outside has no end to find.
        outwards = np.where(space.bounded_above & (fit._theta > 0), 1, -1)
        lanes = [
            (i, side)
            for i in np.flatnonzero(known | (at_bound & np.isfinite(quantile))).tolist()
            for side in (0, 1)
            if not (at_bound[i] and 2 * side - 1 == outwards[i])
        ]
        if lanes:
            at, side = np.array(lanes).T
            ends[side, at] = _ends(fit, at, side, np.where(known, error, np.nan), quantile)
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
    curve, error, quantile = _curve(fit, x, level)
    return curve - quantile * error, curve + quantile * error


def prediction_band(
    fit: FitData, x: Any = None, *, level: float = 0.95, sigma: Any = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return the band low, high (n,) that holds a new reading, pointwise with probability `level`.

    As `confidence_band`, with the scatter of a reading: q √(g Cov gᵀ + σ²). `sigma` is the standard
    deviation of the new readings, one number or one for each. By default it is that of the data, or
    the median of their column if `x` is given and they differ. Raises ValueError as
    `confidence_band` does, and for a `sigma` that is not positive or has another shape.
    """
    curve, error, quantile = _curve(fit, x, level)
    spread = fit.scatter
    if sigma is not None:
        spread = as_numbers(sigma, "sigma")
        if spread.shape not in ((), curve.shape) or not POSITIVE.holds(spread).all():
            raise refusal(
                "sigma", f"be positive, one number or one for each of {curve.size}", sigma
            )
    elif x is not None:
        sizes = [np.size(leaf) for leaf in jax.tree.leaves(fit.predict(x))]
        medians = [np.nanmedian(spread[fit.problem.columns == c]) for c in range(len(sizes))]
        spread = np.repeat(medians, sizes)
    half = quantile * np.hypot(error, spread)
    return curve - half, curve + half


def _curve(fit: FitData, x: Any, level: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Return the prediction, its standard error, and the factor of a band."""
    level = require_number("level", level, FRACTION)
    require_converged(fit, "bands")
    return *fit.predict_with_error(x), _quantile(fit, level)


def _quantile(fit: FitData, level: float) -> float:
    """Return the factor of a standard error; NaN without a degree of freedom."""
    if fit.by_group and fit._trials is not None:
        return quantile_of(False, int(fit._trials.max()), level)
    return quantile_of(fit._absolute, fit.dof, level)


def _values(fit: FitData, theta: np.ndarray) -> np.ndarray:
    """Return the parameters at free coordinates (rows, k)."""
    with jax.enable_x64(True):
        return np.asarray(jax.vmap(fit.problem.space.values)(jnp.asarray(theta)))


def _ends(
    fit: FitData, at: np.ndarray, side: np.ndarray, error: np.ndarray, quantile: float
) -> np.ndarray:
    """Return where the deviation of a parameter is the quantile, for lanes (parameter, side).

    A distance along a lane is one of the parameter's free coordinate; the others follow to first
    order. Beyond `limit` the end is the bound.
    """
    space, lanes, error = fit.problem.space, np.arange(at.size), error[at]
    known = np.isfinite(error)
    # From its bound, which is far out, a parameter first returns to the middle.
    probe = np.where(known, quantile * np.where(known, error, 1), np.abs(fit._theta[at]))
    limit = np.where(space.has_unit[at], np.maximum(FARTHEST, 2 * probe), _FREE_FAR * probe)
    limit = np.where(known, limit, 2 * probe)
    stretch = space.stretch(fit.values)
    with np.errstate(invalid="ignore", divide="ignore"):
        together = fit.covariance[at] / np.diag(fit.covariance)[at, None]
        drift = np.nan_to_num(together * (stretch[at, None] / stretch), posinf=0, neginf=0)
    drift[lanes, at] = 1
    drift *= np.where(side > 0, 1.0, -1.0)[:, None]
    bound = np.where(side > 0, np.asarray(space.high)[at], np.asarray(space.low)[at])
    inside, inner = np.zeros((2, at.size))
    outside, outer = np.full(at.size, np.inf), np.full(at.size, np.nan)
    end, done = outer, np.zeros(at.size, bool)
    for _ in range(_ROUNDS):
        theta = fit._theta + drift * probe[:, None]
        held = np.full_like(theta, np.nan)
        held[lanes, at] = _values(fit, theta)[lanes, at]
        deviation, _ = held_at(fit, held, theta)
        below = deviation < quantile
        met, beyond = abs(deviation / quantile - 1) < _MET, below & (probe >= limit)
        end = np.where(done, end, np.where(met, held[lanes, at], np.where(beyond, bound, end)))
        done |= met | beyond
        if done.all():
            break
        # A failed probe counts as one that went too far.
        inside, inner = np.where(below, [probe, deviation], [inside, inner])
        outside, outer = np.where(below, [outside, outer], [probe, deviation])
        probe = np.minimum(_between(inside, inner, outside, outer, quantile), limit)
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
