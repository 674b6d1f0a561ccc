"""Linear equations with a mass matrix."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._coupled.scalars import Number

_LARGE = 8
"""From this size on, Cholesky's factors of the library are used."""


def solve_mass(mass: Float[Array, "n n"], right: Float[Array, "n ..."]) -> Float[Array, "n ..."]:
    """Return M⁻¹ times vectors, by elimination without pivots; NaN unless M is positive definite.
    Written out, it runs in batches and has short derivatives.
    """
    n = mass.shape[0]
    columns = right.reshape(n, -1)
    if n >= _LARGE:
        factor = jax.scipy.linalg.cho_factor(mass)
        return jax.scipy.linalg.cho_solve(factor, columns).reshape(right.shape)
    if n == 1:
        return right / positive(mass[0, 0])
    rows = jnp.concatenate([mass, columns], axis=1)
    unit = jnp.eye(n, dtype=rows.dtype)
    for k in range(n):
        pivot = rows[k] / positive(rows[k, k])
        rows = rows - (rows[:, k] - unit[k])[:, None] * pivot[None]
    return rows[:, n:].reshape(right.shape)


def positive(number: Number) -> Number:
    """Return a number, or NaN unless it is positive."""
    return jnp.where(number > 0, number, jnp.nan)
