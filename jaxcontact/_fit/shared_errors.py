"""Errors that readings share but that must not enter the weights.

If the weights include this correlation, the fit cancels part of the error and reports standard
errors that are too small. Such a fit weights its points as if they were independent. Only standard
errors, intervals and adequacy include the correlation.
"""

from __future__ import annotations

import dataclasses
from typing import TypeVar

import numpy as np

from .data import FitData, SharedErrors
from .search.minimum import SINGULAR

_F = TypeVar("_F", bound=FitData)


def with_shared(fit: _F, shared: SharedErrors) -> _F:
    """Return the fit with standard errors for z of the errors `shared`, of the points with weight.

    Cov θ = H V Hᵀ, with H the pseudoinverse of J = dz/dθ. Intervals widen as the errors do.
    """
    jacobian = fit._jacobian[np.asarray(fit.problem.factor) > 0]
    length = np.linalg.norm(jacobian, axis=0)
    moves = (length > 0) & ~np.isin(fit.names, fit.at_bound)
    inverse = np.zeros((len(length), len(jacobian)))
    inverse[moves] = np.linalg.pinv(jacobian[:, moves] / length[moves], rcond=SINGULAR)
    inverse[moves] /= length[moves, None]
    stretch = fit.problem.space.stretch(fit.values)
    together = inverse @ shared.root
    covariance = (inverse * shared.own) @ inverse.T + together @ together.T
    covariance *= np.outer(stretch, stretch)
    covariance = np.where(np.isfinite(fit.covariance), covariance, np.nan)
    with np.errstate(invalid="ignore", divide="ignore"):
        wider = np.diag(covariance) / np.diag(fit.covariance)
    wider = np.where(np.isfinite(wider), wider, 1.0)
    return dataclasses.replace(fit, covariance=covariance, _shared=shared, _wider=wider)
