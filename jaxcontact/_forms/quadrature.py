"""Quadrature on [0, 1] with a known power singularity at the start, and its derivatives."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._functions import nonzero
from .base import Exponent, Lane

UNROLL = 2
"""Nodes unrolled between two passes through memory, measured among 1 to 10 for 256 to 400 000
lanes. Functions that are differentiated again use 1, which compiles four times faster.
"""


def integrate(
    integrand: Callable[[Float[Array, "..."]], Float[Array, "..."]],
    strength: Exponent,
    like: Float[Array, "..."],
    unroll: int,
    count: int | None = None,
) -> Float[Array, "..."]:
    """Return `∫_0^1 u^(-strength) g(u) du` for a smooth g, lane by lane.

    `like` sets precision and shape. `strength` < 1. A Python float uses the Gauss-Jacobi rule with
    `count` nodes, by default 20 for double precision and 10 for single. An array uses a rule with
    four times as many nodes, which is differentiable in the strength. There `u = r^(1/(1-s))`
    removes the singularity for any strength, and a double-exponential rule in r handles the
    remaining fractional power of g.

    The nodes form a loop around the lanes. As an axis of the lanes they would be the fastest axis.
    Summing over the fastest axis does not use the processor's vectors and is three times slower.
    """
    count = count or (20 if like.dtype == jnp.float64 else 10)
    if isinstance(strength, float | int):
        nodes, weights = _gauss_jacobi(float(strength), count)
    else:
        r, weights = _double_exponential(4 * count)
        nodes = np.log(r)
        stretch = 1 / (1 - strength)
        least = float(jnp.finfo(like.dtype).tiny) ** 0.25

    def add(
        total: Float[Array, "..."], at: tuple[Float[Array, ""], Float[Array, ""]]
    ) -> tuple[Float[Array, "..."], None]:
        node, weight = at
        if isinstance(strength, float | int):
            return total + weight * integrand(node), None
        # In single precision the first nodes would be zero. Integrands divide by the nodes, their
        # derivatives by the squares.
        at_node = jnp.maximum(jnp.exp(stretch * node), least)
        return total + stretch * weight * integrand(at_node), None

    rule = (jnp.asarray(nodes, like.dtype), jnp.asarray(weights, like.dtype))
    return jax.lax.scan(add, jnp.zeros_like(like), rule, unroll=unroll)[0]


def to_power(x: Float[Array, "..."], exponent: Exponent) -> Float[Array, "..."]:
    """Return `x^exponent` for x > 0 near 1, as at the nodes, in a third of the usual time."""
    return jnp.exp(exponent * jnp.log(x))


@functools.lru_cache
def _gauss_jacobi(strength: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return nodes and weights for the weight u^(-strength) on [0, 1].

    Computed by the three-term recurrence of the orthonormal polynomials: Golub & Welsch (1969), doi
    10.1090/S0025-5718-69-99647-1. SciPy's weights lose three more digits, and its import takes half
    a second.
    """
    k, b = np.arange(1.0, count), -strength
    diagonal = np.append(b / (b + 2), b * b / ((2 * k + b) * (2 * k + b + 2)))
    # At strength 1 the first one is 0/0 until a factor cancels.
    first = k[1:]
    rest = (2 * first * (first + b) / (2 * first + b)) ** 2
    rest = rest / ((2 * first + b + 1) * (2 * first + b - 1))
    beside = np.sqrt(np.append(4 * (1 + b) / ((2 + b) ** 2 * (3 + b)), rest))
    x = np.linalg.eigvalsh(np.diag(diagonal) + np.diag(beside, 1) + np.diag(beside, -1))
    before, now = np.zeros_like(x), np.ones_like(x)
    squares = np.ones_like(x)
    for i in range(count - 1):
        lower = beside[i - 1] * before if i else 0
        before, now = now, ((x - diagonal[i]) * now - lower) / beside[i]
        squares += now * now
    return (1 + x) / 2, 1 / (squares * (1 - strength))


@functools.lru_cache
def _double_exponential(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the tanh-sinh rule on [0, 1], with nodes free of cancellation near 0."""
    # Beyond 3.15 the weights are below an ulp of float64.
    t = np.linspace(-3.15, 3.15, count)
    x = np.pi / 2 * np.sinh(t)
    nodes = 1 / (1 + np.exp(-2 * x))
    weights = np.pi / 2 * np.cosh(t) / (2 * np.cosh(x) ** 2) * (t[1] - t[0])
    return nodes, weights / weights.sum()


Out = TypeVar("Out")


def slopes_along(
    function: Callable[..., Out],
    primals: Sequence[jax.Array],
    varying: list[int],
    count: int,
    pushed: Callable[[jax.Array], tuple[jax.Array, ...]],
) -> tuple[Out, Out]:
    """Return the value of a function, and its slopes along `count` directions of the varying
    numbers, whose tangents in a direction are `pushed` of its unit vector.
    """
    numbers = tuple(primals[i] for i in varying)

    def of_varying(*numbers: jax.Array) -> Out:
        given = list(primals)
        for i, number in zip(varying, numbers, strict=True):
            given[i] = number
        return function(*given)

    def sensitivity(direction: jax.Array) -> tuple[Out, Out]:
        return jax.jvp(of_varying, numbers, pushed(direction))

    basis = jnp.eye(count, dtype=numbers[0].dtype)
    if count == 1:
        # A batch of one direction would be traced once more and compiled with an axis of length
        # one.
        outcome, slope = sensitivity(basis[0])
        return outcome, jax.tree.map(lambda s: s[None], slope)
    return jax.vmap(sensitivity, out_axes=(None, 0))(basis)


def differentiated_forward(
    function: Callable[..., Out], with_slopes: Callable[..., Out]
) -> Callable[..., Out]:
    """Return a function of few numbers, each one or one per lane, with the slopes of `with_slopes`.

    Its rule is linear in the tangents and therefore transposes. The slopes are computed forward
    together with the value. They multiply tangents in forward mode and cotangents in reverse mode.
    """
    solved = jax.custom_jvp(function)

    def rule(primals: tuple[jax.Array, ...], tangents: tuple) -> tuple[Out, Out]:
        varying = [i for i, t in enumerate(tangents) if nonzero(t)]

        def pushed(direction: jax.Array) -> tuple[jax.Array, ...]:
            pairs = zip(direction, varying, strict=True)
            return tuple(jnp.broadcast_to(d, primals[i].shape) for d, i in pairs)

        outcome, slopes = slopes_along(with_slopes, primals, varying, len(varying), pushed)
        return outcome, jax.tree.map(
            lambda slope: sum(s * tangents[i] for s, i in zip(slope, varying, strict=True)), slopes
        )

    solved.defjvp(rule, symbolic_zeros=True)
    return solved


def lanewise(solve: Callable[..., Out], number: Lane, n: Exponent) -> Out:
    """Return `solve(number, n, UNROLL)`, lane by lane on arrays of one shape, differentiated
    forward.

    Reverse mode through a quadrature would store every node of every lane. The derivative of a
    lane's integral by its one or two numbers is one more integral, with `unroll` = 1, which
    compiles faster. A float n is a constant.
    """
    fixed = (n,) if isinstance(n, float) else ()

    def with_unroll(unroll: int) -> Callable[..., Out]:
        return lambda *numbers: solve(*numbers, *fixed, unroll)

    solved = differentiated_forward(with_unroll(UNROLL), with_unroll(1))
    return solved(number) if fixed else solved(number, jnp.asarray(n))
