"""Products of vectors with spins: one number in the plane, (1,), a vector in space, (3,)."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

Lane = Float[Array, "..."]


def spin_axes(dimensions: int) -> int:
    """Return the number of components of a spin."""
    return 1 if dimensions == 2 else 3


def cross(one: Lane, other: Lane) -> Lane:
    """Return the product of two vectors (..., D) as a spin (..., S)."""
    if one.shape[-1] == 3:
        return jnp.cross(one, other)
    return (one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0])[..., None]


def swept(spin: Lane, arm: Lane) -> Lane:
    """Return the velocity ω × r (..., D) of a spin (..., S) at an arm (..., D)."""
    if arm.shape[-1] == 3:
        return jnp.cross(spin, arm)
    return spin * jnp.stack([-arm[..., 1], arm[..., 0]], axis=-1)
