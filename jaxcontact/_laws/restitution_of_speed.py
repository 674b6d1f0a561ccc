"""Laws with a given e(v0), as measured."""

from __future__ import annotations

import abc
from typing import TYPE_CHECKING

import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from .._entry import NOT_NEGATIVE, POSITIVE, REAL, as_parameter, parameter
from .._forms import exact_damping_factor
from .base import speed_for
from .hunt_crossley import AbstractHuntCrossley
from .registry import register_law

if TYPE_CHECKING:
    from .._contact import Contact


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
