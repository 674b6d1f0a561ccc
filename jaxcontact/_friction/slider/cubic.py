"""The cubic through the values and slopes at both ends of a step: where it crosses or peaks."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp

from .spring import Lane

# The root starts another trial step, which corrects it. Measured: more steps save no trial.
_ITERATIONS = 4


class Cubic(NamedTuple):
    """The cubic c0 + c1 x + c2 x² + c3 x³ over a step, x from 0 to 1."""

    c0: Lane
    c1: Lane
    c2: Lane
    c3: Lane

    @classmethod
    def through(cls, start: Lane, start_slope: Lane, end: Lane, end_slope: Lane) -> Cubic:
        """Return the cubic with these values and slopes at 0 and 1."""
        rise = end - start
        second = 3 * rise - 2 * start_slope - end_slope
        return cls(start, start_slope, second, start_slope + end_slope - 2 * rise)

    def at(self, x: Lane) -> Lane:
        """Return the value at x."""
        return self.c0 + x * (self.c1 + x * (self.c2 + x * self.c3))

    def slope(self, x: Lane) -> Lane:
        """Return the slope at x."""
        return self.c1 + x * (2 * self.c2 + 3 * x * self.c3)

    def crossing(self) -> Lane:
        """Return about where the cubic, positive at 1, crosses zero upwards: by Newton's steps, or
        by halving where they leave the bracket. A double root at 0 is not one.
        """

        def narrow(_: int, bracket: tuple[Lane, Lane, Lane]) -> tuple[Lane, Lane, Lane]:
            low, x, high = bracket
            value, slope = self.at(x), self.slope(x)
            low, high = jnp.where(value < 0, x, low), jnp.where(value < 0, high, x)
            newton = x - value / jnp.where(slope != 0, slope, 1)
            inside = (newton > low) & (newton < high)
            return low, jnp.where(inside, newton, (low + high) / 2), high

        zero = jnp.zeros_like(self.c0)
        first = (zero, zero + 0.5, zero + 1)
        return jax.lax.fori_loop(0, _ITERATIONS, narrow, first, unroll=True)[1]

    def top(self) -> Lane:
        """Return where in (0, 1) the cubic has its maximum; 0 if it has none."""
        has = (self.c1 > 0) & (self.slope(jnp.ones_like(self.c1)) < 0)
        root = jnp.sqrt(jnp.maximum(jnp.square(self.c2) - 3 * self.c3 * self.c1, 0))
        return jnp.where(has, self.c1 / jnp.where(has, root - self.c2, 1), 0)
