"""Products of matrices with full precision, of few numbers and in place, and of spins."""

from __future__ import annotations

import functools
import operator
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .elementary import nonzero


def contraction(a: Float[Array, "..."], b: Float[Array, "..."]) -> Float[Array, "..."]:
    """Return Σ a b over the last axis of a and the first of b, with the full precision.

    GPUs would otherwise use only ten bits of each float32 number.
    """
    return jnp.tensordot(a, b, 1, precision=jax.lax.Precision.HIGHEST)


Product = Callable[[Array, Array], Array]

_SMALL = 1024
"""Multiplications up to which a product is faster without a library call."""


@jax.custom_jvp
def small_product(a: Float[Array, "..."], b: Float[Array, "..."]) -> Float[Array, "..."]:
    """Return `contraction(a, b)`, for loops over few numbers.

    A matrix library takes a microsecond per call and keeps the compiler from fusing the code around
    it. It is used for batches, and for the tangents of a derivative, which are many.
    """
    if a.size * (b.size // b.shape[0]) > _SMALL:
        return contraction(a, b)
    return _alone(a, b)


@jax.custom_batching.custom_vmap
def _alone(a: Float[Array, "..."], b: Float[Array, "..."]) -> Float[Array, "..."]:
    left = a.reshape(*a.shape, *[1] * (b.ndim - 1))
    right = b.reshape(*[1] * (a.ndim - 1), *b.shape)
    return jnp.sum(left * right, axis=a.ndim - 1)


@_alone.def_vmap
def _in_a_batch(
    size: int, batched: list[bool], a: Float[Array, "..."], b: Float[Array, "..."]
) -> tuple[Float[Array, "..."], bool]:
    axes = tuple(0 if along else None for along in batched)
    return jax.vmap(contraction, in_axes=axes)(a, b), True


@functools.partial(small_product.defjvp, symbolic_zeros=True)
def _small_product_jvp(primals: tuple, tangents: tuple) -> tuple:
    return _product_jvp(small_product, contraction, primals, tangents)


def _product_jvp(value: Product, change: Product, primals: tuple, tangents: tuple) -> tuple:
    (a, b), (da, db) = primals, tangents
    changes = [change(da, b)] if nonzero(da) else []
    changes += [change(a, db)] if nonzero(db) else []
    return value(a, b), functools.reduce(operator.add, changes)


@jax.custom_jvp
def product_in_place(a: Float[Array, "..."], b: Float[Array, "..."]) -> Float[Array, "..."]:
    """Return Σ a b over the last axis of a and the same axis of b. Axes before it are a batch.

    `vmap` of `contraction` over b alone moves its contracted axis to the front with every call. For
    the directions of a derivative this took eleven times as long as the product of a batch.
    Differentiable in forward mode.
    """
    return _in_place(a, b)


@jax.custom_batching.custom_vmap
def _in_place(a: Float[Array, "..."], b: Float[Array, "..."]) -> Float[Array, "..."]:
    batch = tuple(range(a.ndim - 1))
    dimensions = (((a.ndim - 1,), (a.ndim - 1,)), (batch, batch))
    return jax.lax.dot_general(a, b, dimensions, precision=jax.lax.Precision.HIGHEST)


@_in_place.def_vmap
def _in_a_larger_batch(
    size: int, batched: list[bool], a: Float[Array, "..."], b: Float[Array, "..."]
) -> tuple[Float[Array, "..."], bool]:
    a, b = (
        x if along else jnp.broadcast_to(x, (size, *x.shape))
        for x, along in zip((a, b), batched, strict=True)
    )
    return _in_place(a, b), True


@functools.partial(product_in_place.defjvp, symbolic_zeros=True)
def _product_in_place_jvp(primals: tuple, tangents: tuple) -> tuple:
    return _product_jvp(product_in_place, product_in_place, primals, tangents)


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
