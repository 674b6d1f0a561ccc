"""The form of any law: its force in SI units, scaled."""

from __future__ import annotations

import functools
from typing import Any, Protocol

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import ArrayLike

from .._parameter import as_parameter
from ._base import AbstractForm, Exponent, Flag, Lane
from ._scale import ContactLike, Scale


class HasForce(Protocol):
    """What the form needs of a law."""

    @property
    def tension(self) -> bool:
        """Whether its force pulls where it is negative."""
        ...

    def force(
        self, indentation: Any, velocity: Any, contact: Any, impact_velocity: Any
    ) -> ArrayLike:
        """The force in N at an indentation in m and velocities in m/s."""
        ...


class GeneralForm(AbstractForm):
    """f = F(X x, v0 v) in units of m v0²/X, for the SI force F of a law."""

    law: HasForce
    contact: ContactLike
    scale: Scale
    tension: bool = eqx.field(static=True)

    def force(self, x: Lane, v: Lane, n: Exponent, compressing: Flag) -> Lane:
        scale = self.scale
        force = self.law.force(scale.length * x, scale.speed * v, self.contact, scale.speed)
        return as_parameter(force, "force") / scale.force

    @property
    def may_clamp(self) -> bool:
        """Whether the law may clamp its own force to zero, which none of the package does here."""
        return not (self.tension or self.law.tension)

    def continued(self, x: Lane, v: Lane) -> ContinuedForm:
        """The same, but continued where the law clamps its force, from a state with a force."""
        return ContinuedForm(
            law=self.law, contact=self.contact, scale=self.scale, tension=self.tension, x=x, v=v
        )


class ContinuedForm(GeneralForm):
    """The form whose force goes on along its tangent at (x, v) where the law clamps it to zero.

    A force that is zero beyond the end of a contact has no slope there, and the stages of a step
    that ends with the contact lie on both sides.
    """

    x: Lane
    v: Lane

    @property
    def may_clamp(self) -> bool:
        """No longer."""
        return False

    def force(self, x: Lane, v: Lane, n: Exponent, compressing: Flag) -> Lane:
        force = functools.partial(super().force, n=n, compressing=compressing)
        value, change = jax.jvp(force, (self.x, self.v), (x - self.x, v - self.v))
        clamped = force(x, v)
        return jnp.where((clamped == 0) & ~compressing, value + change, clamped)
