"""Rows of arrays whose numbers are known to be in bounds: without a check of each number."""

from __future__ import annotations

from typing import Any, TypeVar

import jax
import numpy as np
from jaxtyping import Array, Int

Tree = TypeVar("Tree")


def rows_of(arrays: Tree, who: Array | np.ndarray) -> Tree:
    """Some rows of all arrays of a tree, all of which exist."""

    def some(all: Array) -> Array:
        return all.at[who].get(mode="promise_in_bounds", wrap_negative_indices=False)

    return jax.tree.map(some, arrays)


def with_rows(arrays: Tree, who: Int[Array, " M"], rows: Any) -> Tree:
    """The arrays with some of their rows replaced; a number beyond the last row is nobody's. No
    number comes twice.
    """

    def put(all: Array, some: Array) -> Array:
        place = all.at[who]
        return place.set(some, mode="drop", unique_indices=True, wrap_negative_indices=False)

    return jax.tree.map(put, arrays, rows)


def with_row(arrays: Tree, which: Int[Array, ""], row: Any) -> Tree:
    """The arrays with one row replaced, which exists."""

    def put(all: Array, one: Array) -> Array:
        start = (which, *(0,) * (all.ndim - 1))
        one = one.astype(all.dtype)[None]
        return jax.lax.dynamic_update_slice(all, one, start, allow_negative_indices=False)

    return jax.tree.map(put, arrays, row)
