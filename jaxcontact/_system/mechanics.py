"""Gaps, contact forces and accelerations of a mechanism in SI units."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._coupled.modes import PerContact
from .._coupled.scalars import Number
from .mass_matrix import solve_mass
from .system import System

Vector = Float[Array, " n"]


class SystemMotion(NamedTuple):
    """The accelerations v', and the power in W of all forces but normal contact forces. It includes
    that of moving surfaces, and ½ v·M' v.
    """

    acceleration: Vector
    power: Number


class Opening(NamedTuple):
    """Gaps in m, their rates in m/s, and the map from contact forces to generalised ones."""

    gap: PerContact
    rate: PerContact
    pull: Callable[[PerContact], tuple[Vector]]


class Mechanics(eqx.Module):
    """The equations of a `System` with its `args`."""

    system: System
    args: Any

    def rate(self, t: Number, q: Vector, v: Vector) -> Vector:
        """Return q'."""
        return v if self.system.rate is None else self.system.rate(t, q, v, self.args)

    def mass(self, t: Number, q: Vector) -> Float[Array, "n n"]:
        return self.system.mass(t, q, self.args)

    def gaps(self, t: Number, q: Vector, v: Vector) -> tuple[PerContact, PerContact]:
        """Return gaps and their rates."""
        along = jnp.ones_like(t), self.rate(t, q, v)
        return jax.jvp(lambda t, q: self.system.gap(t, q, self.args), (t, q), along)

    def opening(self, t: Number, q: Vector, v: Vector) -> Opening:
        """Return gaps and their rates, with the transposed contact Jacobian."""

        def of_speed(v: Vector) -> tuple[PerContact, PerContact]:
            gap, rate = self.gaps(t, q, v)
            return rate, gap

        rate, pull, gap = jax.vjp(of_speed, v, has_aux=True)
        return Opening(gap, rate, pull)

    def jacobian(self, opening: Opening) -> Float[Array, "m n"]:
        """Return the contact Jacobian J, the rates of gaps by v."""
        return jax.vmap(opening.pull)(jnp.eye(opening.gap.shape[0], dtype=opening.gap.dtype))[0]

    def motion(
        self, t: Number, q: Vector, v: Vector, opening: Opening, force: PerContact
    ) -> SystemMotion:
        """Return the motion under contact forces in N."""

        def mass_at(t: Number, q: Vector) -> Array:
            return self.mass(t, q)

        along = jnp.ones_like(t), self.rate(t, q, v)
        mass, changes = jax.jvp(mass_at, (t, q), along)
        others = self.system.force(t, q, v, self.args)
        if self.system.friction is not None:
            others = others + self.friction(t, q, v, force)
        (pull,) = opening.pull(force)
        acceleration = solve_mass(mass, others + pull)
        # The power that contacts give to moving surfaces, F·∂g/∂t.
        surfaces = jnp.sum(force * opening.rate) - jnp.sum(pull * v)
        power = jnp.sum(others * v) + jnp.sum(v * (changes @ v)) / 2 - surfaces
        return SystemMotion(acceleration, power)

    def friction(self, t: Number, q: Vector, v: Vector, force: PerContact) -> Vector:
        """Return the generalised friction forces."""
        slip, friction = self.system.slip, self.system.friction
        assert slip is not None and friction is not None
        speeds, pull = jax.vjp(lambda v: slip(t, q, v, self.args), v)
        return pull(friction.force(force, speeds))[0]

    def second(self, t: Number, q: Vector, v: Vector, acceleration: Vector) -> PerContact:
        """Return the second rates of the gaps."""
        along = jnp.ones_like(t), self.rate(t, q, v), acceleration
        return jax.jvp(lambda *at: self.gaps(*at)[1], (t, q, v), along)[1]

    def effective_mass(self, t: Number, q: Vector, v: Vector) -> PerContact:
        """Return 1/(J M⁻¹ Jᵀ) of every gap, each with the others open. Where J is zero a
        contact does not act on the mechanism, and the value is 1.
        """
        jacobian = self.jacobian(self.opening(t, q, v))
        compliance = jnp.sum(jacobian * solve_mass(self.mass(t, q), jacobian.T).T, axis=1)
        moves = compliance > 0
        return jnp.where(moves, 1 / jnp.where(moves, compliance, 1), 1)

    def kinetic(self, t: Number, q: Vector, v: Vector) -> Number:
        """Return ½ v·M v in J."""
        return jnp.sum(v * (self.mass(t, q) @ v)) / 2
