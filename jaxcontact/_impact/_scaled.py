"""The outcome of an impact in its own units, where K = m = v0 = 1."""

from __future__ import annotations

import equinox as eqx
from jaxtyping import Array, Bool, Float, Int


class Scaled(eqx.Module):
    """Outcome of a scaled impact. The energy lost is 1 - e² in units of the initial energy."""

    restitution: Float[Array, "..."]
    duration: Float[Array, "..."]
    compression_time: Float[Array, "..."]
    max_indentation: Float[Array, "..."]
    max_force: Float[Array, "..."]
    converged: Bool[Array, "..."]
    settled: Bool[Array, "..."]
    error_estimate: Float[Array, "..."] | None = None
    steps: Int[Array, "..."] | None = None
