"""The posterior density of the free coordinates of a fit, its largest value, and the normal
approximation there.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..._program import quick
from ..problem.problem import FitProblem, shortened
from .prior import Prior, curvature


class Height(NamedTuple):
    """The log density, its gradient (m,), and minus the curvature (m, m) of the data's part."""

    value: Float[Array, ""]
    gradient: Float[Array, " m"]
    information: Float[Array, "m m"]


class Density(eqx.Module):
    """ln p(θ, ln σ | data) = -Σ ρ(z/σ) - n ln σ + ln p(θ), up to a constant.

    ρ(u) = u²/2, or Huber's; n is the number of points with weight. φ = (θ, ln σ) if the noise is
    `free`, with a prior flat in ln σ; otherwise φ = θ and σ = 1.
    """

    problem: FitProblem
    prior: Prior
    free: bool = eqx.field(static=True)

    def at(self, phi: Float[Array, " m"]) -> Height:
        """Return the height of the density, by the derivatives that the fit used.

        The density is zero where the prediction is not finite.
        """
        problem = self.problem
        k = len(problem.space.names)
        theta, scale = phi[:k], jnp.exp(phi[k]) if self.free else jnp.ones(())
        point = problem.at(theta)
        u, used = point.z / scale, problem.factor > 0
        limit = jnp.inf if problem.threshold is None else problem.threshold
        pull = jnp.clip(u, -limit, limit)
        slope = jnp.where(jnp.isfinite(point.jacobian), point.jacobian, 0) / scale
        before, drift = jax.value_and_grad(lambda at: self.prior(problem.space, at))(theta)
        value = before - jnp.sum(jnp.square(shortened(u, problem.threshold))) / 2
        gradient = drift - slope.T @ pull
        inside = slope * (jnp.abs(u) <= limit)[:, None]
        information = inside.T @ inside
        if self.free:
            count = jnp.sum(used).astype(float)
            value -= count * phi[k]
            gradient = jnp.append(gradient, jnp.sum(pull * u) - count)
            information = jax.scipy.linalg.block_diag(information, 2 * count)
        good = jnp.isfinite(value) & jnp.all(jnp.isfinite(gradient))
        gradient = jnp.where(good, gradient, 0)
        return Height(jnp.where(good, value, -jnp.inf), gradient, information)

    def __call__(self, phi: Float[Array, " m"]) -> Float[Array, ""]:
        """Return the log density, for a caller that differentiates it in either mode.

        A prediction may have forward derivatives only, which reverse mode could not use.
        """
        fixed = jax.lax.stop_gradient(phi)
        value, gradient, _ = jax.lax.stop_gradient(self.at(fixed))
        return value + gradient @ (phi - fixed)


@quick
def height(density: Density, phi: Float[Array, " m"]) -> tuple[Height, Float[Array, "k k"]]:
    """Return the height of a density, and the curvature of its prior."""
    space = density.problem.space
    return density.at(phi), curvature(density.prior, space, phi[: len(space.names)])


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
