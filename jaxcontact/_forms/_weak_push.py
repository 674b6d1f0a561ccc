"""How a weak push changes a free impact: a power series whose coefficients depend on α alone.

    x'' = Γ - c/(1-κx)³ - xⁿ (1 + α x'),   x(0) = 0,  x'(0) = 1,   θ' = 1/(1-κx)²,

with a constant push Γ and the angular momentum of two bodies that pass each other, c, at the ratio
κ of the unit of length to their distance. The outcome is analytic in γ = Γ-c, c and κ. The
coefficients are those of `_weak_push_table`; the last order there estimates what is left out.

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

from .._elementary import chebyshev_polynomials, small_product
from ._base import Lane
from ._scale import Change
from ._weak_push_table import MOST_DAMPING, ORDER, table_of

_ACCURACY = 1e-9
"""Of the coefficients, relative: 24 nodes leave 1e-10."""

_SAFETY = 2.0
"""Of the first order left out, in place of the sum of all orders left out."""

_DECAY = 0.25
"""The ratio of two orders up to which the series is trusted."""


def weak_push(
    alpha: Lane, n: float, order: int, push: Lane, swirl: Lane, ratio: Lane
) -> tuple[Change, Change] | None:
    """The change of a free impact, and a bound on the error of each; infinite where not known.

    `order` is the k of x = w^k. None for exponents that it does not make a polynomial.
    """
    if order * n != int(order * n):
        return None
    table = table_of(n, order)
    dtype = alpha.dtype
    small = jnp.minimum(alpha, MOST_DAMPING)
    place = 2 * jnp.log1p(small) / math.log1p(MOST_DAMPING) - 1
    coefficients = jnp.asarray(table.coefficients, dtype)
    rows = small_product(chebyshev_polynomials(len(coefficients), place), coefficients)
    # Elastic bodies part as fast as they met, whatever holds them or drives them apart.
    loses = (small / (1 + small))[..., None]
    rows = rows * jnp.where(table.output == 0, loses, 1)
    terms = rows * _monomials((push - swirl, swirl, ratio), table.powers)
    degree = table.powers.sum(axis=1)
    members = len(Change._fields)
    which = table.output[:, None] == np.arange(members)

    def sums(terms: Lane, *chosen: np.ndarray) -> list[Lane]:
        """Of the chosen terms, each for all members of a change."""
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
    """The products (..., R) of the powers (R, 3) of numbers."""
    factors = [
        jnp.where(power > least, number[..., None], 1)
        for number, power in zip(numbers, powers.T, strict=True)
        for least in range(power.max())
    ]
    return functools.reduce(operator.mul, factors)
