"""The form of Luding's linear, elastic-plastic and adhesive contact.

With κ = K_u/K and η = K_c/K the force is x while loading, κ (x - x_0) with x_0 = (1 - 1/κ) x_m on
the way back, and -ηx from x_min = x_m (κ-1)/(κ+η), where the two meet, to x = 0. In a free impact
x_m = 1, and the three parts are oscillations and a hyperbolic motion.
"""

from __future__ import annotations

import math
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from .._functions import horner
from .base import Exponent, Flag, Lane
from .plastic import BilinearForm
from .scale import ScaledImpact

_SWITCH = 0.1
# The first omitted term is below half an ulp of float64 at the switch.
_SERIES = tuple(1 / (2 * k + 1) for k in range(16))


class LudingForm(BilinearForm):
    """The contact with κ = `factor` + `slope` x_m and η = `adhesion`."""

    adhesion: Lane
    tension: bool = eqx.field(static=True, default=True, kw_only=True)
    never_pulls: ClassVar[bool] = False

    def least(self, deepest: Lane) -> Lane:
        """Return the x_min of the largest indentation, below which the force is -ηx."""
        factor = self.factor + self.slope * deepest
        return deepest * (factor - 1) / (factor + self.adhesion)

    def shrunk(self, x: Lane) -> Lane:
        """Return the largest indentation whose x_min is x."""
        half = (self.factor - 1 - self.slope * x) / 2
        product = x * (self.factor + self.adhesion)
        total = half + jnp.sqrt(jnp.square(half) + self.slope * product)
        return product / jnp.where(total > 0, total, 1)

    def force(self, x: Lane, v: Lane, n: Exponent, compressing: Flag) -> Lane:
        back = super().force(x, v, n, compressing)
        return jnp.where(compressing, back, jnp.maximum(back, -self.adhesion * x))

    def pulling(
        self, w: Lane, v: Lane, n: Exponent, compressing: Flag, order: int | None = None
    ) -> Lane:
        return self.force(w ** (order or self.order(n)), v, n, compressing)

    def stored(self, w: Lane, n: Exponent, order: int | None = None) -> Lane:
        x = w ** (order or self.order(n))
        deepest = x if self.deepest is None else jnp.where(self.deepest > 0, self.deepest, x)
        return self._returned(x, deepest)

    def kept(self, deepest: Lane) -> Lane:
        return self.work(deepest) - self._returned(deepest, deepest)

    def _returned(self, x: Lane, deepest: Lane) -> Lane:
        """Return ∫ f dx from 0 to x on the way back."""
        least, (factor, end) = self.least(deepest), self.unloading(deepest)
        elastic = factor * (x - least) * ((x + least) / 2 - end)
        return (
            jnp.where(x > least, elastic, 0) - self.adhesion * jnp.square(jnp.minimum(x, least)) / 2
        )

    def barrier(self, push: Lane) -> Lane | None:
        deepest = jnp.zeros_like(push) if self.deepest is None else self.deepest
        holds = -push < self.adhesion * self.least(deepest)
        pull, strength = jnp.maximum(-push, 0), jnp.where(holds & (push < 0), self.adhesion, 1)
        return jnp.where(holds, jnp.square(pull) / (2 * strength), -jnp.inf)

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
