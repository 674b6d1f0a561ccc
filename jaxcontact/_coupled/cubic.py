"""Cubic interpolation of a step from values and slopes at its ends: roots and maxima."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from .scalars import Number

Lanes = Float[Array, " lanes"]

_ITERATIONS = 4


def to_root(
    size: Number, left: Lanes, falls: Lanes, right: Lanes, fall: Lanes
) -> tuple[Lanes, Lanes]:
    """Return the offset from the right end at which the cubic falls to zero, and its slope there.
    The offset is negative for a root within the step, and infinite if the cubic does not fall.
    `falls` and `fall` are the slopes at the left and the right.
    """
    mean = (right - left) / size
    second = (2 * fall + falls - 3 * mean) / size
    third = (fall + falls - 2 * mean) / jnp.square(size)
    down = fall < 0
    newton = -right / jnp.where(down, fall, 1)
    across = (left > 0) & (right < 0)
    secant = -size * right / jnp.where(across, right - left, 1)
    x = jnp.where(across, secant, jnp.where(right < 0, -size / 2, newton))
    x = jnp.where(down & (jnp.abs(newton) < 0.1 * size), newton, x)
    for _ in range(_ITERATIONS):
        value = right + x * (fall + x * (second + x * third))
        slope = fall + x * (2 * second + 3 * x * third)
        x = jnp.where(slope < 0, jnp.maximum(x - value / jnp.where(slope < 0, slope, 1), -size), x)
    return jnp.where(down | (right < 0), x, jnp.inf), fall + x * (2 * second + 3 * x * third)


def highest(
    size: Number, left: Lanes, rises: Lanes, right: Lanes, falls: Lanes
) -> tuple[Lanes, Array]:
    """Return the maximum between the ends, and whether it lies inside."""
    a, b, d = rises * size, falls * size, right - left
    second, third = 3 * d - 2 * a - b, a + b - 2 * d
    inside = (a > 0) & (b < 0)
    square = jnp.where(inside, jnp.square(second) - 3 * third * a, 1)
    bottom = jnp.where(inside, jnp.sqrt(square) - second, 1)
    u = jnp.where(inside, a, 0) / bottom
    top = left + u * (a + u * (second + u * third))
    return jnp.where(inside, top, jnp.maximum(left, right)), inside


def ceiling(
    size: Number, left: Lanes, rises: Lanes, right: Lanes, falls: Lanes
) -> tuple[Lanes, Array]:
    """Return the height at which the end tangents intersect, and whether it is above both ends. A
    function with negative curvature throughout, such as the indentation of two bodies in flight,
    stays below it.
    """
    inside = (rises > 0) & (falls < 0)
    bend = jnp.where(inside, rises - falls, 1)
    return left + rises * (right - left - falls * size) / bend, inside
