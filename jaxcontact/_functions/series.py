"""Power series and Chebyshev series."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float


def horner(coefficients: Sequence[float], x: Float[Array, "..."]) -> Float[Array, "..."]:
    """Return the polynomial `sum_k coefficients[k] x^k`."""
    result = jnp.full_like(x, coefficients[-1])
    for coefficient in reversed(coefficients[:-1]):
        result = result * x + coefficient
    return result


def chebyshev(
    coefficients: Sequence[Any] | Float[Array, " degree_plus_1"], x: Float[Array, "..."]
) -> Float[Array, "..."]:
    """Return the series `sum_k coefficients[k] T_k(x)` for x in [-1, 1], by Clenshaw's recurrence.

    cos(k arccos x) would have no derivative at the ends of the interval.
    """
    last, before = jnp.zeros_like(x), jnp.zeros_like(x)
    for k in range(len(coefficients) - 1, 0, -1):
        last, before = coefficients[k] + 2 * x * last - before, last
    return coefficients[0] + x * last - before


def chebyshev_polynomials(count: int, x: Float[Array, "..."]) -> Float[Array, "... count"]:
    """Return the first `count` of T_0, T_1, ... at x in [-1, 1], for many series at one place.

    The number of known polynomials doubles by T_(n+j) = 2 T_n T_j - T_(n-j).
    """
    known = jnp.stack([jnp.ones_like(x), x], axis=-1)
    while (last := known.shape[-1] - 1) + 1 < count:
        more = 2 * known[..., -1:] * known[..., 1:] - known[..., last - 1 :: -1]
        known = jnp.concatenate([known, more], axis=-1)
    return known[..., :count]


def chebyshev_by_piece(
    ends: Sequence[float], rows: Sequence[Sequence[float]], x: Float[Array, "..."]
) -> Float[Array, "..."]:
    """Return Chebyshev series on the intervals between `ends`, extended by the last one's tangent.

    A row holds the coefficients of one degree, one per interval. The interval is selected by
    comparisons, which vectorise; fetching coefficients by index takes several times longer.
    """
    passed = [x >= end for end in ends[1:-1]]

    def chosen(values: Sequence[float]) -> Any:
        found: Any = values[0]
        for flag, value in zip(passed, values[1:], strict=True):
            found = jnp.where(flag, value, found)
        return found

    pieces = list(itertools.pairwise(ends))
    middle = chosen([(low + high) / 2 for low, high in pieces])
    stretches = [2 / (high - low) for low, high in pieces]
    inside = jnp.minimum((x - middle) * chosen(stretches), 1)
    slope = stretches[-1] * sum(k * k * row[-1] for k, row in enumerate(rows))
    beyond = jnp.maximum(x - ends[-1], 0)
    return chebyshev([chosen(row) for row in rows], inside) + slope * beyond
