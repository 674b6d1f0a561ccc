"""Access to array rows whose indices are known to be in bounds, without checks."""

from __future__ import annotations

from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from .modes import Index

Tree = TypeVar("Tree")
_Mode = jax.lax.GatherScatterMode


def rows_of(arrays: Tree, who: Array | np.ndarray) -> Tree:
    """Return some rows, or one row, of all arrays of a tree; all of them must exist."""
    if who.ndim == 0:
        return jax.tree.map(
            lambda all: jax.lax.dynamic_index_in_dim(
                all, who, keepdims=False, allow_negative_indices=False
            ),
            arrays,
        )
    place = _indices(who)

    def take(all: Array) -> Array:
        inner = tuple(range(who.ndim, who.ndim + all.ndim - 1))
        numbers = jax.lax.GatherDimensionNumbers(inner, (0,), (0,))
        return jax.lax.gather(
            all, place, numbers, (1, *all.shape[1:]), mode=_Mode.PROMISE_IN_BOUNDS
        )

    return jax.tree.map(take, arrays)


def with_rows(arrays: Tree, who: Int[Array, " M"], rows: Any) -> Tree:
    """Return the arrays with some rows replaced; indices beyond the last row are ignored. No index
    may occur twice.
    """
    place = _indices(who)

    def put(all: Array, new_rows: Array) -> Array:
        numbers = jax.lax.ScatterDimensionNumbers(tuple(range(1, all.ndim)), (0,), (0,))
        new = new_rows.astype(all.dtype)
        return jax.lax.scatter(
            all, place, new, numbers, unique_indices=True, mode=_Mode.FILL_OR_DROP
        )

    return jax.tree.map(put, arrays, rows)


def with_one_or_two(arrays: Tree, who: Int[Array, " M"], rows: Any) -> Tree:
    """Return the arrays with one existing row replaced, or two. Of two, indices beyond the last row
    are ignored; the second one is if the first is.

    There is no scatter, with which XLA would not compile a small loop as one function.
    """
    there = who < jax.tree.leaves(arrays)[0].shape[0]
    starts = [jax.lax.index_in_dim(who, k, keepdims=False) for k in range(who.shape[0])]

    def put(all: Array, new: Array, *old: Array) -> Array:
        new = new.astype(all.dtype)
        if old:
            flags = there if all.ndim == 1 else jax.lax.broadcast_in_dim(there, new.shape, (0,))
            new = jax.lax.select(flags, new, *old)
        # XLA moves a row from beyond the end to the last one, where the first may be.
        for k in reversed(range(len(starts))):
            start = (starts[k], *(0,) * (all.ndim - 1))
            row = jax.lax.slice_in_dim(new, k, k + 1)
            all = jax.lax.dynamic_update_slice(all, row, start, allow_negative_indices=False)
        return all

    return jax.tree.map(put, arrays, rows, *[rows_of(arrays, who)][: len(starts) - 1])


def _indices(who: Array | np.ndarray) -> Array:
    """Return row indices in the form for gathers and scatters, made once for all arrays."""
    return jnp.asarray(who, np.int32)[..., None]


def with_row(arrays: Tree, which: Index, row: Any) -> Tree:
    """Return the arrays with one existing row replaced."""

    def put(all: Array, new_row: Array) -> Array:
        start = (which, *(0,) * (all.ndim - 1))
        new_row = new_row.astype(all.dtype)[None]
        return jax.lax.dynamic_update_slice(all, new_row, start, allow_negative_indices=False)

    return jax.tree.map(put, arrays, row)
