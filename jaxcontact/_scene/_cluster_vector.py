"""The state of a coupled solve as one vector: where in it its parts lie."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from ._touching import PerBody, PerPair


class Parts(NamedTuple):
    """Where in the vector of a state its parts lie; without damping nothing is `lost`."""

    bodies: int
    dim: int
    pairs: int
    damped: bool

    def packed(
        self, moved: PerBody, velocity: PerBody, lost: PerPair, rest: list[Float[Array, ""]]
    ) -> Float[Array, " numbers"]:
        """Of `rest`: the work, the time and w."""
        taken = [lost] if self.damped else []
        return jnp.concatenate([moved.ravel(), velocity.ravel(), *taken, jnp.stack(rest)])

    def moved(self, y: Array) -> PerBody:
        return y[: self.bodies * self.dim].reshape(self.bodies, self.dim)

    def velocity(self, y: Array) -> PerBody:
        m = self.bodies * self.dim
        return y[m : 2 * m].reshape(self.bodies, self.dim)

    def lost(self, y: Array) -> PerPair:
        if not self.damped:
            return jnp.zeros(self.pairs, y.dtype)
        return y[2 * self.bodies * self.dim : -3]


WORK, TIME, W = -3, -2, -1
