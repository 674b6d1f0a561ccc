"""Quintic interpolation of a step from values and two derivatives at its ends."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .modes import PerContact
from .scalars import Number

_POINTS = 16


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

    def value_and_rate(self, u: Array) -> tuple[Array, Array]:
        """Return the values and their rates in time at the part u of the step."""
        value, slope = jax.jvp(self.value, (u,), (jnp.ones_like(u),))
        return value, slope / self.lasts


def parts_of_step(dtype: np.dtype) -> Float[Array, "points 1"]:
    """Return the parts of a step at which a quintic is sampled, without its ends."""
    return jnp.asarray(np.arange(1, _POINTS)[:, None] / _POINTS, dtype)


def vertex(before: Array, at: Array, after: Array) -> Array:
    """Return the offset, in sample spacings, of the vertex of the parabola through three samples.
    It is 0 where they have no maximum between them.
    """
    bend, rise = 2 * at - before - after, after - before
    peak = (bend > 0) & (jnp.abs(rise) <= 2 * bend)
    return jnp.where(peak, rise / jnp.where(peak, 2 * bend, 1), 0)
