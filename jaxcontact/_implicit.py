"""Scalar roots that know their own derivatives, lane by lane."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

Lane = Float[Array, "..."]


def implicit_root(
    residual: Callable[..., Lane], guess: Callable[..., Lane], iterations: int
) -> Callable[..., Lane]:
    """A function `x(*parameters)` that solves `residual(x, *parameters) = 0` lane by lane.

    A fixed number of Newton steps from a good guess has no branch and fuses into one loop over the
    lanes. The derivative is the implicit one, `dx = -(∂R/∂p dp)/(∂R/∂x)`, written in terms of the
    root itself, so that it is right in both modes and to any order, and the iteration is never
    differentiated.
    """

    def slope(x: Lane, *parameters: Lane) -> tuple[Lane, Lane]:
        return jax.jvp(lambda x: residual(x, *parameters), (x,), (jnp.ones_like(x),))

    @jax.custom_jvp
    def root(*parameters: Lane) -> Lane:
        x = guess(*parameters)
        for _ in range(iterations):
            value, derivative = slope(x, *parameters)
            x = x - value / derivative
        return x

    @root.defjvp
    def root_jvp(parameters: tuple[Lane, ...], tangents: tuple[Lane, ...]) -> tuple[Lane, Lane]:
        x = root(*parameters)
        _, forcing = jax.jvp(lambda *p: residual(x, *p), parameters, tangents)
        _, derivative = slope(x, *parameters)
        return x, -forcing / derivative

    return root
