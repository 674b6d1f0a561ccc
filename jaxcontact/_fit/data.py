"""The result of a fit, as plain data."""

from __future__ import annotations

import dataclasses
import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._entry import require_choice
from .._program import in_double, quick
from .._text.failure import Flagged
from .problem.problem import FitProblem, evaluated, flattened, place_like
from .search.verdict import Direction

_predicted = quick(evaluated)


class SharedErrors(NamedTuple):
    """Errors of n points with covariance V = diag(own) + R Rᵀ.

    `own` (n,) are the independent variances, and `root` R (n, m) the shared part.
    """

    own: Float[np.ndarray, " n"]
    root: Float[np.ndarray, "n m"]


@dataclasses.dataclass(frozen=True)
class FitData(Flagged):
    """The best parameters, their uncertainty, and the validity of the fit.

    `params` has the structure of the start; `names` and `values` (k,) list its fitted numbers.
    `loss` is ½ Σ z² (or Huber's) of the residuals z, and `history` (steps,) its course. `residuals`
    are prediction minus data, one vector. `converged`, with `reason` in words, and `steps` taken.

    `covariance` (k, k), `standard_errors` by name, `correlation` (k, k): Laplace's approximation,
    or the sandwich over groups of points if `by_group` is True. They are NaN for parameters that
    are not identifiable. `unidentified`: the changes of parameters that leave the prediction
    unchanged. `at_bound`: the names of parameters that ran to a bound; they have no standard error.
    `dof` are the degrees of freedom, and `noise` is the variance of z assumed by Laplace's standard
    errors. `starts` (lanes,) are the losses at which other starts ended.

    `adequate`: whether the model describes the data, None if undecided, and `adequacy`, the tests
    of it. `notes`: further results of a ready-made problem, in words.
    """

    params: Any
    names: tuple[str, ...]
    values: np.ndarray
    loss: float
    history: np.ndarray
    residuals: np.ndarray
    converged: bool
    reason: str
    steps: int
    covariance: np.ndarray
    unidentified: tuple[Direction, ...]
    at_bound: tuple[str, ...]
    dof: int
    noise: float
    starts: np.ndarray
    data: np.ndarray
    by_group: bool
    groups: np.ndarray | None = dataclasses.field(repr=False)
    problem: FitProblem = dataclasses.field(repr=False)
    _theta: np.ndarray = dataclasses.field(repr=False)
    _jacobian: np.ndarray = dataclasses.field(repr=False)
    _absolute: bool = dataclasses.field(repr=False)
    _rtol: float = dataclasses.field(repr=False)
    notes: tuple[str, ...] = ()
    _shared: SharedErrors | None = dataclasses.field(default=None, repr=False)
    """Errors of z of the points with weight, if they share errors that the weights ignore."""
    _wider: np.ndarray | None = dataclasses.field(default=None, repr=False)
    """The factor (k,) by which squared standard errors exceed those from the curvature of the loss.

    It is not None for shared errors and for poorly known noise.
    """

    @property
    def ok(self) -> Bool[Array, ""]:
        """`converged`, by its name in other results."""
        return jnp.asarray(self.converged)

    def _why(self) -> str | None:
        what = f"NOT CONVERGED, {self.reason}. Try another `start`, or more `max_steps`."
        return None if self.converged else what

    @property
    def errors(self) -> np.ndarray:
        """The standard errors (k,) in the order of `names`."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def standard_errors(self) -> dict[str, float]:
        """The standard error of each parameter; NaN if it is not identifiable."""
        return dict(zip(self.names, self.errors.tolist(), strict=True))

    @property
    def scaled_errors(self) -> np.ndarray:
        """The standard errors (k,) of the logarithms or logits of bounded parameters."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return self.errors / self.problem.space.stretch(self.values)

    @property
    def z(self) -> np.ndarray:
        """The whitened standardised residuals of the points with weight, in their order."""
        z = np.where(self._used, self.residuals, 0) * self._factor
        whitener = self.problem.whitener
        return (z if whitener is None else np.asarray(whitener) @ z)[self._used]

    @property
    def scatter(self) -> np.ndarray:
        """The standard deviation of each reading (n,); NaN for one without weight."""
        size = np.sqrt(self.noise) / np.where(self._used, self._factor, 1)
        return np.where(self._used, size, np.nan)

    @property
    def criteria(self) -> tuple[int, float, float]:
        """The number of identifiable parameters, AICc and BIC, as defined in `compare_fits`."""
        factor = self._factor[self._used]
        k = len(factor) - self.dof
        return k, *criteria_of(self.loss, k, factor, self._absolute)

    @property
    def has_trials(self) -> bool:
        """True if some group holds several points, whose errors may be correlated."""
        trials = self._trials
        return trials is not None and int(trials.max()) + 1 < len(trials)

    def why_no_error(self, name: str) -> str:
        """Return why a parameter has no standard error; ValueError for an unknown name."""
        require_choice("name", name, self.standard_errors)
        if self.dof < 1 and not self._absolute:
            return "without a standard error: no degree of freedom is left"
        known = [*self.at_bound, *(n for one in self.unidentified for n in one.components)]
        if not self.by_group or name in known or not np.isnan(self.standard_errors[name]):
            return "not identifiable"
        return "without a standard error: one point or group alone determines it"

    @property
    def _factor(self) -> np.ndarray:
        """The factor √w or 1/σ of each point."""
        return np.asarray(self.problem.factor)

    @property
    def _used(self) -> np.ndarray:
        """The mask of the points with weight."""
        return self._factor > 0

    @property
    def _trials(self) -> np.ndarray | None:
        """The number of the group of each point with weight; None without groups."""
        groups = None if self.groups is None else self.groups[self._used]
        return None if groups is None else np.unique(groups, return_inverse=True)[1]

    @property
    def correlation(self) -> np.ndarray:
        """The correlation (k, k) of the parameters."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return self.covariance / np.outer(self.errors, self.errors)

    def predict(self, x: Any = None) -> Any:
        """Return the prediction of the best parameters, at the data's x or at others."""
        with jax.enable_x64(True):
            return _predicted(self.problem.predict, self.params, self._place(x))

    def predict_with_error(self, x: Any = None) -> tuple[np.ndarray, np.ndarray]:
        """Return the flattened prediction (n,) and its standard error √(g Cov gᵀ).

        g is d prediction/dp. Parameters without a standard error count as known.
        """
        curve, slope = self.linearised(x)
        known = np.isfinite(np.diag(self.covariance))
        part = slope[:, known] @ self.covariance[np.ix_(known, known)]
        return curve, np.sqrt(np.sum(part * slope[:, known], axis=1))

    def linearised(self, x: Any = None) -> tuple[np.ndarray, np.ndarray]:
        """Return the flattened prediction (n,) and its derivative by the parameters (n, k)."""
        with in_double():
            values = jnp.asarray(self.values)
            slope, curve = _linearised(self.problem, values, self._place(x))
        return np.asarray(curve), np.asarray(slope)

    def _place(self, x: Any) -> Any:
        return self.problem.x if x is None else place_like(x, self.problem.x)


def criteria_of(
    loss: float, k: int, factor: Float[np.ndarray, " n"], absolute: bool
) -> tuple[float, float]:
    """Return AICc and BIC of ½ Σ z² with k parameters; z are residuals times `factor`."""
    n = len(factor)
    if absolute:
        deviance, counted = 2 * loss, k
    else:
        # Data without noise are fitted exactly; the logarithm needs a positive number. The sum of
        # the logarithms of the weights cancels their common scale.
        scale = 2 * float(np.sum(np.log(factor)))
        deviance, counted = n * math.log(max(2 * loss / n, 1e-300)) - scale, k + 1
    small = 2 * counted * (counted + 1) / (n - counted - 1) if n > counted + 1 else math.inf
    return deviance + 2 * counted + small, deviance + counted * math.log(n)


def require_converged(fit: FitData, what: str) -> None:
    """Raise ValueError for a fit that did not converge, which has no `what`."""
    if not fit.converged:
        raise ValueError(f"A fit that did not converge has no {what}: {fit.reason}.")


@quick
def _linearised(problem: FitProblem, values: jax.Array, x: Any) -> tuple[jax.Array, jax.Array]:
    def at(values: jax.Array) -> tuple[jax.Array, jax.Array]:
        curve = flattened(evaluated(problem.predict, problem.space.tree_of(values), x))
        return curve, curve

    return problem.jacobian(at, values)
