"""The one loop of fits whose errors follow from their own residuals, and unknown noise of each
column, and of robust fits. Common noise of squares follows in `infer`.
"""

from __future__ import annotations

import abc
import dataclasses
from collections.abc import Callable
from typing import ClassVar, Generic, TypeVar

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int

from ..data import FitData, SharedErrors
from ..problem.problem import FitProblem
from .minimum import SearchEnd, basis_of, decomposed

F = TypeVar("F")
E = TypeVar("E")

_F = TypeVar("_F", bound=FitData)


class AbstractErrors(abc.ABC, Generic[F, E]):
    """A model of errors: it estimates them from a fit F, as what the next fit needs, E.

    Sizes of noise, correlations and points left out are such errors. An object serves one `refit`,
    and keeps what it needs from round to round.
    """

    rounds: ClassVar[int]
    """Largest number of refits."""

    @abc.abstractmethod
    def estimate(self, found: F) -> E | None:
        """Return the errors by the residuals of a fit; None if they have settled."""

    def finish(self, found: F) -> F:
        """Return the last fit with what the errors change in it: notes, standard errors."""
        return found


def refit(errors: AbstractErrors[F, E], found: F, search: Callable[[F, E], F]) -> F:
    """Estimate the errors and fit again by `search(last, errors)`, in turns, until they settle."""
    for _ in range(errors.rounds):
        estimated = errors.estimate(found)
        if estimated is None:
            break
        found = search(found, estimated)
    return errors.finish(found)


COMMON, BY_COLUMN = "common", "by column"

_SAME = 1e-3
"""Relative change of the noise at convergence."""

_MEDIAN_OF_NORMAL = 0.6744897501960817

_LEAST = 1e-6
"""Least noise of a column relative to its scatter, which limits the weight of exact data."""


def refuse_between(
    columns: Int[np.ndarray, " n"], whitener: Float[np.ndarray, "n n"] | None
) -> None:
    """Raise ValueError for errors correlated between columns that have their own noise."""
    if whitener is not None and whitener[columns[:, None] != columns].any():
        raise ValueError(
            "Argument `noise` must be 'common' with a `correlation` between columns, but is "
            "'by column'."
        )


class ColumnErrors(AbstractErrors[SearchEnd, FitProblem]):
    """The noise of each column, estimated with the fit; `settled` if it no longer changes.

    For squares: σ_c² = Σ_c r²/(n_c - Σ_c h), with h the leverage of each point in the fit with
    these σ. There the restricted likelihood is largest (Patterson & Thompson 1971, doi
    10.1093/biomet/58.3.545). For Huber's loss: the median of |residuals|.
    """

    rounds = 30

    def __init__(self, problem: FitProblem, columns: Int[np.ndarray, " n"]):
        self.problem, self.columns, self.settled = problem, columns, False
        self._relative = np.asarray(problem.factor)
        self._used = self._relative > 0
        self._inside = self._used & (columns == np.arange(columns.max() + 1)[:, None])
        # The scatter of the data of each column, in units of what the fit assumed.
        parts = [(np.asarray(problem.y) * self._relative)[rows] for rows in self._inside]
        self._least = np.array([part.std() if part.size else 0.0 for part in parts]) * _LEAST
        self._scale = None

    def estimate(self, found: SearchEnd) -> FitProblem | None:
        """Return the problem with the weights of the new noise."""
        if not np.isfinite(found.loss):
            return None
        last = np.ones(self._least.size) if self._scale is None else self._scale
        seen = last * self._sizes(found)
        new = np.maximum(seen, self._least)
        same = self._scale is not None and np.all(np.abs(new - last) <= _SAME * new)
        # If no column shows noise, the weights cannot improve.
        self.settled = bool(same or not (seen > self._least).any())
        if self.settled:
            return None
        self._scale = np.where(new > 0, new, last)
        factor = self._relative / self._scale[self.columns]
        self.problem = eqx.tree_at(lambda p: p.factor, self.problem, factor)
        return self.problem

    def _sizes(self, found: SearchEnd) -> Float[np.ndarray, " columns"]:
        """Return the noise of each column in units of what the fit assumed."""
        used, inside = self._used, self._inside
        if self.problem.threshold is not None:
            medians = [np.median(np.abs(found.z[rows])) if rows.any() else 0.0 for rows in inside]
            return np.array(medians) / _MEDIAN_OF_NORMAL
        leverage = np.zeros(used.size)
        leverage[used] = np.sum(basis_of(found.jacobian[used]) ** 2, axis=1)
        free = np.array([rows.sum() - leverage[rows].sum() for rows in inside])
        squares = np.array([np.sum(found.z[rows] ** 2) for rows in inside])
        return np.sqrt(np.where(free > _SAME, squares / np.maximum(free, _SAME), 0))


def with_shared(fit: _F, shared: SharedErrors) -> _F:
    """Return the fit with standard errors for z of the errors `shared`, of the points with weight.

    Cov θ = H V Hᵀ, with H the pseudoinverse of J = dz/dθ. Intervals widen as the errors do.
    If the weights included this correlation, the fit would cancel part of the error and report
    standard errors that are too small. So it weights its points as if they were independent. Only
    standard errors, intervals and adequacy include the correlation.
    """
    u, s, vt, scale, _, kept = decomposed(fit._jacobian[fit._used])
    inverse = (vt[kept].T / s[kept]) @ u[:, kept].T / scale[:, None]
    stretch = fit.problem.space.stretch(fit.values)
    together = inverse @ shared.root
    covariance = (inverse * shared.own) @ inverse.T + together @ together.T
    covariance *= np.outer(stretch, stretch)
    covariance = np.where(np.isfinite(fit.covariance), covariance, np.nan)
    with np.errstate(invalid="ignore", divide="ignore"):
        wider = np.diag(covariance) / np.diag(fit.covariance)
    wider = np.where(np.isfinite(wider), wider, 1.0)
    return dataclasses.replace(fit, covariance=covariance, _shared=shared, _wider=wider)
