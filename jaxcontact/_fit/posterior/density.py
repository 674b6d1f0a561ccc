"""The prior and the posterior density of the free coordinates of a fit, its largest value, and the
normal approximation there.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..._entry import POSITIVE, rendered, require_number
from ..._program import quick
from ..problem.problem import FitProblem, shortened
from ..problem.space import Space


class Prior(eqx.Module):
    """A normal density for the parameters that are `given`, or a `density` of all of them.

    Both are densities of the parameters x themselves: p(θ) = p(x) |dx/dθ|. A coordinate without one
    is flat in θ.
    """

    given: Bool[Array, " k"]
    mean: Float[Array, " k"]
    width: Float[Array, " k"]
    density: Callable[[Any], Any] | None = None

    def __call__(self, space: Space, theta: Float[Array, " k"]) -> Float[Array, ""]:
        """Return the logarithm of the density of the free coordinates, up to a constant."""
        values, slopes = space.values(theta), space.log_slopes(theta)
        if self.density is not None:
            known = jnp.asarray(self.density(space.tree_of(values)))
            if known.shape != () or not jnp.issubdtype(known.dtype, jnp.floating):
                raise ValueError(
                    "Argument `prior` must return one real number, the logarithm of a density, but "
                    f"returns the shape {known.shape} of type {known.dtype}."
                )
            return known.astype(float) + jnp.sum(slopes)
        off = jnp.where(self.given, values - self.mean, 0) / self.width
        return jnp.sum(jnp.where(self.given, slopes - jnp.square(off) / 2, 0))


def prior_of(prior: Any, space: Space) -> Prior:
    """Return a prior from None, a dict of (mean, standard deviation), or a function of params."""
    k = len(space.names)
    given, mean, width = np.zeros(k, bool), np.zeros(k), np.ones(k)
    if isinstance(prior, Mapping):
        for name, pair in prior.items():
            if name not in space.names:
                raise ValueError(
                    f"Argument `prior` must name fitted numbers, {', '.join(space.names)}, but "
                    f"names {rendered(name)}."
                )
            if not isinstance(pair, tuple | list) or len(pair) != 2:
                raise ValueError(
                    f"Argument `prior` must hold (mean, standard deviation) for {name}, but holds "
                    f"{rendered(pair)}."
                )
            i = space.names.index(name)
            given[i] = True
            mean[i] = require_number("prior", pair[0])
            width[i] = require_number("prior", pair[1], POSITIVE)
    elif prior is not None and (not callable(prior) or isinstance(prior, type)):
        raise ValueError(
            "Argument `prior` must be None, a dict of (mean, standard deviation) by name, or a "
            f"function of the parameters, but is {rendered(prior)}."
        )
    density = prior if callable(prior) else None
    return Prior(jnp.asarray(given), jnp.asarray(mean), jnp.asarray(width), density)


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
        pull = jnp.clip(u, -problem.limit, problem.limit)
        slope = jnp.where(jnp.isfinite(point.jacobian), point.jacobian, 0) / scale
        before, drift = jax.value_and_grad(lambda at: self.prior(problem.space, at))(theta)
        value = before - jnp.sum(jnp.square(shortened(u, problem.threshold))) / 2
        gradient = drift - slope.T @ pull
        inside = slope * (jnp.abs(u) <= problem.limit)[:, None]
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
    theta = phi[: len(space.names)]
    return density.at(phi), -jax.hessian(lambda at: density.prior(space, at))(theta)


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
    """Find the mode, with one coordinate `held`, by damped Gauss-Newton steps with the prior."""
    free = np.arange(len(start)) != held
    unit = density.problem.space.has_unit
    unit = np.append(unit, True) if density.free else unit
    at, damping = np.asarray(start, float), 1e-3

    def height_at(at: np.ndarray) -> tuple[Height, np.ndarray, np.ndarray]:
        """Return the height, the curvature of the prior, and that of both together."""
        here, prior = jax.tree.map(np.asarray, height(density, jnp.asarray(at)))
        whole, k = np.array(here.information), len(prior)
        whole[:k, :k] += np.where(np.isfinite(prior), prior, 0)
        return here, prior, whole

    here, prior, both = height_at(at)
    for _ in range(_STEPS):
        whole = both * np.outer(free, free)
        size = np.sqrt(np.abs(np.diag(whole)))
        size = np.where(unit, np.maximum(size, _SHORTEST), np.where(size > 0, size, 1))
        values, vectors = np.linalg.eigh(whole / np.outer(size, size))
        values = np.maximum(np.abs(values), _FLOOR * np.abs(values).max()) + damping
        along = vectors.T @ (here.gradient * free / size)
        step = free * (vectors @ (along / values) / size)
        if step @ here.gradient < _GAIN and damping < 1:
            break
        there, *curvatures = height_at(at + step)
        if there.value > here.value:
            at, here, damping, (prior, both) = at + step, there, damping / 10, curvatures
        else:
            damping *= 10
    return Mode(at, root_of(both), prior, float(here.value))
