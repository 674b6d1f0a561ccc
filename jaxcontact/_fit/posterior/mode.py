"""The largest posterior density, and the normal approximation there."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from .density import Density, Height, height

_STEPS = 100
_GAIN = 1e-6
"""Predicted gain of the log density below which the search ends."""

_SHORTEST = 1e-3
"""Least scale of a logarithm or logit: smaller square roots of the curvature are not used."""

_FLOOR = 1e-13
"""Relative eigenvalue of a scaled curvature below which it is rounding."""


class Mode(NamedTuple):
    """The mode (m,), with a square root (m, m) of the covariance there.

    `prior` (k, k) is the part of the inverse covariance that comes from the prior, and `value` the
    logarithm of the density.
    """

    centre: Float[np.ndarray, " m"]
    root: Float[np.ndarray, "m m"]
    prior: Float[np.ndarray, "k k"]
    value: float = np.nan


def root_of(information: Float[np.ndarray, "m m"]) -> Float[np.ndarray, "m m"]:
    """Return a square root of the inverse, for any scales of the coordinates."""
    size = np.sqrt(np.abs(np.diag(information)))
    size = np.where(size > 0, size, 1)
    values, vectors = np.linalg.eigh(information / np.outer(size, size))
    values = np.maximum(np.abs(values), _FLOOR * np.abs(values).max())
    return vectors / np.sqrt(values) / size[:, None]


def find_mode(density: Density, start: Float[np.ndarray, " m"], held: int | None = None) -> Mode:
    """Find the mode by damped Gauss-Newton steps, which include the curvature of the prior.

    The coordinate `held` stays fixed.
    """
    free = np.arange(len(start)) != held
    unit = density.problem.space.has_unit
    unit = np.append(unit, True) if density.free else unit
    at, damping = np.asarray(start, float), 1e-3
    here, prior = _height(density, at)
    for _ in range(_STEPS):
        whole = _sum(here.information, prior) * np.where(np.outer(free, free), 1, 0)
        size = np.sqrt(np.abs(np.diag(whole)))
        size = np.where(unit, np.maximum(size, _SHORTEST), np.where(size > 0, size, 1))
        values, vectors = np.linalg.eigh(whole / np.outer(size, size))
        values = np.maximum(np.abs(values), _FLOOR * np.abs(values).max()) + damping
        along = vectors.T @ (here.gradient * free / size)
        step = free * (vectors @ (along / values) / size)
        if step @ here.gradient < _GAIN and damping < 1:
            break
        there, other = _height(density, at + step)
        if there.value > here.value:
            at, here, prior, damping = at + step, there, other, damping / 10
        else:
            damping *= 10
    return Mode(at, root_of(_sum(here.information, prior)), prior, float(here.value))


def _height(density: Density, at: Float[np.ndarray, " m"]) -> tuple[Height, np.ndarray]:
    return jax.tree.map(np.asarray, height(density, jnp.asarray(at)))


def _sum(information: Any, prior: np.ndarray) -> np.ndarray:
    whole = np.array(information)
    k = len(prior)
    whole[:k, :k] += np.where(np.isfinite(prior), prior, 0)
    return whole
