"""Step size control and the search for events in the adaptive solves of scenes."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..._solver.march import _SAFETY, _SHRINKS
from ..scalars import Flag, Number

State = Float[Array, " numbers"]


def factor(error: Number) -> Number:
    """Return the factor for the next step size; `error` is in units of the allowed error."""
    safe = jnp.where(jnp.isfinite(error), jnp.maximum(error, 1e-12), 1e12)
    return jnp.clip(_SAFETY / jnp.sqrt(jnp.sqrt(jnp.sqrt(safe))), _SHRINKS, 5.0)


def onward(
    size: Number, free: Number, grown: Number, left: Number, fine: Flag, passed: Flag, sought: Flag
) -> tuple[Number, Number]:
    """Return the next step, and the size that the error alone allows, `free` and `grown` before and
    after this step. A step that `passed` an event is repeated up to it, which is `left` from its
    end, or halved. The step after it ends on the event that is still `sought`.
    """
    target = size + left
    back = jnp.where((target > 0.01 * size) & (target < size), target, size / 2)
    # The error of a step that was cut short says nothing about the next one, unless that may grow.
    free = jnp.where(fine & passed, free, jnp.where(fine & sought, jnp.maximum(free, grown), grown))
    ahead = jnp.where(sought & (left > 0), jnp.minimum(left, free), free)
    return jnp.where(fine, jnp.where(passed, back, ahead), free), free
