"""Adhesive contacts of elastic spheres, each by its pull-off force."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, ClassVar, Self

import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from .._entry import NOT_NEGATIVE, as_parameter, parameter
from .._forms import LOSS, AbstractForm, DMTForm, JKRForm, jkr_energy, jkr_force, jkr_snap
from .._functions import power
from .base import AbstractLaw, Instant, contact_for, force_arguments, needed, require_exponent
from .registry import register_law

if TYPE_CHECKING:
    from .._contact import Contact
    from .._forms import Scale


class AbstractAdhesive(AbstractLaw):
    """Elastic spheres that attract each other, without damping; they pull by their nature."""

    pull_off: Float[Array, "..."] = parameter("pull_off", NOT_NEGATIVE, "N")
    tension = True
    exponents: ClassVar[tuple[float, ...] | None] = (1.5,)
    _per_radius: ClassVar[float]
    """The pull-off force over w R."""

    def __check_init__(self) -> None:
        if not self.tension:
            raise ValueError(
                f"Argument `tension` must be True for `{type(self).__name__}`, which pulls by "
                "adhesion, but is False."
            )

    @property
    def damped(self) -> bool:
        return False

    @classmethod
    def of_surfaces(cls, work_of_adhesion: ArrayLike, radius: ArrayLike) -> Self:
        """Return the law of surfaces with a work of adhesion w in J/m² (2γ for like surfaces of the
        surface energy γ) and the effective radius R in m, 1/R = 1/R1 + 1/R2.

        The pull-off force is (3/2) π w R of `JKR`, 2 π w R of `DMT`. Raises ValueError for a Python
        scalar out of range.
        """
        w = as_parameter(work_of_adhesion, "work_of_adhesion", NOT_NEGATIVE)
        return cls(pull_off=cls._per_radius * w * as_parameter(radius, "radius", NOT_NEGATIVE))


@register_law(
    "dmt",
    formula="K δ^(3/2) - F_po",
    source="Derjaguin, Muller & Toporov 1975, doi 10.1016/0021-9797(75)90018-1",
    valid="n = 3/2; small hard spheres; e = 1",
)
class DMT(AbstractAdhesive):
    """Derjaguin, Muller and Toporov's adhesion: Hertz less a constant, F = K δ^(3/2) - F_po.

    `pull_off` F_po ≥ 0 in N acts from touch until δ is zero again, so that nothing is lost: e = 1.
    It is valid for small, hard spheres of little adhesion, where `JKR` is for large, soft ones. The
    exponent is 3/2. `DMT.of_surfaces(w, R)` has F_po = 2 π w R.

    Raises ValueError for a Python scalar out of range, for `tension=False`, and, where it is used,
    for another exponent. Source: Derjaguin, Muller & Toporov (1975), J. Colloid Interface Sci.
    53:314, doi 10.1016/0021-9797(75)90018-1; Maugis (2000), Contact, Adhesion and Rupture of
    Elastic Solids, doi 10.1007/978-3-662-04125-3.
    """

    _per_radius: ClassVar[float] = 2 * math.pi

    def force(
        self,
        indentation: ArrayLike,
        velocity: ArrayLike,
        contact: Contact,
        impact_velocity: ArrayLike,
    ) -> Float[Array, "..."]:
        """Return F in N, -F_po at δ = 0 and zero for δ < 0."""
        depth, _, _ = force_arguments(indentation, velocity, contact, impact_velocity)
        require_exponent(self, contact)
        force = contact.stiffness * power(depth, 1.5) - self.pull_off
        return jnp.where(depth < 0, 0, force)

    def form(self, contact: Contact | None, scale: Scale | None) -> AbstractForm:
        contact_for(contact, self)
        return DMTForm(adhesion=self.pull_off / needed(scale, "velocity", self).force)


@register_law(
    "jkr",
    formula="K z^(3/2) - 2 (K F_po)^(1/2) z^(3/4), δ = z - 4/3 (F_po/K)^(1/2) z^(1/4)",
    source="Johnson, Kendall & Roberts 1971, doi 10.1098/rspa.1971.0141",
    valid="n = 3/2; large soft spheres; e = √(1-(v_s/v0)²), sticks below v_s",
)
class JKR(AbstractAdhesive):
    """Johnson, Kendall and Roberts' adhesion: the neck of the contact snaps at δ < 0.

    `pull_off` F_po ≥ 0 in N is the largest pull. With z = a²/R of the contact radius a,
    F = K z^(3/2) - 2 √(K F_po) z^(3/4) and δ = z - (4/3) √(F_po/K) z^(1/4). The contact forms at
    δ = 0 with -8/9 F_po and snaps at δ = -3^(-1/3) (F_po/K)^(2/3) with -5/9 F_po. Each impact loses
    .648641 (F_po⁵/K²)^(1/3), so that e = √(1 - (v_s/v0)²). At or below the speed v_s of that energy
    the bodies stick: e = 0 and the status is SETTLED. Without damping they would then oscillate for
    ever.

    The exponent is 3/2. `JKR.of_surfaces(w, R)` has F_po = (3/2) π w R. e is a formula, and the
    times of free impacts are quadratures. External forces, trajectories, scenes and mechanisms are
    followed in time until the snap. Instantaneous impacts of scenes, and friction in scenes and
    mechanisms, raise ValueError.

    Raises ValueError for a Python scalar out of range, for `tension=False`, and, where it is used,
    for another exponent. Source: Johnson, Kendall & Roberts (1971), Proc. R. Soc. Lond. A 324:301,
    doi 10.1098/rspa.1971.0141; Johnson & Pollock (1994), J. Adhes. Sci. Technol. 8:1323,
    doi 10.1163/156856194X00672.
    """

    ends_apart: ClassVar[bool] = True
    _per_radius: ClassVar[float] = 1.5 * math.pi

    def force(
        self,
        indentation: ArrayLike,
        velocity: ArrayLike,
        contact: Contact,
        impact_velocity: ArrayLike,
    ) -> Float[Array, "..."]:
        """Return F in N of a contact that has formed, zero beyond its snap."""
        depth, _, _ = force_arguments(indentation, velocity, contact, impact_velocity)
        require_exponent(self, contact)
        return self._jkr(depth, contact, goes_on=False)

    def _force_of_closed(self, at: Instant, deepest: ArrayLike | None) -> Float[Array, "..."]:
        require_exponent(self, at.contact)
        return self._jkr(jnp.asarray(at.indentation), at.contact, goes_on=True)

    def _jkr(self, depth: Array, contact: Contact, goes_on: bool) -> Float[Array, "..."]:
        stiffness = contact.stiffness
        return stiffness * jkr_force(depth, self.pull_off / stiffness, goes_on)

    def _end_indentation(self, contact: Contact) -> Float[Array, "..."]:
        return jkr_snap(self.pull_off / contact.stiffness)

    def _energies(
        self, indentation: ArrayLike, contact: Contact, speed: ArrayLike, largest: ArrayLike
    ) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
        depth, stiffness = jnp.asarray(indentation), contact.stiffness
        energy = stiffness * jkr_energy(depth, self.pull_off / stiffness)
        return energy, jnp.zeros_like(energy)

    def form(self, contact: Contact | None, scale: Scale | None) -> JKRForm:
        contact_for(contact, self)
        force = needed(scale, "velocity", self).force
        return JKRForm(root=power(self.pull_off / force, 0.5))

    def sticking_speed(self, contact: Contact) -> Float[Array, "..."]:
        """Return v_s in m/s, at and below which the bodies stick: m v_s²/2 is the energy lost.

        Raises ValueError for anything that is not a contact.
        """
        stiffness = contact_for(contact, self).stiffness
        lost = LOSS * power(self.pull_off, 5 / 3) * power(stiffness, -2 / 3)
        return jnp.sqrt(2 * lost / contact.mass)
