"""Powers with a finite derivative everywhere."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from .._entry import as_parameter, is_plain


def power(x: ArrayLike, exponent: ArrayLike) -> Float[Array, "..."]:
    """Return `x^exponent` for x ≥ 0 and zero for x < 0, with a finite derivative everywhere.

    At x = 0 the derivative is the one from the right if that is finite: 0 for an exponent above 1,
    and 1 for an exponent of 1. For an exponent between 0 and 1 it is infinite and is defined to be
    0. A Python or NumPy exponent that is a multiple of 1/4 is computed from products and square
    roots, several times faster than a general power. Raises ValueError for anything that is not a
    number.
    """
    x, given = as_parameter(x, "x"), as_parameter(exponent, "exponent")
    if not is_plain(exponent):
        exponent = given
    else:
        exponent = float(exponent)
        if exponent == 0:
            return jnp.where(x >= 0, jnp.ones_like(x), 0)
        quarters = 4 * exponent
        if quarters == int(quarters) and 0 < quarters <= 64:
            return _quarter_power(x, int(quarters))
    positive = x > 0
    # The inner `where` keeps log(0) out of the unused branch and thus out of its tangent. As for a
    # concrete exponent, x^0 is 1 and x^1 is x, including its slope at zero.
    edge = jnp.where(exponent == 1, x, jnp.where(exponent == 0, 1, 0))
    inside = jnp.power(jnp.where(positive, x, 1), exponent)
    return jnp.where(positive, inside, jnp.where(x == 0, edge, 0))


def _quarter_power(x: Float[Array, "..."], quarters: int) -> Float[Array, "..."]:
    whole, rest = divmod(quarters, 4)
    if rest == 0:
        return jnp.where(x >= 0, x, 0) ** whole
    positive = x > 0
    safe = jnp.where(positive, x, 1)
    root = jnp.sqrt(safe)
    fraction = {1: jnp.sqrt(root), 2: root, 3: root * jnp.sqrt(root)}[rest]
    return jnp.where(positive, fraction * safe**whole if whole else fraction, 0)
