"""Interpolation of a step by its ends: cubics by their slopes, quintics by two derivatives."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .modes import Number, PerContact

Lanes = Float[Array, " lanes"]

_ITERATIONS = 4


def to_root(
    size: Number, left: Lanes, falls: Lanes, right: Lanes, fall: Lanes
) -> tuple[Lanes, Lanes]:
    """Return the offset from the right end at which the cubic falls to zero, and its slope there.
    The offset is negative for a root within the step, and infinite if the cubic does not fall.
    `falls` and `fall` are the slopes at the left and the right.
    """
    # The mean slope of a short step is rounding; the slopes at its ends are known.
    short = size < jnp.finfo(fall.dtype).eps ** 0.25
    mean = jnp.where(short, (fall + falls) / 2, (right - left) / size)
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
    return jnp.where(down | (right < 0), x, jnp.inf), slope


def highest(
    size: Number, left: Lanes, rises: Lanes, right: Lanes, falls: Lanes
) -> tuple[Lanes, Array, Lanes, Lanes]:
    """Return the maximum between the ends; whether it lies inside; and at which part of the step,
    where the second derivative by that part is -2 times the last value.
    """
    a, b, d = rises * size, falls * size, right - left
    second, third = 3 * d - 2 * a - b, a + b - 2 * d
    # The root of a + 2 second u + 3 third u^2 whose form does not cancel: a slope of rounding size
    # at the left may hide a hump.
    hump = second > 0
    inside = (b < 0) & jnp.where(hump, a >= 0, a > 0)
    root = jnp.sqrt(jnp.where(inside, jnp.square(second) - 3 * third * a, 1))
    bottom = jnp.where(inside, jnp.where(hump, -3 * third, root - second), 1)
    u = jnp.where(inside, jnp.where(hump, second + root, a) / bottom, 0.5)
    top = left + u * (a + u * (second + u * third))
    return jnp.where(inside, top, jnp.maximum(left, right)), inside, u, root


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


class EndOfStep(NamedTuple):
    """Values at an end of a step, with two derivatives in time."""

    value: PerContact
    rate: PerContact
    second: PerContact


def quintic(lasts: Number, left: EndOfStep, right: EndOfStep) -> Quintic:
    """Return the quintics of all contacts over a step of the duration `lasts`."""
    return Quintic(lasts, *(EndOfStep(*(x[None] for x in end)) for end in (left, right)))


class Quintic(NamedTuple):
    """Quintics over a step, from its ends (1, contacts); see `quintic`."""

    lasts: Number
    left: EndOfStep
    right: EndOfStep

    def cubic(self, u: Array) -> Array:
        """Return the cubic with the same values and first derivatives at the part u of the step."""
        first, last = self.lasts * self.left.rate, self.lasts * self.right.rate
        mean = self.right.value - self.left.value
        return self.left.value + u * (
            first + u * (3 * mean - 2 * first - last + u * (first + last - 2 * mean))
        )

    def more(self, u: Array) -> Array:
        """Return the difference of the quintic from the cubic."""
        square = jnp.square(self.lasts)
        first, last = self.lasts * self.left.rate, self.lasts * self.right.rate
        mean = self.right.value - self.left.value
        # What the second derivatives of the cubic lack at both ends.
        at_left = square * self.left.second - (6 * mean - 4 * first - 2 * last)
        at_right = square * self.right.second - (4 * last + 2 * first - 6 * mean)
        v = 1 - u
        return jnp.square(u * v) * (v * at_left + u * at_right) / 2

    def value(self, u: Array) -> Array:
        """Return the values at the parts u (points, 1) of the step."""
        return self.cubic(u) + self.more(u)


def at_part(part: PerContact, lasts: Number, left: EndOfStep, right: EndOfStep) -> EndOfStep:
    """Return the quintics and two derivatives in time at a part of the step."""
    lasts = jnp.where(lasts > 0, lasts, 1)
    first, last = lasts * left.rate, lasts * right.rate
    bent, bends = jnp.square(lasts) * left.second / 2, jnp.square(lasts) * right.second / 2
    # What the parabola by the left end lacks at the right: u³ (a + b (u - 1) + c (u - 1)²).
    a = right.value - left.value - first - bent
    b = last - first - 2 * bent - 3 * a
    c = bends - bent - 3 * a - 3 * b
    value = rate = second = jnp.zeros_like(part)
    for number in (c, b - 2 * c, a - b + c, bent, first, left.value):
        second = second * part + 2 * rate
        rate = rate * part + value
        value = value * part + number
    return EndOfStep(value, rate / lasts, second / jnp.square(lasts))


def parts_of_step(dtype: np.dtype) -> Float[Array, "points 1"]:
    """Return the parts of a step at which a quintic is sampled, without its ends."""
    return jnp.asarray(np.arange(1, 16)[:, None] / 16, dtype)


def vertex(before: Array, at: Array, after: Array) -> Array:
    """Return the offset, in sample spacings, of the vertex of the parabola through three samples.
    It is 0 where they have no maximum between them.
    """
    bend, rise = 2 * at - before - after, after - before
    peak = (bend > 0) & (jnp.abs(rise) <= 2 * bend)
    return jnp.where(peak, rise / jnp.where(peak, 2 * bend, 1), 0)
