"""Radau's collocation in extended precision: nodes, matrices, a solver for small systems, and the
largest value of a force within a step.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np
from mpmath import mp, mpf

Array = np.ndarray
EXTENDED = np.longdouble
STAGES = 10
"""Nodes of a step: order 19, and 10 in what is stiff."""
FINE = 41
"""Places in a step where the largest force is looked for before it is refined."""


class Rule(NamedTuple):
    """Radau IIA on [0, 1]; `inverse` and `square` are A^-1 and A^-2.

    `spectrum`: what turns increments at the nodes into the Legendre coefficient of highest degree;
    `fine`, `fine_slope`, `monomial`: from values at 0 and the nodes to values on a fine grid, and
    to coefficients of powers.
    """

    nodes: Array
    matrix: Array
    inverse: Array
    square: Array
    spectrum: Array
    fine: Array
    monomial: Array


def _extended(values: object) -> Array:
    """mpmath numbers, any nesting of lists, as an array with 64 bits of mantissa."""

    def split(x: mpf) -> np.longdouble:
        high = float(x)
        return EXTENDED(high) + EXTENDED(float(x - mpf(high)))

    flat = np.array(values, dtype=object)
    return np.array([split(x) for x in flat.ravel()], dtype=EXTENDED).reshape(flat.shape)


@functools.lru_cache
def radau() -> Rule:
    """The rule with `STAGES` nodes, made in forty digits."""
    with mp.workdps(50):
        s = STAGES

        def polynomial(x: mpf) -> mpf:
            return mp.legendre(s, 2 * x - 1) - mp.legendre(s - 1, 2 * x - 1)

        # All nodes except the last are those of Jacobi's polynomials: good starts in double
        # precision.
        from scipy.special import roots_jacobi

        starts = (1 + roots_jacobi(s - 1, 1.0, 0.0)[0]) / 2
        nodes = [mp.findroot(polynomial, mpf(float(x))) for x in starts] + [mpf(1)]
        powers = mp.matrix(s, s)
        integrals = mp.matrix(s, s)
        for i, c in enumerate(nodes):
            for j in range(s):
                powers[i, j] = c**j
                integrals[i, j] = c ** (j + 1) / (j + 1)
        matrix = integrals * mp.inverse(powers)
        inverse = mp.inverse(matrix)
        all_nodes = [mpf(0), *nodes]
        vandermonde = mp.matrix(s + 1, s + 1)
        legendre = mp.matrix(s + 1, s + 1)
        for i, c in enumerate(all_nodes):
            for j in range(s + 1):
                vandermonde[i, j] = c**j
                legendre[i, j] = mp.legendre(j, 2 * c - 1)
        to_powers = mp.inverse(vandermonde)
        to_legendre = mp.inverse(legendre)
        grid = [mpf(i) / (FINE - 1) for i in range(FINE)]
        fine = mp.matrix(FINE, s + 1)
        for i, c in enumerate(grid):
            for j in range(s + 1):
                fine[i, j] = c**j
        return Rule(
            nodes=_extended(nodes),
            matrix=_extended(matrix.tolist()),
            inverse=_extended(inverse.tolist()),
            square=_extended((inverse * inverse).tolist()),
            spectrum=_extended(to_legendre.tolist())[-1, 1:],
            fine=_extended((fine * to_powers).tolist()),
            monomial=_extended(to_powers.tolist()),
        )


def solve_small(matrix: Array, right: Array) -> Array:
    """Solve many systems at once: `matrix` (s, s, lanes) and `right` (s, lanes) are overwritten.

    With exchange of rows, without which the square of a collocation's matrix loses all digits.
    """
    size, lanes = right.shape
    every = np.arange(lanes)
    for k in range(size - 1):
        best = k + np.argmax(np.abs(matrix[k:, k]), axis=0)
        moved = np.flatnonzero(best != k)
        if moved.size:
            rows, at = best[moved], every[moved]
            kept = matrix[k, k:, at].copy()
            matrix[k, k:, at] = matrix[rows, k:, at]
            matrix[rows, k:, at] = kept
            held = right[k, at].copy()
            right[k, at] = right[rows, at]
            right[rows, at] = held
        factor = matrix[k + 1 :, k] / matrix[k, k]
        matrix[k + 1 :, k + 1 :] -= factor[:, None] * matrix[k, k + 1 :][None]
        right[k + 1 :] -= factor * right[k]
    for k in range(size - 1, -1, -1):
        for j in range(k + 1, size):
            right[k] -= matrix[k, j] * right[j]
        right[k] /= matrix[k, k]
    return right


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
