"""The change of a free impact by a weak push: a power series with coefficients in α alone.

    x'' = Γ - c/(1-κx)³ - xⁿ (1 + α x'),   x(0) = 0,  x'(0) = 1,   θ' = 1/(1-κx)²,

with a constant push Γ and the angular momentum c of two passing bodies; κ is the ratio of the unit
of length to their distance. The outcome is analytic in γ = Γ-c, c and κ. The coefficients come from
`table`; the highest order there estimates the truncation error.

Source of the equation: Landau & Lifshitz, Mechanics, section 14. The first order of e agrees with
de/dΓ = (1-αe)/e α ∫ x/(1+αu)² du over the speed u from 1 to -e, by parts from the energy integral.
"""

from __future__ import annotations

import functools
import math
import operator

import jax
import jax.numpy as jnp
import numpy as np

from ..._functions import chebyshev_polynomials, small_product
from ..base import Lane
from ..scale import Change
from .table import MOST_DAMPING, ORDER, table_of

_ACCURACY = 1e-9
"""Relative accuracy of the coefficients: 24 nodes leave 1e-10."""

_SAFETY = 2.0
"""Factor on the first omitted order, in place of the sum of all omitted orders."""

_DECAY = 0.25
"""Largest ratio of two orders at which the series is trusted."""


def weak_push(
    alpha: Lane, n: float, order: int, push: Lane, swirl: Lane, ratio: Lane
) -> tuple[Change, Change] | None:
    """Return the change of a free impact and a bound on each error, infinite if unknown.

    `order` is the k of x = w^k. Returns None if x^n is not a polynomial in w.
    """
    if order * n != int(order * n):
        return None
    table = table_of(n, order)
    dtype = alpha.dtype
    small = jnp.minimum(alpha, MOST_DAMPING)
    place = 2 * jnp.log1p(small) / math.log1p(MOST_DAMPING) - 1
    coefficients = jnp.asarray(table.coefficients, dtype)
    rows = small_product(chebyshev_polynomials(len(coefficients), place), coefficients)
    # Elastic bodies separate at their closing speed under any conservative force.
    loses = (small / (1 + small))[..., None]
    rows = rows * jnp.where(table.output == 0, loses, 1)
    terms = rows * _monomials((push - swirl, swirl, ratio), table.powers)
    degree = table.powers.sum(axis=1)
    members = len(Change._fields)
    which = table.output[:, None] == np.arange(members)

    def sums(terms: Lane, *chosen: np.ndarray) -> list[Lane]:
        """Return the sums of the chosen terms, each for all members of a change."""
        columns = np.concatenate([which & rows[:, None] for rows in chosen], axis=1)
        found = small_product(terms, jnp.asarray(columns, dtype))
        return jnp.split(found, len(chosen), axis=-1)

    (change,) = sums(terms, degree <= ORDER)
    sizes = jnp.abs(jax.lax.stop_gradient(terms))
    first, before, last = sums(sizes, degree == 1, degree == ORDER, degree == ORDER + 1)
    decays = jnp.sum(last, axis=-1) <= _DECAY * jnp.sum(before, axis=-1)
    good = ((alpha <= MOST_DAMPING) & decays)[..., None]
    doubt = jnp.where(good, _SAFETY * last + _ACCURACY * first, jnp.inf)
    return (
        Change(*(change[..., k] for k in range(members))),
        Change(*(doubt[..., k] for k in range(members))),
    )


def _monomials(numbers: tuple[Lane, ...], powers: np.ndarray) -> Lane:
    """Return the products (..., R) of the powers (R, 3) of numbers."""
    factors = [
        jnp.where(power > least, number[..., None], 1)
        for number, power in zip(numbers, powers.T, strict=True)
        for least in range(power.max())
    ]
    return functools.reduce(operator.mul, factors)
