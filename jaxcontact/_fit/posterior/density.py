"""The posterior density of the free coordinates of a fit."""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..._program import quick
from ..problem.loss import shortened
from ..problem.problem import FitProblem
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
