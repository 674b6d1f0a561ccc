"""Friction forces of contacts that stick or slide, in SI units, and equations with M."""

from __future__ import annotations

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._coupled.modes import Flags, PerContact
from .._coupled.scalars import Flag, Number

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


SLIDES_ON = 1.0
"""The sign of slip that open contacts keep: any but 0, which would hold them."""


class Friction(NamedTuple):
    """Friction forces in N along the slip, the accelerations v', slip speeds in m/s and their rates
    in m/s², and whether forces of sticking contacts are not unique.
    """

    force: PerContact
    acceleration: Float[Array, " n"]
    slip: PerContact
    slip_rate: PerContact
    redundant: Flag


class Held(NamedTuple):
    """Forces that hold contacts, and whether others would hold them as well."""

    force: PerContact
    redundant: Flag


def hold(matrix: Float[Array, "m m"], sticks: Flags, needed: PerContact) -> Held:
    """Return the λ of the contacts that stick, Σ_l A_kl λ_l = b_k, and 0 for all others.

    `matrix` A = J_t M⁻¹ J_tᵀ is symmetric and not negative. A contact whose row follows from those
    before it has λ = 0: others already hold it.
    """
    m = matrix.shape[0]
    diagonal = jnp.diagonal(matrix)
    acts = sticks & (diagonal > 0)
    root = jnp.sqrt(jnp.where(acts, diagonal, 1))
    both = acts[:, None] & acts[None]
    unit = jnp.eye(m, dtype=matrix.dtype)
    scaled = jnp.where(both, matrix / root[:, None] / root[None], unit)
    rows = jnp.concatenate([scaled, jnp.where(acts, needed / root, 0)[:, None]], axis=1)
    # Rows that follow from others leave a pivot of a few roundings.
    least = math.sqrt(jnp.finfo(matrix.dtype).eps) * 1e-2
    independent = []
    for k in range(m):
        fine = rows[k, k] > least
        pivot = jnp.where(fine, rows[k] / jnp.where(fine, rows[k, k], 1), 0)
        rows = rows - (rows[:, k] - unit[k])[:, None] * pivot[None]
        independent.append(fine)
    free = jnp.stack(independent)
    return Held(jnp.where(acts & free, rows[:, m], 0) / root, jnp.any(acts & ~free))


def inverses(
    mass: Float[Array, "n n"], drive: Float[Array, " n"], jacobian: Float[Array, "m n"]
) -> tuple[Float[Array, " n"], Float[Array, "n m"]]:
    """Return M⁻¹ times the generalised forces `drive`, and M⁻¹ J_tᵀ."""
    columns = solve_mass(mass, jnp.concatenate([drive[:, None], jacobian.T], axis=1))
    return columns[:, 0], columns[:, 1:]
