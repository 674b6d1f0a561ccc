"""The result of `fit_many`."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from ..._entry import rendered
from ..._text.failure import Flagged, WordedEnum
from ..._text.table import text_table
from ..result import Fit

_NAMED = 5
"""Largest number of failed balls that are listed."""


class FitStatus(WordedEnum):
    """The outcome for one ball of `fit_many`; from NOT_CONVERGED on they are failures, with NaN."""

    CONVERGED = 0, "Every parameter has a standard error."
    AT_BOUND = 1, "A parameter ran to its bound, and has no standard error."
    NOT_IDENTIFIABLE = 2, "A parameter has no standard error: the data do not determine it."
    NOT_CONVERGED = 3, "The search did not converge. Try another start, or more `max_steps`."
    NO_PREDICTION = 4, "The prediction, or its loss, is not finite at the start."
    TOO_FEW_POINTS = 5, "There are more numbers to fit than points that count."
    INVALID_INPUT = 6, "Data are not finite, or `sigma`, weights or the start are out of range."


@dataclasses.dataclass(frozen=True, repr=False)
class Fits(Flagged):
    """The fits of many balls, in the order of `balls`, their names.

    `params` has the structure of the start; each fitted number has a first axis of the balls.
    `names` and `values` (balls, k) list the numbers, and `covariance` (balls, k, k) and
    `standard_errors`, by name (balls,), are as those of a `Fit`. `loss`, `dof`, `noise` and `steps`
    are (balls,). `status` (balls,), see `FitStatus`, with `reasons` in words. A failed ball, where
    `ok` is False, has NaN and leaves the others as they are.
    """

    balls: np.ndarray
    params: Any
    names: tuple[str, ...]
    values: Float[np.ndarray, "balls k"]
    covariance: Float[np.ndarray, "balls k k"]
    loss: Float[np.ndarray, " balls"]
    dof: Int[np.ndarray, " balls"]
    noise: Float[np.ndarray, " balls"]
    steps: Int[np.ndarray, " balls"]
    status: Int[np.ndarray, " balls"]
    reasons: tuple[str, ...]
    _units: tuple[str, ...]
    _single: Callable[[int], Fit]

    _failures = tuple(s for s in FitStatus if s >= FitStatus.NOT_CONVERGED)

    @property
    def standard_errors(self) -> dict[str, Float[np.ndarray, " balls"]]:
        """The standard errors of each parameter; NaN where it has none."""
        errors = np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))
        return dict(zip(self.names, errors.T, strict=True))

    def fit(self, ball: Any) -> Fit:
        """Return the whole `Fit` of a ball, as `jc.fit` does, by its name.

        Raises ValueError for an unknown name, and for a ball without a fit.
        """
        places = np.flatnonzero(self.balls == ball)
        if len(places) != 1:
            raise ValueError(
                f"Argument `ball` must be one of `balls`, such as {self.balls.tolist()[0]!r}, but "
                f"is {rendered(ball)}."
            )
        i = int(places[0])
        if self.status[i] > FitStatus.NOT_CONVERGED:
            raise ValueError(f"Argument `ball` must have a fit, but {ball!r}: {self.reasons[i]}.")
        return self._single(i)

    def summary(self) -> str:
        """Return the number of balls of each status, and the spread of each parameter."""
        ok = np.asarray(self.ok)
        lines = [f"Fits of {len(ok):,} balls: {FitStatus.names_of(self.status)}"]
        rows = []
        for name, unit, column in zip(self.names, self._units, self.values.T, strict=True):
            good, errors = column[ok], self.standard_errors[name]
            errors = errors[np.isfinite(errors)]
            cells = [f"{x:.6g}" for x in np.quantile(good, [0.1, 0.5, 0.9])] if good.size else []
            error = [f"{np.median(errors):.2g}"] if errors.size else []
            rows.append([name, *(cells or ["-"] * 3), *(error or ["-"]), unit])
        head = ["", "10 %", "median", "90 %", "median ±", ""]
        lines += [line.rstrip() for line in text_table(rows, header=head, align="<>>>>", indent=2)]
        failed = np.flatnonzero(~ok)
        lines += [f"  ball {self.balls[i]}: {self.reasons[i]}" for i in failed[:_NAMED]]
        if len(failed) > _NAMED:
            lines.append(f"  and {len(failed) - _NAMED:,} more")
        return "\n".join(lines)

    __repr__ = summary
