"""Scalar roots with their own derivatives, lane by lane."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

Lane = Float[Array, "..."]


def implicit_root(
    residual: Callable[..., Lane], guess: Callable[..., Lane], iterations: int
) -> Callable[..., Lane]:
    """A function `x(*parameters)` that solves `residual(x, *parameters) = 0` lane by lane.

    A fixed number of Newton steps from a good guess has no branch and fuses into one loop over the
    lanes. Derivatives as in `with_implicit_derivative`.
    """

    def newton(*parameters: Lane) -> Lane:
        x = guess(*parameters)
        for _ in range(iterations):
            value, derivative = _with_slope(residual, x, parameters)
            x = x - value / derivative
        return x

    return with_implicit_derivative(newton, residual)


def with_implicit_derivative(
    find: Callable[..., Lane], residual: Callable[..., Lane]
) -> Callable[..., Lane]:
    """`find(*parameters)`, which returns a root x of `residual(x, *parameters)`, differentiable.

    The derivative is the implicit one, `dx = -(∂R/∂p dp)/(∂R/∂x)`, written in terms of the root
    itself, so that it is right in both modes and to any order; `find` is never differentiated.
    Parameters are pytrees of arrays.
    """
    root = jax.custom_jvp(find)

    @root.defjvp
    def root_jvp(parameters: tuple, tangents: tuple) -> tuple[Lane, Lane]:
        x = root(*parameters)
        _, forcing = jax.jvp(lambda *p: residual(x, *p), parameters, tangents)
        _, derivative = _with_slope(residual, x, parameters)
        return x, -forcing / derivative

    return root


def _with_slope(
    residual: Callable[..., Lane], x: Lane, parameters: tuple[Any, ...]
) -> tuple[Lane, Lane]:
    return jax.jvp(lambda x: residual(x, *parameters), (x,), (jnp.ones_like(x),))
