"""The Hunt-Crossley family F = K δⁿ (1 + α δ'/v0): its members with α as a parameter, and those
from the energy balance of an impact, with an assumed velocity profile, and exact.
"""

from __future__ import annotations

import abc
import math
from typing import TYPE_CHECKING, ClassVar

import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from .._entry import NOT_NEGATIVE, POSITIVE, REAL, RESTITUTION, parameter
from .._forms import Exponent, HuntCrossleyForm, Lane, Scale, exact_damping_factor
from .._functions import half_gamma_ratio, power
from .base import AbstractDampedLaw, Instant, contact_for, force_arguments, speed_for
from .registry import register_law

if TYPE_CHECKING:
    from .._contact import Contact


class AbstractHuntCrossley(AbstractDampedLaw):
    """A law F = K δⁿ (1 + α δ'/v0), solved in closed form; a subclass returns α.

    In a free impact 1 + α δ'/v0 stays positive. An external pull can make it negative. The force is
    then clamped at zero, unless the law was made with `tension=True`.
    """

    tension = False

    @property
    def refers_to_peak(self) -> bool:
        return self.damped

    def jumps(self, exponent: Exponent) -> bool:
        return False

    @abc.abstractmethod
    def damping_factor(
        self, contact: Contact | None = None, velocity: ArrayLike | None = None
    ) -> Float[Array, "..."]:
        """Return the dimensionless α of F = K δⁿ (1 + α δ'/v0).

        Arguments: the contact and the closing speed v0 in m/s. Both are optional if α depends on
        neither. Raises ValueError if one is needed and missing.
        """

    def _whole_force(self, at: Instant) -> Float[Array, "..."]:
        # v0 has a floor, which keeps α/v0 finite in any system of units.
        contact, (depth, rate, speed) = at.contact, force_arguments(*at)
        least = math.sqrt(jnp.finfo(speed.dtype).tiny)
        # `where`, not `maximum`: the derivative by the floor overflows, and 0 times infinity is
        # NaN.
        speed = jnp.where(speed < least, least, speed)
        elastic = contact.stiffness * power(depth, contact.exponent)
        damping = self.damping_factor(contact, speed) / speed
        factor = 1 + damping * rate
        return elastic * factor

    def _pressing(self, at: Instant, deepest: ArrayLike | None) -> Float[Array, "..."]:
        speed = jnp.asarray(at.impact_velocity)
        alpha = self.damping_factor(at.contact, speed)
        return (1 + alpha * at.velocity / speed) / (1 + alpha)

    def form(self, contact: Contact | None, scale: Scale | None) -> HuntCrossleyForm:
        alpha = self.damping_factor(contact, None if scale is None else scale.speed)
        return HuntCrossleyForm(alpha=alpha, tension=self.tension)


class AbstractOfRestitution(AbstractHuntCrossley):
    """A law of the family whose only parameter is e; a subclass states α as a formula of e."""

    e: Float[Array, "..."] = parameter("e", RESTITUTION)

    @abc.abstractmethod
    def _alpha_of(self, e: Lane) -> Lane:
        """Return α."""

    def damping_factor(
        self, contact: Contact | None = None, velocity: ArrayLike | None = None
    ) -> Float[Array, "..."]:
        return self._alpha_of(self.e)


class SpeedDependentForm(HuntCrossleyForm):
    """The Hunt-Crossley form with an α that depends on the speed; `alpha` is its value at v0."""

    law: AbstractHuntCrossley
    contact: Contact
    scale: Scale

    def alpha_at(self, speed: Lane) -> Lane:
        return self.law.damping_factor(self.contact, self.scale.speed * speed)


@register_law(
    "hertz",
    formula="0",
    source="Hertz 1882, doi 10.1515/crll.1882.92.156",
    valid="elastic contact",
)
class Hertz(AbstractHuntCrossley):
    """The elastic contact, F = K δⁿ (n = 3/2 for Hertzian spheres), with restitution 1.

    Source: Hertz (1882), J. reine angew. Math. 92:156, doi 10.1515/crll.1882.92.156.
    """

    damped: ClassVar[bool] = False

    def damping_factor(
        self, contact: Contact | None = None, velocity: ArrayLike | None = None
    ) -> Float[Array, "..."]:
        return jnp.asarray(0.0)


@register_law("damped", formula="α", source="the family's own parameter", valid="α ≥ 0")
class Damped(AbstractHuntCrossley):
    """The Hunt-Crossley family with α as its parameter: F = K δⁿ (1 + α δ'/v0).

    `alpha` ≥ 0, dimensionless. Raises ValueError for a Python scalar out of range.
    """

    alpha: Float[Array, "..."] = parameter("alpha", NOT_NEGATIVE)

    def damping_factor(
        self, contact: Contact | None = None, velocity: ArrayLike | None = None
    ) -> Float[Array, "..."]:
        return self.alpha


@register_law(
    "constant_damping",
    formula="c v0/K",
    source="Hunt & Crossley 1975, doi 10.1115/1.3423596",
    valid="c ≥ 0; e falls with speed",
)
class ConstantDamping(AbstractHuntCrossley):
    """A constant hysteresis damping factor: F = K δⁿ + c δⁿ δ', so that α = c v0/K.

    `c` ≥ 0 in N s/m^(n+1). Restitution falls with the closing speed. Raises ValueError for a Python
    scalar out of range. Source: Hunt & Crossley (1975), J. Appl. Mech. 42:440,
    doi 10.1115/1.3423596.
    """

    c: Float[Array, "..."] = parameter("c", NOT_NEGATIVE, "N s/m^(n+1)")
    refers_to_peak: ClassVar[bool] = False

    def damping_factor(
        self, contact: Contact | None = None, velocity: ArrayLike | None = None
    ) -> Float[Array, "..."]:
        """Return α = c v0/K; ValueError if `contact` or `velocity` is missing."""
        stiffness = contact_for(contact, self).stiffness
        return self.c * speed_for(velocity, self) / stiffness


@register_law(
    "marhefka_orin",
    formula="3 a v0/2",
    source="Marhefka & Orin 1999, doi 10.1109/3468.798060",
    valid="a v0 small: then e = 1 - a v0",
)
class MarhefkaOrin(AbstractHuntCrossley):
    """A law without v0 in its force: F = K δⁿ (1 + (3/2) a δ'), intended to give e = 1 - a v0.

    `a` ≥ 0 in s/m. Accurate for small a v0; α = (3/2) a v0. Raises ValueError for a Python scalar
    out of range. Source: Marhefka & Orin (1999), IEEE Trans. Syst. Man Cybern. A 29:566,
    doi 10.1109/3468.798060.
    """

    a: Float[Array, "..."] = parameter("a", NOT_NEGATIVE, "s/m")
    refers_to_peak: ClassVar[bool] = False

    def damping_factor(
        self, contact: Contact | None = None, velocity: ArrayLike | None = None
    ) -> Float[Array, "..."]:
        """Return α = (3/2) a v0; ValueError if `velocity` is missing."""
        return 1.5 * self.a * speed_for(velocity, self)


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


@register_law(
    "energy_loss",
    formula="(1-e)/(e (n+1) I(β))",
    source="Hu & Guo 2015, Eq. 22, doi 10.1007/s11044-015-9453-z",
    valid="β = n + 1 is Hu-Guo",
)
class EnergyLoss(AbstractHuntCrossley):
    """The law that follows from the velocity profile δ' = v0 √(1 - (δ/δ_m)^β).

    `α = (1-e)/e / ((n+1) I(β))`, `I(β) = ∫_0^1 uⁿ √(1-u^β) du = B((n+1)/β, 3/2)/β`. For n = 3/2, β
    = 5/2 gives 3(1-e)/(2e), the law of Hu and Guo. β = 2 gives the factor 1.602 that Flores et al.
    print as 8/5. `e` in (0, 1] and `beta` > 0 are dimensionless and differentiable. n is taken from
    the contact; without a contact it is 3/2. Raises ValueError for a Python scalar out of range.
    Source: Hu & Guo (2015), Eq. 22-37, doi 10.1007/s11044-015-9453-z.
    """

    e: Float[Array, "..."] = parameter("e", RESTITUTION)
    beta: Float[Array, "..."] = parameter("beta", POSITIVE)

    def damping_factor(
        self, contact: Contact | None = None, velocity: ArrayLike | None = None
    ) -> Float[Array, "..."]:
        n_plus_1 = 2.5 if contact is None else contact_for(contact, self).exponent + 1
        ratio = n_plus_1 / self.beta
        # Γ(3/2) = √π/2, so (n+1) I = ratio B(ratio, 3/2) = (√π/2) Γ(ratio+1)/Γ(ratio+3/2).
        return (1 - self.e) / self.e * half_gamma_ratio(ratio + 1) * (2 / math.sqrt(math.pi))


@register_law(
    "exact",
    formula="α(1+e) = ln((1+α)/(1-αe))",
    source="energy integral of the family; see jaxcontact.exact_damping_factor",
    valid="all e in (0, 1], exactly",
)
class ExactRestitution(AbstractOfRestitution):
    """The member of the Hunt-Crossley family that delivers exactly its parameter e.

    α solves `α(1+e) = ln[(1+α)/(1-αe)]`. `e` in (0, 1]. Raises ValueError for a Python scalar out
    of range. Derived from the energy integral of the force of Hunt & Crossley (1975), doi
    10.1115/1.3423596.
    """

    def _alpha_of(self, e: Lane) -> Lane:
        return exact_damping_factor(e)
