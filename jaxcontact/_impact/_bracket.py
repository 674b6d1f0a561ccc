"""A root between two points."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

Number = Float[Array, ""]


def bracketed_root(
    function: Callable[[Number], Number], at_zero: Number, at_one: Number, iterations: int
) -> Number:
    """The root in [0, 1] of a function with the values `at_zero` > 0 > `at_one` at the ends.

    Regula falsi that halves the value of an end kept twice (Illinois): it keeps the bracket, has
    order 1.4, and a fixed length. Not for differentiation.
    """
    zero = jnp.zeros_like(at_zero)

    def narrow(_: int, bracket: tuple[Number, ...]) -> tuple[Number, ...]:
        low, low_value, high, high_value, side = bracket
        middle = low + (high - low) * ratio(low_value, low_value - high_value)
        value = function(middle)
        up = value > 0
        kept_low, kept_high = ~up & (side < 0), up & (side > 0)
        return (
            jnp.where(up, middle, low),
            jnp.where(up, value, jnp.where(kept_low, low_value / 2, low_value)),
            jnp.where(up, high, middle),
            jnp.where(up, jnp.where(kept_high, high_value / 2, high_value), value),
            jnp.where(up, zero + 1, zero - 1),
        )

    bracket = (zero, at_zero, zero + 1, at_one, zero)
    low, low_value, high, high_value, _ = jax.lax.fori_loop(0, iterations, narrow, bracket)
    return low + (high - low) * ratio(low_value, low_value - high_value)


def ratio(numerator: Number, denominator: Number) -> Number:
    """Their quotient, 0 where the denominator is 0."""
    nonzero = denominator != 0
    return jnp.where(nonzero, numerator / jnp.where(nonzero, denominator, 1), 0)
