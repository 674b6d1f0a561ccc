"""The equations of a mechanism from its Lagrangian, by automatic differentiation.

With p = ∂L/∂v and M = ∂p/∂v, the equations M v' = ∂L/∂q - ∂p/∂q v - ∂p/∂t + Q hold for generalised
forces Q.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array


class LagrangianMass(eqx.Module):
    """M(t, q) = ∂²L/∂v². L is quadratic in v, so that any v gives it."""

    lagrangian: Callable[..., Array]

    def __call__(self, t: Array, q: Array, args: Any) -> Array:
        momentum = jax.grad(self.lagrangian, argnums=2)
        return jax.jacfwd(lambda v: momentum(t, q, v, args))(jnp.zeros_like(q))


class LagrangianForce(eqx.Module):
    """All generalised forces but those of contacts."""

    lagrangian: Callable[..., Array]
    forces: Callable[..., Array] | None

    def __call__(self, t: Array, q: Array, v: Array, args: Any) -> Array:
        def momentum(t: Array, q: Array) -> Array:
            return jax.grad(self.lagrangian, argnums=2)(t, q, v, args)

        pull = jax.grad(self.lagrangian, argnums=1)(t, q, v, args)
        pull = pull - jax.jvp(momentum, (t, q), (jnp.ones_like(t), v))[1]
        return pull if self.forces is None else pull + self.forces(t, q, v, args)


class LagrangianEnergy(eqx.Module):
    """The energy v·p - L in J."""

    lagrangian: Callable[..., Array]

    def __call__(self, t: Array, q: Array, v: Array, args: Any) -> Array:
        value, momentum = jax.value_and_grad(self.lagrangian, argnums=2)(t, q, v, args)
        return jnp.sum(v * momentum) - value
