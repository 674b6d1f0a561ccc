"""Where in a step that was taken a function of the state vanishes."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array

from .._forms import Flag
from .._implicit import bracketed_root, ratio
from .._varying import varying
from ._motion import Number, State

GUESSES = 8
"""Of a regula falsi for a guess, which is no better than its polynomial."""
# Of the correction. Rounding is mostly reached after three, and later at a corner of the function,
# as where a contact ends at a creeping speed.
_ITERATIONS = 60


class StepTaken(NamedTuple):
    """A step in regularised time: its ends, its size, and how to take a fraction of it again."""

    start: State
    end: State
    size: Number
    rate: Callable[[State], State]
    later: Callable[[Number], State]


def root_in_step(
    function: Callable[[State], Number], step: StepTaken, exists: Flag, until: Number | float = 1.0
) -> Number:
    """The fraction of a step at which `function` goes from above zero to below; any if none exists.

    `until` is a fraction at which it is below zero. A polynomial through the ends of the step gives
    the first guess. It is corrected by Newton's method on steps that end there, within a bracket.
    Not for differentiation.
    """
    size, until = step.size, jnp.asarray(until, step.size.dtype)
    between = polynomial_through(step.rate, step.start, step.end, size)

    def guess(part: Number) -> Number:
        return jnp.where(exists, function(between(part * until)), 1 - part)

    def corrected(carry: tuple[Number, ...]) -> tuple[Number, ...]:
        count, _, fraction, low, high = carry
        found = step.later(fraction)
        value, slope = jax.jvp(function, (found,), (step.rate(found),))
        low, high = jnp.where(value > 0, fraction, low), jnp.where(value > 0, high, fraction)
        newton = fraction - ratio(value, slope * size)
        # One that moves nothing stands on an end of its own bracket, and has arrived.
        inside = (newton >= low) & (newton <= high) & (slope != 0)
        better = jnp.where(inside, newton, (low + high) / 2)
        # A step of Newton's squares its error; one to the middle is as wrong as it is long.
        moved = jnp.where(inside, jnp.abs(newton - fraction), (high - low) / close)
        done = ~exists | (value == 0)
        return (
            count + 1,
            jnp.where(done, 0, moved),
            jnp.where(done, fraction, better),
            low,
            high,
        )

    def unsettled(carry: tuple[Number, ...]) -> Flag:
        count, moved, fraction, *_ = carry
        return (count < _ITERATIONS) & (moved > close * fraction)

    # The step of Newton's after this one would move only rounding.
    close = jnp.sqrt(jnp.finfo(size.dtype).eps)
    zero = jnp.zeros_like(size)
    first = jnp.where(exists, function(step.start), 1)
    last = jnp.where(until < 1, function(between(until)), function(step.end))
    root = until * bracketed_root(guess, first, jnp.where(exists, last, 0), GUESSES)
    root = jnp.where((root > 0) & (root <= 1), root, until / 2)
    start = varying(root, (zero, zero + 1, root, zero, until))
    return jax.lax.while_loop(unsettled, corrected, start)[2]


def polynomial_through(
    rate: Callable[[State], State], start: State, end: State, size: Number
) -> Callable[[Number], State]:
    """The motion of a step as a function of the fraction of it that has passed.

    The polynomial of degree 5 with its first and second derivatives at both ends.
    """

    def derivatives(state: State) -> tuple[State, State]:
        return jax.jvp(rate, (state,), (rate(state),))

    (first, first_bend), (last, last_bend) = map(derivatives, (start, end))

    def polynomial(*at: Array) -> Array:
        x0, x1, v0, v1, a0, a1 = at
        v0, v1, a0, a1 = size * v0, size * v1, jnp.square(size) * a0 / 2, jnp.square(size) * a1 / 2
        moved, turned, bent = x1 - x0 - v0 - a0, v1 - v0 - 2 * a0, a1 - a0
        return jnp.stack(
            [
                x0,
                v0,
                a0,
                10 * moved - 4 * turned + bent,
                7 * turned - 15 * moved - 2 * bent,
                6 * moved - 3 * turned + bent,
            ]
        )

    coefficients = jax.tree.map(polynomial, start, end, first, last, first_bend, last_bend)
    return lambda fraction: jax.tree.map(lambda c: jnp.polyval(c[::-1], fraction), coefficients)
