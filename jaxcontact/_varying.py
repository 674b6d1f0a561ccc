"""Constants that count as different in every lane, so that loops are traced once."""

from __future__ import annotations

from typing import TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

Tree = TypeVar("Tree")


def varying(number: Float[Array, ""], tree: Tree) -> Tree:
    """`tree` as it is, but dependent on `number` and so on its lane, if only formally.

    What a loop starts with is often a constant that differs from lane to lane from the first pass
    on. Under `vmap` JAX finds that out by tracing the body, and all loops in it, once more for
    each loop. The compiler removes the choice between equals.
    """
    either = jnp.isnan(jax.lax.stop_gradient(number))
    return jax.tree.map(lambda leaf: jnp.where(either, leaf, leaf), tree)
