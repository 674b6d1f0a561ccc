"""Laws with a given e(v0), as measured."""

from __future__ import annotations

import abc
import dataclasses
import math
from typing import TYPE_CHECKING, Self

import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from .._entry import NOT_NEGATIVE, POSITIVE, REAL, RESTITUTION, as_parameter, parameter
from .._forms import Exponent, HuntCrossleyForm, Lane, Scale, ScaledImpact, exact_damping_factor
from .base import needed, speed_for
from .hunt_crossley import AbstractHuntCrossley
from .registry import register_law

if TYPE_CHECKING:
    from .._contact import Contact

_LEAST_E = 1e-3
"""The e of the force that stands for bodies that stick; coupled solves resolve its damping."""
_film = jax.jit(lambda stokes, mu, a, m: 6 * math.pi * mu * jnp.square(a) * stokes / m)


class AbstractRestitutionOfSpeed(AbstractHuntCrossley):
    """The member of the Hunt-Crossley family that delivers e(v0); a subclass returns e(v0)."""

    @abc.abstractmethod
    def restitution_at(self, velocity: ArrayLike) -> Float[Array, "..."]:
        """Return e at closing speeds in m/s; ValueError for anything that is not a number."""

    def damping_factor(
        self, contact: Contact | None = None, velocity: ArrayLike | None = None
    ) -> Float[Array, "..."]:
        """Return the α that delivers e(v0); ValueError if `velocity` is missing."""
        return exact_damping_factor(self.restitution_at(speed_for(velocity, self)))


@register_law(
    "bridges",
    formula="exact for e = min(1, a (v0/v_r)^-p)",
    source="Bridges, Hatzes & Lin 1984, doi 10.1038/309333a0",
    valid="a > 0; e = 1 below the speed v_r a^(1/p)",
)
class Bridges(AbstractRestitutionOfSpeed):
    """A restitution that falls as a power of the closing speed: e = min(1, a (v0/v_r)^-p).

    `a` > 0 is e at the reference speed, if it is below the bound. `power` p is dimensionless;
    `reference` v_r > 0 in m/s. The force is that member of the Hunt-Crossley family that delivers
    this e. If a (v0/v_r)^-p > 1 all derivatives are zero; at the kink, where it is 1, they are
    those of the power. Raises ValueError for a Python scalar out of range. Source: Bridges, Hatzes
    & Lin (1984), Nature 309:333, doi 10.1038/309333a0: ice spheres, p = 0.234, v_r = 7.7e-5 m/s
    with a = 1. For plastic spheres p = 1/4 (Johnson 1985, doi 10.1017/CBO9781139171731).
    """

    a: Float[Array, "..."] = parameter("a", POSITIVE)
    power: Float[Array, "..."] = parameter("power", REAL)
    reference: Float[Array, "..."] = parameter("reference", POSITIVE)

    def restitution_at(self, velocity: ArrayLike) -> Float[Array, "..."]:
        place = as_parameter(velocity, "velocity") / self.reference
        # The bound is applied to the logarithm, which cannot overflow.
        logarithm = jnp.log(self.a) - self.power * jnp.log(place)
        return jnp.exp(jnp.where(logarithm > 0, 0, logarithm))


@register_law(
    "power_restitution",
    formula="exact for e = 1 - b (v0/v_r)^p",
    source="empirical; p = 1/5 is Kuwabara & Kono's small loss, doi 10.1143/JJAP.26.1230",
    valid="b ≥ 0, where e > 0; p = 0 is a constant e",
)
class PowerRestitution(AbstractRestitutionOfSpeed):
    """A loss that grows as a power of the closing speed: e = 1 - b (v0/v_r)^p.

    `loss` b ≥ 0 is 1 - e at the reference speed; `power` p is dimensionless; `reference` v_r > 0 in
    m/s. The force is that member of the Hunt-Crossley family that delivers this e. No such force
    exists for e ≤ 0, and the outcome is then NaN. Raises ValueError for a Python scalar out of
    range. Source: the usual form in which measured e(v) is reported; for viscoelastic spheres of
    small loss p = 1/5 (Kuwabara & Kono 1987, doi 10.1143/JJAP.26.1230).
    """

    loss: Float[Array, "..."] = parameter("loss", NOT_NEGATIVE)
    power: Float[Array, "..."] = parameter("power", REAL)
    reference: Float[Array, "..."] = parameter("reference", POSITIVE, "m/s")

    def restitution_at(self, velocity: ArrayLike) -> Float[Array, "..."]:
        place = as_parameter(velocity, "velocity") / self.reference
        return 1 - self.loss * jnp.exp(self.power * jnp.log(place))


class StickingForm(HuntCrossleyForm):
    """The Hunt-Crossley form of an impact that delivers e, or 0 if the bodies stick.

    `delivered` is that e. No member of the family has e = 0: `alpha` is one of a small e there.
    """

    delivered: Lane

    def restitution(self) -> Lane:
        return self.delivered

    def solve(self, n: Exponent) -> ScaledImpact:
        return self.as_delivered(super().solve(n))

    def as_delivered(self, scaled: ScaledImpact) -> ScaledImpact:
        """Return an impact with e as delivered; bodies that stick have no indentation and force."""
        sticks = self.delivered <= 0
        names = "compression_time", "max_indentation", "max_force"
        return dataclasses.replace(
            scaled,
            restitution=self.delivered + jnp.zeros_like(scaled.restitution),
            settled=sticks,
            energy_loss=None,  # by e: that of the force is the loss of another one below .001
            **{name: jnp.where(sticks, jnp.nan, getattr(scaled, name)) for name in names},
        )


@register_law(
    "wet_restitution",
    formula="exact for e (1 - v_c/v0)",
    source="Davis, Serayssol & Hinch 1986, doi 10.1017/S0022112086002392",
    valid="v_c ≥ 0; sticks at or below v_c",
)
class WetRestitution(AbstractRestitutionOfSpeed):
    """Bodies with a film of liquid between them: e (1 - v_c/v0), and 0 at or below v_c.

    `e` in (0, 1] is the restitution of the dry contact. `critical_speed` v_c ≥ 0 in m/s is the
    largest speed at which the bodies stick. With the Stokes number St = m v0/(6πμa²) it is the
    speed of St_c, so that e (1 - v_c/v0) = e (1 - St_c/St); see `WetRestitution.of_liquid`. The
    force is that member of the Hunt-Crossley family that delivers this e.

    At or below v_c e = 0 and a free impact is SETTLED: the liquid stops the bodies, and their
    indentation, force and time of compression are NaN, and derivatives zero. No force of the family
    has e = 0: pushes, scenes and mechanisms follow one with e = .001 in time. It also takes the
    place of those with a smaller e, between v_c and 1.001 v_c.

    Capillary forces, the inertia of the liquid and what the dry e owes to its own speed are not
    described. Raises ValueError for a Python scalar out of range. Source: Davis, Serayssol & Hinch
    (1986), J. Fluid Mech. 163:479, doi 10.1017/S0022112086002392; Davis, Rager & Good (2002),
    J. Fluid Mech. 468:107, doi 10.1017/S0022112002001489.
    """

    e: Float[Array, "..."] = parameter("e", RESTITUTION)
    critical_speed: Float[Array, "..."] = parameter("critical_speed", NOT_NEGATIVE, "m/s")

    @classmethod
    def of_liquid(
        cls,
        e: ArrayLike,
        critical_stokes: ArrayLike,
        viscosity: ArrayLike,
        radius: ArrayLike,
        mass: ArrayLike,
    ) -> Self:
        """Return the law of a liquid with v_c = 6πμa² St_c/m.

        `critical_stokes` St_c ≥ 0 is measured, or follows from lubrication: a film that thins from
        x0 to the roughness x_r with the force 6πμa² v/x takes the momentum 6πμa² ln(x0/x_r). Hence
        St_c = ln(x0/x_r) if the film resists the approach alone, as one that cavitates, and
        (1 + 1/e) ln(x0/x_r) if it resists separation alike. `viscosity` μ ≥ 0 in Pa s; `radius` a
        in m and `mass` m > 0 in kg are effective, 1/a = 1/a1 + 1/a2 and 1/m = 1/m1 + 1/m2: those of
        the sphere on a plane. Raises ValueError for a Python scalar out of range.
        """
        stokes = as_parameter(critical_stokes, "critical_stokes", NOT_NEGATIVE)
        mu = as_parameter(viscosity, "viscosity", NOT_NEGATIVE)
        a = as_parameter(radius, "radius", NOT_NEGATIVE)
        m = as_parameter(mass, "mass", POSITIVE)
        return cls(e=as_parameter(e, "e", RESTITUTION), critical_speed=_film(stokes, mu, a, m))

    def restitution_at(self, velocity: ArrayLike) -> Float[Array, "..."]:
        speed = as_parameter(velocity, "velocity")
        rebounds = speed > self.critical_speed
        # The quotient is not evaluated where it would overflow.
        return jnp.where(
            rebounds, self.e * (1 - self.critical_speed / jnp.where(rebounds, speed, 1)), 0
        )

    def damping_factor(
        self, contact: Contact | None = None, velocity: ArrayLike | None = None
    ) -> Float[Array, "..."]:
        """Return the α of e(v0), or of .001 if that is larger; ValueError without `velocity`."""
        e = self.restitution_at(speed_for(velocity, self))
        return exact_damping_factor(jnp.where(e < _LEAST_E, _LEAST_E, e))

    def form(self, contact: Contact | None, scale: Scale | None) -> StickingForm:
        speed = needed(scale, "velocity", self).speed
        return StickingForm(
            alpha=self.damping_factor(contact, speed),
            tension=self.tension,
            delivered=self.restitution_at(speed),
        )
