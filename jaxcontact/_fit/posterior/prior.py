"""Prior knowledge of the parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..._entry import POSITIVE, rendered, require_number
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


def centre_of(prior: Prior, space: Space, place: int) -> float:
    """Return the free coordinate of the mean of a parameter, moved inside its bounds."""
    low, high = float(space.low[place]), float(space.high[place])
    inside = min(float(prior.width[place]), (high - low) / 4)
    value = float(np.clip(prior.mean[place], low + inside, high - inside))
    return space.coordinates[place].to_free(value, low, high)


def curvature(prior: Prior, space: Space, theta: Float[Array, " k"]) -> Float[Array, "k k"]:
    """Return the second derivative of minus the logarithm of the density."""
    return -jax.hessian(lambda at: prior(space, at))(theta)
