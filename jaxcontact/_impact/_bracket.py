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
    order 1.4, and ends where the root no longer moves, after `iterations` at the latest. Not for
    differentiation.
    """
    zero = jnp.zeros_like(at_zero)
    rounding = jnp.finfo(zero.dtype).eps

    def unfinished(carry: tuple[Number, ...]) -> Array:
        count, moved, *_ = carry
        return (count < iterations) & (moved > rounding)

    def narrow(carry: tuple[Number, ...]) -> tuple[Number, ...]:
        count, _, last, low, low_value, high, high_value, side = carry
        middle = low + (high - low) * ratio(low_value, low_value - high_value)
        value = function(middle)
        up = value > 0
        kept_low, kept_high = ~up & (side < 0), up & (side > 0)
        return (
            count + 1,
            jnp.abs(middle - last),
            middle,
            jnp.where(up, middle, low),
            jnp.where(up, value, jnp.where(kept_low, low_value / 2, low_value)),
            jnp.where(up, high, middle),
            jnp.where(up, jnp.where(kept_high, high_value / 2, high_value), value),
            jnp.where(up, zero + 1, zero - 1),
        )

    first = (zero, zero + 2, zero - 1, zero, at_zero, zero + 1, at_one, zero)
    _, _, _, low, low_value, high, high_value, _ = jax.lax.while_loop(unfinished, narrow, first)
    return low + (high - low) * ratio(low_value, low_value - high_value)


def ratio(numerator: Number, denominator: Number) -> Number:
    """Their quotient, 0 where the denominator is 0."""
    nonzero = denominator != 0
    return jnp.where(nonzero, numerator / jnp.where(nonzero, denominator, 1), 0)
