"""The largest value of a force within a step of collocation."""

from __future__ import annotations

import numpy as np

from .collocation import EXTENDED, FINE, Array, radau

TINY = EXTENDED("1e-4900")

_NEWTON = 6


def absolute_power(w: Array, exponent: Array) -> Array:
    """|w|^exponent, 0 at 0 and 1 for the exponent 0; negative w belong to trials only."""
    return np.where(exponent == 0, 1, np.exp(exponent * np.log(np.maximum(np.abs(w), TINY))))


def largest_product(m: Array, w: Array, g: Array) -> Array:
    """The largest w^m g in a step, from values of w and g at its start and its nodes.

    Both are polynomials of the place θ in the step, which w^m need not be. The largest of a fine
    grid is refined by Newton's method for m w' g + g' w = 0.
    """
    rule = radau()
    rough = [np.einsum("gj,jl->gl", rule.fine, values) for values in (w, g)]
    powers = [np.einsum("gj,jl->gl", rule.monomial, values) for values in (w, g)]
    best = np.argmax(absolute_power(rough[0], m) * rough[1], 0)
    at = np.clip(best, 1, FINE - 2) / EXTENDED(FINE - 1)
    for _ in range(_NEWTON):
        (w0, w1, w2), (g0, g1, g2) = (_with_derivatives(c, at) for c in powers)
        slope = np.where(m == 0, g1, m * w1 * g0 + g1 * w0)
        change = np.where(m == 0, g2, m * w2 * g0 + (m + 1) * w1 * g1 + g2 * w0)
        step = np.clip(slope / change, -1 / EXTENDED(FINE), 1 / EXTENDED(FINE))
        at = np.where(np.isfinite(step), np.clip(at - step, 0, 1), at)
    (w0, *_), (g0, *_) = (_with_derivatives(c, at) for c in powers)
    return absolute_power(w0, m) * g0


def _with_derivatives(powers: Array, at: Array) -> tuple[Array, Array, Array]:
    """A polynomial and its first two derivatives."""
    value = first = second = np.zeros_like(at)
    for coefficient in powers[::-1]:
        second = second * at + 2 * first
        first = first * at + value
        value = value * at + coefficient
    return value, first, second
