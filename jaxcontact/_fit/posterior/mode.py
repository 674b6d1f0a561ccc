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
"""A step that promises less of the log density is none."""

_SHORTEST = 1e-3
"""Curvature of a logarithm or a logit below the square of this is no scale of it."""

_FLOOR = 1e-13
"""Of the largest eigenvalue of a scaled curvature: what is smaller is rounding."""


class Mode(NamedTuple):
    """The largest density (m,), a square root (m, m) of the covariance there, what of its inverse
    comes from the prior (k, k), and the logarithm of the density.
    """

    centre: Float[np.ndarray, " m"]
    root: Float[np.ndarray, "m m"]
    prior: Float[np.ndarray, "k k"]
    value: float = np.nan


def root_of(information: Float[np.ndarray, "m m"]) -> Float[np.ndarray, "m m"]:
    """A square root of the inverse, which has any scales."""
    size = np.sqrt(np.abs(np.diag(information)))
    size = np.where(size > 0, size, 1)
    values, vectors = np.linalg.eigh(information / np.outer(size, size))
    values = np.maximum(np.abs(values), _FLOOR * np.abs(values).max())
    return vectors / np.sqrt(values) / size[:, None]


def find_mode(density: Density, start: Float[np.ndarray, " m"], held: int | None = None) -> Mode:
    """Climb by damped Gauss-Newton steps, to which the prior adds its own curvature.

    The coordinate `held` stays where it is.
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
