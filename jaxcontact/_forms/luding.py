"""The form of Luding's linear, elastic-plastic and adhesive contact, for free impacts.

In scaled units x_m = 1. With κ = K_u/K and η = K_c/K the force is x while loading, κ (x - x_0) with
x_0 = 1 - 1/κ on the way back, and -ηx from x_min = (κ-1)/(κ+η), where the two meet, to x = 0. The
three parts are oscillations and a hyperbolic motion.
"""

from __future__ import annotations

import math
from typing import NoReturn

import equinox as eqx
import jax.numpy as jnp

from .._functions import horner
from .base import AbstractForm, Exponent, Flag, Lane
from .scale import ScaledImpact

_SWITCH = 0.1
# The first omitted term is below half an ulp of float64 at the switch.
_SERIES = tuple(1 / (2 * k + 1) for k in range(16))


class LudingForm(AbstractForm):
    """The contact with κ = `factor` + `slope`, since x_m = 1, and η = `adhesion`."""

    factor: Lane
    slope: Lane
    adhesion: Lane
    tension: bool = eqx.field(static=True, default=True, kw_only=True)

    def force(self, x: Lane, v: Lane, n: Exponent, compressing: Flag) -> Lane:
        refuse_motion()

    def _square(self) -> Lane:
        """Return e², negative if the bodies stick."""
        factor, adhesion = self.factor + self.slope, self.adhesion
        return (1 - adhesion * (factor - 2)) / (factor + adhesion)

    def restitution(self) -> Lane:
        square = self._square()
        sticks = square <= 0
        return jnp.where(sticks, 0, jnp.sqrt(jnp.where(sticks, 1, square)))

    def solve(self, n: Exponent) -> ScaledImpact:
        """Return a quarter of an oscillation, a part of a stiffer one and the hyperbolic end."""
        factor, adhesion, square = self.factor + self.slope, self.adhesion, self._square()
        sticks, one = square <= 0, jnp.ones_like(square)
        least = (factor - 1) / (factor + adhesion)
        pull = adhesion * least
        # Bodies that part pull with less than 1.
        sine = jnp.where(sticks, 0, pull)
        energy = (1 - sine) * (1 + sine) / factor
        stiff = (math.pi / 2 + jnp.arcsin(sine)) / jnp.sqrt(factor)
        left = jnp.where(sticks, 1, square / energy)
        share = jnp.where(sticks, 0, adhesion * jnp.square(least) / energy)
        adhesive = least / jnp.sqrt(energy) * _artanh_over(share, left)
        return ScaledImpact(
            restitution=self.restitution(),
            duration=math.pi / 2 + stiff + adhesive,
            compression_time=math.pi / 2 * one,
            max_indentation=one,
            max_force=one,
            settled=sticks,
            energy_loss=(factor - 1) * (1 + adhesion) / (factor + adhesion),
            # A stronger adhesion is not reached: the bodies oscillate on the way back.
            min_force=-jnp.minimum(pull, 1),
        )


def _artanh_over(z: Lane, left: Lane) -> Lane:
    """Return artanh(√z)/√z, 0 ≤ z < 1, for z and `left` = 1 - z."""
    small = z < _SWITCH
    root = jnp.sqrt(jnp.where(small, 1, z))
    closed = (jnp.log1p(root) - jnp.log(jnp.where(small, 1, left)) / 2) / root
    return jnp.where(small, horner(_SERIES, jnp.where(small, z, 0)), closed)


def refuse_motion() -> NoReturn:
    """Raise ValueError: the contact is not followed in time."""
    raise ValueError(
        "Argument `law` must be a law that is followed in time here, but is `Luding`: it is solved "
        "by formula for impacts of two bodies without an external force."
    )
