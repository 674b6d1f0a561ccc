"""How long the next step of an adaptive solve of scenes may be."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

State = Float[Array, " numbers"]
_ORDER = 8
"""Of the Runge-Kutta method."""


def factor(error: Float[Array, ""]) -> Float[Array, ""]:
    """By how much the next step may be longer; `error` is in units of what is allowed."""
    safe = jnp.where(jnp.isfinite(error), jnp.maximum(error, 1e-12), 1e12)
    return jnp.clip(0.9 * safe ** (-1 / _ORDER), 0.2, 5.0)
