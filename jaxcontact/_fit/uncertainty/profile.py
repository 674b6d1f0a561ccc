"""The profile likelihood of one parameter."""

from __future__ import annotations

import dataclasses
import math
import statistics

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float

from ..._entry import (
    FRACTION,
    POSITIVE,
    as_numbers,
    rendered,
    require_choice,
    require_count,
    require_number,
)
from ..._program import quick
from ..data import FitData
from ..problem.problem import FitProblem
from ..search.levenberg_marquardt import SearchOptions
from ..search.minimum import found_from
from ..search.verdict import creeping

_STEPS = 100


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
    if not fit.converged:
        raise ValueError(f"A fit that did not converge has no profile: {fit.reason}.")
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
            raise ValueError(
                f"Argument `values` must be finite and in ({low:g}, {high:g}), at least one, but "
                f"is {rendered(values)}."
            )
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
    loss, converged, step = _refit(fit, held, starts)
    out = creeping(fit.problem.space, step) & np.isnan(held) & ~converged[:, None]
    if out.any():
        bound = np.where(step > 0, fit.problem.space.high, fit.problem.space.low)
        there, met, _ = _refit(fit, np.where(out, bound, held), starts)
        # Lanes without a creeping coordinate are unchanged.
        better = met & (there <= loss)
        loss, converged = np.where(better, there, loss), better | converged
    loss = np.where(converged, loss, np.nan)
    # The rise of twice the loss at one standard error. The curvature of Huber's loss is mean ψ'
    # times that of squares.
    unit, threshold = fit.noise, fit.problem.threshold
    if threshold is not None:
        unit *= float(np.mean(np.abs(fit.z) <= float(threshold)))
    if fit._wider is not None:
        # A lane holds the one parameter that it profiles.
        unit = unit * fit._wider[np.argmax(~np.isnan(held), axis=1)]
    with np.errstate(invalid="ignore"):
        return np.sqrt(2 * np.maximum(loss - fit.loss, 0) / unit), loss


def _refit(fit: FitData, held: np.ndarray, starts: np.ndarray) -> tuple[np.ndarray, ...]:
    with jax.enable_x64(True), jax.numpy_dtype_promotion("standard"):
        options = SearchOptions(jnp.asarray(fit._rtol), max_steps=_STEPS)
        found = _held(fit.problem, jnp.asarray(held), jnp.asarray(starts), options)
    return tuple(map(np.asarray, found))


@quick
def _held(
    problem: FitProblem,
    held: Float[Array, "lanes k"],
    starts: Float[Array, "lanes k"],
    options: SearchOptions,
) -> tuple[Float[Array, " lanes"], Bool[Array, " lanes"], Float[Array, "lanes k"]]:
    """Return the losses, which of them have converged, and the remaining steps."""

    def one(held: Float[Array, " k"], start: Float[Array, " k"]) -> tuple[Array, Array, Array]:
        found = found_from(eqx.tree_at(lambda p: p.space.held, problem, held), start, options)
        good = jnp.all(found.still) & jnp.isfinite(found.loss)
        return found.loss, good, found.step

    return jax.vmap(one)(held, starts)
