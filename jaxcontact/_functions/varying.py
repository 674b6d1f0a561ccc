"""Constants that count as different in every lane, so that loops are traced once."""

from __future__ import annotations

from typing import TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

Tree = TypeVar("Tree")


def varying(number: Float[Array, ""], tree: Tree) -> Tree:
    """Return `tree` unchanged, but formally dependent on `number` and thus on its lane.

    The start of a loop is often a constant that differs between lanes from the first pass on. Under
    `vmap` JAX detects that by tracing the body, and all loops in it, once more for each loop. The
    compiler removes the choice between equal values.
    """
    either = jnp.isnan(jax.lax.stop_gradient(number))
    return jax.tree.map(lambda leaf: jnp.where(either, leaf, leaf), tree)
