"""The form of any law: its force in SI units, scaled."""

from __future__ import annotations

import functools
from typing import Any, Protocol

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import ArrayLike

from .._entry import as_parameter
from .base import AbstractForm, Exponent, Flag, Lane
from .scale import ContactLike, Scale


class HasForce(Protocol):
    """The part of a law's interface that the form uses."""

    @property
    def tension(self) -> bool:
        """True if its force pulls where it is negative."""
        ...

    def force(
        self, indentation: Any, velocity: Any, contact: Any, impact_velocity: Any
    ) -> ArrayLike:
        """Return the force in N at an indentation in m and velocities in m/s."""
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
        """True if the law may clamp its own force to zero; the package's laws do not clamp here."""
        return not (self.tension or self.law.tension)

    def continued(self, x: Lane, v: Lane) -> ContinuedForm:
        """Return the same form, continued from the state (x, v) where the law clamps its force."""
        return ContinuedForm(
            law=self.law, contact=self.contact, scale=self.scale, tension=self.tension, x=x, v=v
        )


class ContinuedForm(GeneralForm):
    """A form whose force follows its tangent at (x, v) wherever the law clamps it to zero.

    A force that is zero beyond the end of a contact has no slope there, but the stages of the last
    step lie on both sides of the end.
    """

    x: Lane
    v: Lane

    @property
    def may_clamp(self) -> bool:
        """False: the clamp is replaced."""
        return False

    def force(self, x: Lane, v: Lane, n: Exponent, compressing: Flag) -> Lane:
        force = functools.partial(super().force, n=n, compressing=compressing)
        value, change = jax.jvp(force, (self.x, self.v), (x - self.x, v - self.v))
        clamped = force(x, v)
        return jnp.where((clamped == 0) & ~compressing, value + change, clamped)
