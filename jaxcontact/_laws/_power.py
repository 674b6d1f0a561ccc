"""Powers of the indentation, right in value and derivative at the moment of touch."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float


def power(x: Float[Array, "..."], exponent: float | Float[Array, "..."]) -> Float[Array, "..."]:
    """`x^exponent` for x ≥ 0 and zero for x < 0, with a finite derivative everywhere.

    The derivative at x = 0 is the one from the right where that is finite (0 for an exponent above
    1, 1 for an exponent of 1) and 0, by definition, where it is not (an exponent between 0 and 1).
    A Python exponent that is a multiple of 1/4 is built from products and square roots, which is
    several times faster than a general power.
    """
    if isinstance(exponent, float | int):
        if exponent == 0:
            return jnp.where(x >= 0, jnp.ones_like(x), 0)
        quarters = 4 * exponent
        if quarters == int(quarters) and 0 < quarters <= 64:
            return _quarter_power(x, int(quarters))
    positive = x > 0
    # The inner `where` keeps log(0) out of the branch that is not taken, and so out of its tangent.
    return jnp.where(positive, jnp.power(jnp.where(positive, x, 1), exponent), 0)


def _quarter_power(x: Float[Array, "..."], quarters: int) -> Float[Array, "..."]:
    whole, rest = divmod(quarters, 4)
    if rest == 0:
        return jnp.where(x >= 0, x, 0) ** whole
    positive = x > 0
    safe = jnp.where(positive, x, 1)
    root = jnp.sqrt(safe)
    fraction = {1: jnp.sqrt(root), 2: root, 3: root * jnp.sqrt(root)}[rest]
    return jnp.where(positive, fraction * safe**whole if whole else fraction, 0)
