"""The verdict and the standard errors of many ends at once, where they are plain."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..problem.problem import FitProblem
from ..search.minimum import SINGULAR, SearchEnd
from ..search.verdict import creeping, near_bound
from .tables import Tables


class Assessed(NamedTuple):
    """Which ends are `plain`: converged, away from bounds, with all parameters determined.

    Their covariance, degrees of freedom and noise are those of `infer`; others are NaN or 0.
    """

    plain: Bool[np.ndarray, " B"]
    covariance: Float[np.ndarray, "B k k"]
    dof: Int[np.ndarray, " B"]
    noise: Float[np.ndarray, " B"]


def assess(
    shared: FitProblem, tables: Tables, ends: SearchEnd, theta: Float[np.ndarray, "B k"]
) -> Assessed:
    """Return the verdict on every end."""
    space, k = shared.space, theta.shape[1]
    finite = np.isfinite(ends.jacobian).all(axis=(1, 2)) & np.isfinite(ends.loss)
    jacobian = np.where(finite[:, None, None], ends.jacobian, 0)
    length = np.linalg.norm(jacobian, axis=1)
    scaled = jacobian / np.where(length > 0, length, 1)[:, None, :]
    if scaled.shape[1] < k:
        scaled = np.concatenate([scaled, np.zeros((len(scaled), k - scaled.shape[1], k))], axis=1)
    _, s, vt = np.linalg.svd(scaled, full_matrices=False)
    ranked = (length > 0).all(axis=1) & (s > SINGULAR * s.max(axis=1, keepdims=True)).all(axis=1)
    below, above = near_bound(space, ends, theta)
    aside = below | above | creeping(space, ends.step) | ~ends.still
    plain = finite & ranked & ~aside.any(axis=1)

    used = tables.factor > 0
    threshold = np.inf if shared.threshold is None else float(shared.threshold)
    size = np.abs(ends.z)
    inside = np.sum(used & (size <= threshold), axis=1) / np.maximum(used.sum(axis=1), 1)
    dof = np.where(plain, used.sum(axis=1) - k, 0)
    with np.errstate(all="ignore"):
        squares = np.sum(np.where(used, np.minimum(size, threshold), 0) ** 2, axis=1)
        noise = squares / dof / inside**2
        basis = np.swapaxes(vt, 1, 2) / s[:, None, :] / length[:, :, None]
        stretch = space.stretch(ends.values.T).T
        if tables.absolute and shared.threshold is None:
            noise = np.ones_like(noise)
        else:
            noise = np.where((dof > 0) & (inside > 0), noise, np.nan)
        covariance = noise[:, None, None] * (basis @ np.swapaxes(basis, 1, 2))
        covariance = covariance * stretch[:, :, None] * stretch[:, None, :]
    covariance = np.where(plain[:, None, None], covariance, np.nan)
    return Assessed(plain, covariance, dof, np.where(plain, noise, np.nan))
