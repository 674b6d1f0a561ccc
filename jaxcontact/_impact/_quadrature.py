"""Quadrature on [0, 1] for integrands that blow up like a known power at one end or at both."""

from __future__ import annotations

import functools

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.special import beta, roots_jacobi

Exponent = float | Float[Array, "..."]


def end_rule(
    strength: Exponent, like: Float[Array, "..."], count: int
) -> tuple[Float[Array, "... nodes"], Float[Array, "... nodes"]]:
    """Nodes u and weights w with `∫_0^1 u^(-strength) g(u) du = Σ w g(u)` for a smooth g.

    `strength` < 1; `like` gives precision and rank. A Python float gets the Gauss-Jacobi rule with
    `count` nodes. An array gets a rule with four times as many, differentiable in the strength:
    `u = r^(1/(1-s))` takes the singularity away, whatever its strength, and a double-exponential
    rule in r copes with the fractional power that g then contains.
    """
    if isinstance(strength, float | int):
        nodes, weights = _gauss_jacobi(float(strength), 0.0, count)
        shape = (1,) * like.ndim + (count,)
        return (
            jnp.asarray(nodes, like.dtype).reshape(shape),
            jnp.asarray(weights, like.dtype).reshape(shape),
        )
    r, weight = _double_exponential(4 * count)
    stretch = 1 / (1 - strength[..., None])
    shape = (1,) * strength.ndim + (r.size,)
    log_r = jnp.asarray(np.log(r), like.dtype).reshape(shape)
    return jnp.exp(stretch * log_r), stretch * jnp.asarray(weight, like.dtype).reshape(shape)


@functools.lru_cache
def _gauss_jacobi(start: float, end: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and weights for the weight u^(-start) (1-u)^(-end) on [0, 1]."""
    x, w = roots_jacobi(count, -end, -start)
    # The library's weights are a few 1e-14 off in sum, which is known exactly.
    return (1 + x) / 2, w * (beta(1 - start, 1 - end) / w.sum())


@functools.lru_cache
def _double_exponential(count: int) -> tuple[np.ndarray, np.ndarray]:
    """The tanh-sinh rule on [0, 1], its nodes given without cancellation near 0."""
    # Beyond 3.15 the weights are below an ulp of float64.
    t = np.linspace(-3.15, 3.15, count)
    x = np.pi / 2 * np.sinh(t)
    nodes = 1 / (1 + np.exp(-2 * x))
    weights = np.pi / 2 * np.cosh(t) / (2 * np.cosh(x) ** 2) * (t[1] - t[0])
    return nodes, weights / weights.sum()


def with_exponent(number: Float[Array, "..."], n: Exponent) -> tuple[Float[Array, "..."], Exponent]:
    """`number` and a traced n in their common shape; a concrete n stays a float."""
    if isinstance(n, float):
        return number, n
    number, n = jnp.broadcast_arrays(number, n)
    return number, n


def for_nodes(exponent: Exponent) -> Exponent:
    """An exponent that broadcasts against values at the nodes, which are along the last axis."""
    return exponent if isinstance(exponent, float | int) else exponent[..., None]


def n_is_one(n: Exponent) -> bool:
    """Whether n is known to be 1, where the time integrals are formulas."""
    return isinstance(n, float) and n == 1.0
