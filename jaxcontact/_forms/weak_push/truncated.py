"""Power series in a few small numbers, truncated by total degree, as arrays of coefficients."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

Powers = tuple[int, ...]
Series = np.ndarray
"""Coefficients (monomials, lanes)."""


class Truncated:
    """Arithmetic of series with the given monomials, each a tuple of powers.

    Terms of a product beyond these monomials are dropped, so the set must contain every divisor
    that occurs. Constants are series; `constant` creates them.
    """

    def __init__(self, monomials: Sequence[Powers]):
        self.monomials = sorted(monomials, key=lambda powers: (sum(powers), powers))
        self.place = {powers: k for k, powers in enumerate(self.monomials)}
        self.degree = np.array([sum(powers) for powers in self.monomials])
        pairs = [
            (self.place[one], self.place[other], self.place[both])
            for one, other in itertools.product(self.monomials, repeat=2)
            if (both := tuple(np.add(one, other))) in self.place
        ]
        self._left, self._right, where = np.array(pairs).T
        self._sums = np.zeros((len(self.monomials), len(pairs)))
        self._sums[where, np.arange(len(pairs))] = 1

    def constant(self, values: np.ndarray) -> Series:
        series = np.zeros((len(self.monomials), *values.shape))
        series[0] = values
        return series

    def variable(self, powers: Powers, like: Series) -> Series:
        """Return the monomial with these powers."""
        series = np.zeros_like(like)
        series[self.place[powers]] = 1
        return series

    def times(self, *factors: Series) -> Series:
        product = factors[0]
        for factor in factors[1:]:
            product = self._sums @ (product[self._left] * factor[self._right])
        return product

    def power(self, series: Series, exponent: int) -> Series:
        if exponent == 0:
            return self.constant(np.ones(series.shape[1:]))
        return self.times(*[series] * exponent)

    def inverse(self, series: Series) -> Series:
        """Return 1/series by Newton's method; each step doubles the number of correct degrees."""
        found, right = self.constant(1 / series[0]), 0
        while right < self.degree[-1]:
            left = -self.times(series, found)
            left[0] += 2
            found, right = self.times(found, left), 2 * right + 1
        return found

    def sine_and_cosine(self, angle: np.ndarray, more: Series) -> tuple[Series, Series]:
        """Return sine and cosine of an angle plus a series without constant term."""
        term = self.constant(np.ones_like(angle))
        sine, cosine = np.sin(angle), np.cos(angle)
        sums = np.zeros_like(term), np.zeros_like(term)
        for k in range(self.degree[-1] + 1):
            slopes = (sine, cosine, -sine, -cosine)
            sums = sums[0] + slopes[k % 4] * term, sums[1] + slopes[(k + 1) % 4] * term
            term = self.times(term, more) / (k + 1)
        return sums
