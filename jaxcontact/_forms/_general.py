"""The form of any law: its force in SI units, scaled."""

from __future__ import annotations

from typing import Any, Protocol

import equinox as eqx
from jaxtyping import ArrayLike

from .._parameter import as_parameter
from ._base import AbstractForm, Exponent, Flag, Lane
from ._scale import ContactLike, Scale


class HasForce(Protocol):
    """What the form needs of a law."""

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
