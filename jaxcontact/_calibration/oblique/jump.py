"""A lowest loss at a jump of the slope of an outcome, where no search by derivatives ends."""

from __future__ import annotations

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..._fit import Fit, FitData

_TRIED = 96
_WIDE, _CLOSE = 0.3, 1e-10
"""Largest and smallest change of a coordinate that is tried."""

_ROUNDS = 4
"""Rounds in which differences over one standard error give the standard error."""

_FAR = 0.05
_LEAST = 1e-4

REASON = "no lower loss was found around a jump of slope"
NOTE = (
    "at the best parameters an outcome changes between sticking and sliding; their standard errors "
    "are from differences over one standard error"
)


@eqx.filter_jit
def _residuals(problem: eqx.Module, thetas: Float[Array, "lanes k"]) -> Float[Array, "lanes n"]:
    return jax.vmap(problem.residual)(thetas)  # pyright: ignore[reportAttributeAccessIssue]


def lowest_around(found: FitData) -> np.ndarray:
    """Return the coordinates (k,) of the lowest loss around the end of a search.

    Changes in random directions are tried, whose size halves whenever none of them is better.
    """
    random, theta = np.random.default_rng(0), found._theta
    size, best = _WIDE, np.inf
    while size > _CLOSE:
        away = random.normal(size=(_TRIED, len(theta)))
        away *= size * random.uniform(size=(_TRIED, 1)) / np.linalg.norm(away, axis=1)[:, None]
        lanes = theta + np.concatenate([np.zeros((1, len(theta))), away])
        loss = np.sum(np.square(residuals_at(found, lanes)), axis=1)
        i = int(np.nanargmin(loss))
        if loss[i] < best * (1 - 1e-13):
            theta, best = lanes[i], loss[i]
        else:
            size /= 2
    return theta


def residuals_at(found: FitData, lanes: np.ndarray) -> np.ndarray:
    """Return the standardised residuals (lanes, n) at coordinates (lanes, k)."""
    with jax.enable_x64(True), jax.numpy_dtype_promotion("standard"):
        return np.asarray(_residuals(found.problem, jnp.asarray(lanes)))


def at_jump(found: Fit) -> Fit:
    """Return a fit at the lowest loss around the end of its search, as converged.

    The curvature of the loss is that of differences over one standard error to both sides, because
    the slopes of the two sides differ.
    """
    theta = lowest_around(found)
    k = len(theta)
    points = int(np.count_nonzero(np.asarray(found.problem.factor)))
    z = residuals_at(found, theta[None])[0]
    noise = 1.0 if found._absolute else float(np.sum(z**2)) / max(points - k, 1)
    step, covariance = np.full(k, _FAR), np.full((k, k), np.nan)
    jacobian = np.zeros((len(z), k))
    for _ in range(_ROUNDS):
        sides = residuals_at(found, np.concatenate([theta + np.diag(step), theta - np.diag(step)]))
        jacobian = ((sides[:k] - sides[k:]) / (2 * step[:, None])).T
        square = jacobian.T @ jacobian
        if np.linalg.matrix_rank(square) < k:
            break
        covariance = noise * np.linalg.inv(square)
        step = np.clip(np.sqrt(np.diag(covariance)), _LEAST, 1.0)
    with jax.enable_x64(True), jax.numpy_dtype_promotion("standard"):
        values = np.asarray(found.problem.space.values(jnp.asarray(theta)))
        params = found.problem.space.tree_of(jnp.asarray(values))
        prediction = np.asarray(found.problem.prediction(jnp.asarray(theta)))
    stretch = found.problem.space.stretch(values)
    used = np.asarray(found.problem.factor) > 0
    return dataclasses.replace(
        found,
        params=params,
        values=values,
        loss=float(np.sum(z**2)) / 2,
        residuals=np.where(used, prediction - np.asarray(found.problem.y), np.nan),
        converged=True,
        reason=REASON,
        covariance=covariance * np.outer(stretch, stretch),
        dof=points - k,
        noise=noise,
        notes=(*found.notes, NOTE),
        _theta=theta,
        _jacobian=jacobian,
    )
