"""The loss: squares, or Huber's loss for data with outliers."""

from __future__ import annotations

import dataclasses
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..._entry import POSITIVE, require_number


@dataclasses.dataclass(frozen=True)
class Huber:
    """Squares up to `threshold` standard deviations, absolute values beyond.

    ρ(z) = z²/2 for |z| ≤ k, k |z| - k²/2 beyond. With k = 1.345 it loses 5 % of the efficiency of
    squares if there are no outliers. Raises ValueError unless `threshold` is positive.

    Source: Huber (1964), Ann. Math. Stat. 35:73, doi 10.1214/aoms/1177703732.
    """

    threshold: float = 1.345

    def __post_init__(self) -> None:
        threshold = require_number("threshold", self.threshold, POSITIVE)
        object.__setattr__(self, "threshold", threshold)


def shortened(
    z: Float[Array, " n"], threshold: Float[Array, ""] | None, xp: Any = jnp
) -> Float[Array, " n"]:
    """Return residuals whose squares are twice the loss: z itself, or ±√(2ρ(z)).

    `xp` is JAX or NumPy.
    """
    if threshold is None:
        return z
    far = xp.abs(z) > threshold
    size = xp.where(far, xp.abs(z), 2 * threshold)
    return xp.where(far, xp.sign(z) * xp.sqrt(threshold * (2 * size - threshold)), z)


def shortened_slope(
    z: Float[Array, " n"],
    jacobian: Float[Array, "n k"],
    threshold: Float[Array, ""] | None,
    xp: Any = jnp,
) -> Float[Array, "n k"]:
    """Return the derivative of `shortened` residuals from that of z, 0 where that is not finite.

    Zeros hide no failure: where the prediction is not finite, the loss is not finite either.
    """
    usable = xp.where(xp.isfinite(jacobian), jacobian, 0)
    if threshold is None:
        return usable
    # d√(2ρ)/dz = ψ/r, which is 1 where ρ is a square.
    far = xp.abs(z) > threshold
    r = xp.where(far, xp.abs(shortened(z, threshold, xp)), 1)
    return usable * xp.where(far, threshold / r, 1)[:, None]
