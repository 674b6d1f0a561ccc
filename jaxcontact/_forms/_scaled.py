"""The outcome of an impact in its own units, where K = m = v0 = 1."""

from __future__ import annotations

import equinox as eqx
from jaxtyping import Array, Bool, Float, Int


class ScaledImpact(eqx.Module):
    """The outcome of x'' = Γ - f(x, x'), x(0) = 0, x'(0) = 1, in the units of the scaled problem.

    `restitution` e; `duration` until separation and `compression_time` until the turn, in units of
    X/v0; `max_indentation` in X and `max_force` in m v0²/X, with X = (m v0²/K)^(1/(n+1)).
    `converged`: whether the numbers can be trusted; `settled`: whether the bodies stay together.
    `error_estimate` (relative, of restitution and duration) and `steps` for methods that have them.
    """

    restitution: Float[Array, "..."]
    duration: Float[Array, "..."]
    compression_time: Float[Array, "..."]
    max_indentation: Float[Array, "..."]
    max_force: Float[Array, "..."]
    converged: Bool[Array, "..."] | bool = True
    settled: Bool[Array, "..."] | bool = False
    error_estimate: Float[Array, "..."] | None = None
    steps: Int[Array, "..."] | None = None
