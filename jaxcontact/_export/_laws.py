"""The engines' own laws, in the parameters that the engines take."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from .._elementary import power
from .._laws import (
    AbstractHuntCrossley,
    AbstractLaw,
    AbstractOscillator,
    CarvalhoMartins,
    Gonthier,
    Tsuji,
)
from .._parameter import (
    NOT_NEGATIVE,
    POSITIVE,
    RESTITUTION,
    RESTITUTION_FROM_ZERO,
    as_parameter,
    parameter,
)

if TYPE_CHECKING:
    from .._contact import Contact


class Dissipation(AbstractHuntCrossley):
    """Drake's point contact: F = K δ (1 + d δ'), zero where the bracket is negative.

    `dissipation` d ≥ 0 in s/m, so that α = d v0. Source: the compliant contact pages of Drake's
    documentation, drake.mit.edu/doxygen_cxx/group__compliant__contact.html.
    """

    dissipation: Float[Array, "..."] = parameter("dissipation", NOT_NEGATIVE)

    def damping_factor(
        self, contact: Contact | None = None, velocity: ArrayLike | None = None
    ) -> Float[Array, "..."]:
        """α = d v0; ValueError if `velocity` is missing."""
        if velocity is None:
            raise ValueError(
                "Argument `velocity` is needed for `Dissipation`, whose α depends on it, "
                "but is None."
            )
        return self.dissipation * as_parameter(velocity, "velocity")


class GonthierCarvalhoMartins(AbstractHuntCrossley):
    """Exudyn's impactModel 2: α of Carvalho and Martins for e > 1/3, of Gonthier et al. below.

    `e` in (0, 1] is the restitutionCoefficient of the connector. The two meet at e = 1/3. Source:
    ObjectContactSphereSphere in Exudyn's documentation, exudyn.readthedocs.io.
    """

    e: Float[Array, "..."] = parameter("e", RESTITUTION)

    def damping_factor(
        self, contact: Contact | None = None, velocity: ArrayLike | None = None
    ) -> Float[Array, "..."]:
        """α = 3(1-e)(11-e)/(2(1+9e)) for e > 1/3, (1-e²)/e below."""
        above = CarvalhoMartins(e=self.e).damping_factor()
        return jnp.where(self.e > 1 / 3, above, Gonthier(e=self.e).damping_factor())


class TsujiWithoutRoot(AbstractOscillator):
    """LAMMPS' damping tsuji up to the release of 22 July 2025: Tsuji's polynomial without the √2.

    F = K δ^(3/2) + p(e) √(Km) δ^(1/4) δ', with p the polynomial of `Tsuji` and m the effective
    mass, for which the fit was not made. `e` in [0, 1] is the coefficient in the pair_coeff line.
    Source: the page of pair_style granular, docs.lammps.org/pair_granular.html.
    """

    e: Float[Array, "..."] = parameter("e", RESTITUTION_FROM_ZERO)
    exponents: ClassVar[tuple[float, ...] | None] = (1.5,)

    def damping_ratio(self, contact: Contact | None = None) -> Float[Array, "..."]:
        """ζ = p(e)/√5."""
        return Tsuji(e=self.e).damping_ratio() / math.sqrt(2)


class Viscoelastic(AbstractLaw):
    """LAMMPS' hertz with damping viscoelastic: F = K δ^(3/2) + η m √(R δ) δ'; it may pull.

    `eta` η ≥ 0 in 1/(m s), `radius` R > 0 in m, the effective one. The law of Kuwabara and Kono
    with A = 2 η m √R/(3K). Source: the page of pair_style granular,
    docs.lammps.org/pair_granular.html.
    """

    eta: Float[Array, "..."] = parameter("eta", NOT_NEGATIVE)
    radius: Float[Array, "..."] = parameter("radius", POSITIVE)
    exponents: ClassVar[tuple[float, ...] | None] = (1.5,)

    def force(
        self,
        indentation: ArrayLike,
        velocity: ArrayLike,
        contact: Contact,
        impact_velocity: ArrayLike,
    ) -> Float[Array, "..."]:
        """F = K δ^(3/2) + η m √(R δ) δ' in N, and zero for δ < 0."""
        indentation = as_parameter(indentation, "indentation")
        contact_radius = jnp.sqrt(self.radius) * power(indentation, 0.5)
        damping = self.eta * contact.mass * contact_radius * as_parameter(velocity, "velocity")
        force = contact.stiffness * power(indentation, 1.5) + damping
        return force if self.tension else jnp.maximum(force, 0)


class SoftConstraint(AbstractOscillator):
    """MuJoCo's contact with constant impedance: δ'' = -k δ - b δ' while that pushes.

    `damping` b ≥ 0 in 1/s, the second number of solref in its direct format without its sign; the
    first, k in 1/s², is K/m of the contact. Needs n = 1. Source: the pages on solver parameters in
    MuJoCo's documentation, mujoco.readthedocs.io/en/stable/modeling.html#solver-parameters.
    """

    damping: Float[Array, "..."] = parameter("damping", NOT_NEGATIVE)
    tension: bool = eqx.field(static=True, default=False, kw_only=True)
    exponents: ClassVar[tuple[float, ...] | None] = (1.0,)

    def damping_ratio(self, contact: Contact | None = None) -> Float[Array, "..."]:
        """ζ = b/(2√(K/m)); ValueError if `contact` is missing."""
        if contact is None:
            raise ValueError(
                "Argument `contact` is needed for `SoftConstraint`, whose ζ depends on it, "
                "but is None."
            )
        return self.damping / 2 * jnp.sqrt(contact.mass) / jnp.sqrt(contact.stiffness)
