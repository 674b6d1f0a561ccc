"""What `fit` returns: its outcome, and the methods that go on from it."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import ArrayLike

from ._bootstrap import Bootstrap, bootstrap
from ._data import FitData
from ._profile import Profile, profile


@dataclasses.dataclass(frozen=True, repr=False)
class Fit(FitData):
    __doc__ = FitData.__doc__

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
        """The profile likelihood of one parameter: the lowest loss with it held at each value.

        By default `points` values over `span` standard errors to both sides, inside the bounds.
        Returns a `Profile`, whose `interval(level)` needs no normal approximation. Raises
        ValueError for an unknown name, one without a standard error if no values are given, and a
        fit that did not converge. Source: Venzon & Moolgavkar (1988), doi 10.2307/2347496.
        """
        return profile(self, name, values, points, span)

    def summary(self) -> str:
        """The fit in words, a line for each parameter."""
        good = "converged" if self.converged else "NOT CONVERGED"
        points = np.count_nonzero(self.problem.factor)
        lines = [
            f"Fit: {good} in {self.steps} steps, {self.reason}",
            f"  loss {self.loss:.6g}, {points} points, {self.dof} degrees of freedom",
        ]
        width = max(map(len, self.names))
        lines += [
            f"  {name:{width}}  {value:.9g}{self._certainty(name)}"
            for name, value in zip(self.names, self.values, strict=True)
        ]
        lines += [f"  not identifiable: a change of {d}" for d in self.unidentified]
        return "\n".join(lines)

    def _certainty(self, name: str) -> str:
        if not self.converged:
            return ""
        if name in self.at_bound:
            return "  at its bound"
        error = self.standard_errors[name]
        if not np.isnan(error):
            return f"  ± {error:.2g}"
        if self.dof < 1 and not self.absolute:
            return "  without a standard error: no degree of freedom is left"
        return "  not identifiable"

    def __repr__(self) -> str:
        return self.summary()
