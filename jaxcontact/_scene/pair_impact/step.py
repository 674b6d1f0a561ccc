"""Step size control of the adaptive solves of scenes."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

State = Float[Array, " numbers"]
_ORDER = 8
"""The order of the Runge-Kutta method."""


def factor(error: Float[Array, ""]) -> Float[Array, ""]:
    """Return the factor for the next step size; `error` is in units of the allowed error."""
    safe = jnp.where(jnp.isfinite(error), jnp.maximum(error, 1e-12), 1e12)
    return jnp.clip(0.9 * safe ** (-1 / _ORDER), 0.2, 5.0)
