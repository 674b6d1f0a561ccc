"""The Hunt-Crossley law with a hysteresis damping factor c that is a power of the closing speed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from .._entry import NOT_NEGATIVE, POSITIVE, REAL, parameter
from .base import contact_for, speed_for
from .hunt_crossley import AbstractHuntCrossley
from .registry import register_law

if TYPE_CHECKING:
    from .._contact import Contact


@register_law(
    "power_damping",
    formula="c (v0/v_r)^p v0/K",
    source="Hunt & Crossley 1975, doi 10.1115/1.3423596, with c a power of the speed",
    valid="c ≥ 0; e falls with speed for p > -1, constant at p = -1",
)
class PowerDamping(AbstractHuntCrossley):
    """A damping factor that depends on the closing speed: F = K δⁿ + c (v0/v_r)^p δⁿ δ'.

    α = c (v0/v_r)^p v0/K. `c` ≥ 0 in N s/m^(n+1) is the damping factor at the reference speed.
    `power` p is dimensionless; p = 0 gives a constant c, p = -1 a constant e. `reference` v_r > 0
    in m/s. Raises ValueError for a Python scalar out of range. Source: Hunt & Crossley (1975), J.
    Appl. Mech. 42:440, doi 10.1115/1.3423596, for the force; the power is empirical.
    """

    c: Float[Array, "..."] = parameter("c", NOT_NEGATIVE, "N s/m^(n+1)")
    power: Float[Array, "..."] = parameter("power", REAL)
    reference: Float[Array, "..."] = parameter("reference", POSITIVE, "m/s")

    def damping_factor(
        self, contact: Contact | None = None, velocity: ArrayLike | None = None
    ) -> Float[Array, "..."]:
        """Return α = c (v0/v_r)^p v0/K; ValueError if `contact` or `velocity` is missing."""
        stiffness = contact_for(contact, self).stiffness
        speed = speed_for(velocity, self)
        return self.c * jnp.exp(self.power * jnp.log(speed / self.reference)) * speed / stiffness
