"""Smooth functions g(e) on [0, 1] with parameters: rational, spline, network."""

from __future__ import annotations

import abc
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ..._entry import RESTITUTION, Range, as_parameter, require_count, require_number
from ..._functions import chebyshev
from ..._laws import Damped

_SHORTEST_SPLINE = 4
_BELOW_ONE = Range(low=0.0, high=1.0, high_open=True, inside=0.5)


class AbstractShape(eqx.Module):
    """A function g(e) > 0 that defines a law α = g(e) (1-e)/e; its arrays are its parameters.

    For the law that delivers exactly the requested e, g rises from 1 at e → 0 to 3/2 at e → 1.
    """

    @abc.abstractmethod
    def __call__(self, e: Float[Array, "..."]) -> Float[Array, "..."]:
        """Return g at e, of any shape."""

    def law(self, e: ArrayLike) -> Damped:
        """Return the law for e in (0, 1], with the damping factor α = g(e) (1-e)/e.

        Raises ValueError for a Python scalar out of range.
        """
        asked = as_parameter(e, "e", RESTITUTION)
        return Damped(alpha=self(asked) * (1 - asked) / asked)


class Rational(AbstractShape):
    """g(e) = Σ a_k T_k(t) / (1 + Σ b_k T_k(t)), t = 2e - 1: Chebyshev polynomials, one degree.

    `degree` is that of both. The start is linear in e: g = 1.25 + 0.25 t.
    """

    above: Float[Array, " degree_plus_1"]
    below: Float[Array, " degree"]

    def __init__(self, degree: int = 6):
        degree = require_count("degree", degree, 1)
        self.above = jnp.asarray(np.concatenate([[1.25, 0.25], np.zeros(degree - 1)]))
        self.below = jnp.zeros(degree)

    def __call__(self, e: Float[Array, "..."]) -> Float[Array, "..."]:
        t = 2 * e - 1
        below = jnp.concatenate([jnp.ones_like(self.below[:1]), self.below])
        return chebyshev(self.above, t) / chebyshev(below, t)


class Spline(AbstractShape):
    """g(e): a cubic spline with `intervals` equal intervals on [low, 1], from its B-spline weights.

    Outside, the polynomial of the last interval continues. Source: de Boor (1978), doi
    10.1007/978-1-4612-6333-3.
    """

    weights: Float[Array, " intervals_plus_3"]
    low: float = eqx.field(static=True)

    def __init__(self, intervals: int = 80, low: float = 0.0):
        intervals = require_count("intervals", intervals, _SHORTEST_SPLINE)
        self.weights = jnp.full(intervals + 3, 1.25)
        self.low = require_number("low", low, _BELOW_ONE)

    def __call__(self, e: Float[Array, "..."]) -> Float[Array, "..."]:
        intervals = self.weights.size - 3
        place = (e - self.low) / (1 - self.low) * intervals
        first = jnp.clip(jnp.floor(jax.lax.stop_gradient(place)), 0, intervals - 1)
        t = place - first
        base = first.astype(int)
        middle = 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1
        cubic = ((1 - t) ** 3, *middle, t**3)
        return sum(w * self.weights[base + k] for k, w in enumerate(cubic)) / 6  # pyright: ignore


class Network(AbstractShape):
    """g(e) = 1.25 + a small network of e: two hidden layers of `width` tanh.

    The same `seed` gives the same start.
    """

    network: eqx.nn.MLP

    def __init__(self, width: int = 8, seed: int = 0):
        width, seed = require_count("width", width, 1), require_count("seed", seed, 0)
        key = jax.random.key(seed)
        self.network = eqx.nn.MLP("scalar", "scalar", width, 2, jax.nn.tanh, key=key)

    def __call__(self, e: Float[Array, "..."]) -> Float[Array, "..."]:
        flat = jax.vmap(lambda e: self.network(2 * e - 1))(jnp.ravel(e))
        return 1.25 + flat.reshape(jnp.shape(e))


SHAPES: dict[str, Callable[[float], AbstractShape]] = {
    "rational": lambda low: Rational(),
    "spline": lambda low: Spline(low=low),
    "network": lambda low: Network(),
}
"""Initial shapes by name, for restitutions of at least `low`."""
