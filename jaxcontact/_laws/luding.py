"""Luding's contact of powders: linear, elastic-plastic and adhesive.

With κ = K_u/K and η = K_c/K the scaled force is x while loading, κ (x - x_0) with x_0 = (1 - 1/κ)
x_m on the way back, and -ηx from x_min = x_m (κ-1)/(κ+η), where the two meet, to x = 0. In a free
impact x_m = 1, and the three parts are oscillations and a hyperbolic motion.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from .._entry import NOT_NEGATIVE, parameter
from .._forms import Exponent, Flag, Lane, Scale, ScaledImpact
from .._functions import horner
from .base import Instant, contact_for, needed, require_exponent
from .plastic import STIFFER, AbstractPlastic, BilinearForm
from .registry import register_law

if TYPE_CHECKING:
    from .._contact import Contact

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

    def returned(self, x: Lane, deepest: Lane) -> Lane:
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


@register_law(
    "luding",
    formula="K δ, back the larger of K_u (δ - δ_0) and -K_c δ, K_u = K ratio + slope F_max",
    source="Luding 2008, doi 10.1007/s10035-008-0099-x",
    valid="n = 1; ratio ≥ 1, slope ≥ 0, adhesion ≥ 0; sticks where η (κ - 2) ≥ 1",
)
class Luding(AbstractPlastic):
    """Luding's contact: F = K δ while loading, K_u (δ - δ_0) on the way back, but at least -K_c δ.

    `ratio` ≥ 1 is K_u/K without load. `slope` ≥ 0 in 1/m makes unloading stiffer with the largest
    force, K_u = ratio K + slope F_max, without Luding's upper bound. `adhesion` ≥ 0 is K_c/K. The
    way back begins at the largest indentation δ_m, so that δ_0 = (1 - K/K_u) δ_m. From
    δ_min = δ_m (K_u-K)/(K_u+K_c) on the force is -K_c δ. The contact ends at δ = 0, also without
    adhesion. Hence, with κ = K_u/K and η = K_c/K,

        e² = (1 - η (κ - 2))/(κ + η),

    and bodies with η (κ - 2) ≥ 1 stick: e = 0 and the status is SETTLED. For slope = 0 neither
    depends on the speed. Without damping they would then oscillate for ever. The exponent is 1.

    Free impacts of two bodies are solved by formula, all others in time. A contact that closes
    again from below δ_min loads along K_u from there, as if δ_m had been smaller. Instantaneous
    impacts of scenes, and friction in scenes and mechanisms, raise ValueError.

    Raises ValueError for a Python scalar out of range, for `tension=False`, and, where it is used,
    for another exponent. Source: Luding (2008), Granular Matter 10:235,
    doi 10.1007/s10035-008-0099-x.
    """

    ratio: Float[Array, "..."] = parameter("ratio", STIFFER)
    slope: Float[Array, "..."] = parameter("slope", NOT_NEGATIVE, "1/m")
    adhesion: Float[Array, "..."] = parameter("adhesion", NOT_NEGATIVE)
    tension = True
    forgets: ClassVar[bool] = True
    exponents: ClassVar[tuple[float, ...] | None] = (1.0,)
    _only_tension: ClassVar[tuple[bool, str] | None] = True, "pulls by adhesion"
    damped: ClassVar[bool] = False

    def _over_stiffness(self, contact: Contact) -> LudingForm:
        return self._of_depths()

    def _of_depths(self) -> LudingForm:
        """Return F/K as a form of δ in m."""
        return LudingForm(factor=self.ratio, slope=self.slope, adhesion=self.adhesion)

    def _force_after(self, at: Instant, deepest: ArrayLike) -> Float[Array, "..."]:
        require_exponent(self, at.contact)
        depth, most = jnp.maximum(jnp.asarray(at.indentation), 0), jnp.asarray(deepest)
        factor, end = self._of_depths().unloading(jnp.maximum(most, 0))
        back = jnp.where(most < 0, -self.adhesion * depth, factor * (depth - end))
        return at.contact.stiffness * jnp.where(most == 0, depth, back)

    def _adheres_below(self, largest: ArrayLike) -> Float[Array, "..."]:
        return self._of_depths().least(jnp.asarray(largest))

    def _shrunk(self, indentation: ArrayLike) -> Float[Array, "..."]:
        return self._of_depths().shrunk(jnp.asarray(indentation))

    def form(self, contact: Contact | None, scale: Scale | None) -> LudingForm:
        contact_for(contact, self)
        length = needed(scale, "velocity", self).length
        return LudingForm(factor=self.ratio, slope=self.slope * length, adhesion=self.adhesion)
