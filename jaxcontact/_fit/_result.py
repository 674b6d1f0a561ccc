"""What `fit` returns."""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike

from ._bootstrap import Bootstrap, bootstrap
from ._inference import Direction
from ._problem import Problem, evaluated
from ._profile import Profile, profile


@dataclasses.dataclass(frozen=True)
class Fit:
    """A fit: the best parameters, how sure they are, and whether to trust them.

    `params` has the structure of the start; `names` and `values` (k,) list its fitted numbers.
    `loss` is ½ Σ z² (or Huber's) of the residuals z, and `history` (steps,) its course; `residuals`
    are prediction minus data, one vector. `converged`, and `reason` in words; `steps` taken.

    `covariance` (k, k), `standard_errors` by name, `correlation` (k, k): Laplace's approximation,
    NaN for what the data do not determine. `unidentified`: the changes of parameters that the data
    do not see. `at_bound`: the names of numbers that ran to a bound, which have no standard error.
    `dof` are the degrees of freedom, `noise` is the variance of z that standard errors assume.
    `starts` (lanes,) are the losses that other starts ended with.
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
    problem: Problem = dataclasses.field(repr=False)
    theta: np.ndarray = dataclasses.field(repr=False)
    absolute: bool = dataclasses.field(repr=False)
    rtol: float = dataclasses.field(repr=False)

    @property
    def standard_errors(self) -> dict[str, float]:
        """One standard deviation of each fitted number; NaN where the data do not determine it."""
        return dict(zip(self.names, self._errors.tolist(), strict=True))

    @property
    def _errors(self) -> np.ndarray:
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> np.ndarray:
        """The correlation (k, k) of the fitted numbers."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return self.covariance / np.outer(self._errors, self._errors)

    def predict(self, x: Any = None) -> Any:
        """The prediction of the best parameters, at the data's x or at others."""
        with jax.enable_x64(True):
            at = self.problem.x if x is None else jax.tree.map(jnp.asarray, x)
            return evaluated(self.problem.predict, self.params, at)

    def bootstrap(self, draws: int = 200, *, seed: int = 0) -> Bootstrap:
        """Fit data simulated from this fit: its prediction plus normal noise of its size.

        Returns a `Bootstrap`: parameters (draws, k), their spread and percentile intervals. Draws
        that did not converge are flagged and left out. Raises ValueError where the size of the
        noise is unknown, or this fit did not converge.
        Source: Efron & Tibshirani (1993), doi 10.1201/9780429246593.
        """
        return bootstrap(self, draws, seed)

    def profile(
        self, name: str, values: ArrayLike | None = None, *, points: int = 41, span: float = 4.0
    ) -> Profile:
        """The profile likelihood of one number: the best loss with it held at each of `values`.

        By default `points` values over `span` standard errors to both sides, inside the bounds.
        Returns a `Profile`, whose `interval(level)` needs no normal approximation. Raises
        ValueError for an unknown name, one without a standard error if no values are given, and a
        fit that did not converge. Source: Venzon & Moolgavkar (1988), doi 10.2307/2347496.
        """
        return profile(self, name, values, points, span)

    def summary(self) -> str:
        """The fit in words, a line for each number."""
        good = "converged" if self.converged else "NOT CONVERGED"
        lines = [f"Fit: {good} after {self.steps} steps, {self.reason}"]
        lines += [
            f"  loss {self.loss:.6g}, {np.count_nonzero(self.problem.factor)} points, "
            f"{self.dof} degrees of freedom"
        ]
        width = max(map(len, self.names))
        for name, value, error in zip(self.names, self.values, self._errors, strict=True):
            if not self.converged:
                said = ""
            elif name in self.at_bound:
                said = "  at its bound"
            elif np.isnan(error):
                lone = self.dof < 1 and not self.absolute
                said = (
                    "  no degree of freedom is left for its error"
                    if lone
                    else ("  not determined by the data")
                )
            else:
                said = f"  ± {error:.2g}"
            lines.append(f"  {name:{width}}  {value:.9g}{said}")
        for direction in self.unidentified:
            lines.append(f"  the data do not see a change of {direction}")
        return "\n".join(lines)

    def __repr__(self) -> str:
        return self.summary()
