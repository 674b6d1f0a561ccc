"""Viscoelastic spheres: damping proportional to the rate of the elastic force."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jaxtyping import Array, Float

from .._entry import NOT_NEGATIVE, parameter, static_value
from .._forms import (
    AbstractForm,
    Exponent,
    OscillatorForm,
    ViscoelasticForm,
    ViscoelasticSpheresForm,
)
from .._functions import power
from .base import AbstractDampedLaw, Instant, force_arguments, needed
from .registry import register_law

if TYPE_CHECKING:
    from .._contact import Contact
    from .._forms import Scale


@register_law(
    "kuwabara_kono",
    formula="K (δⁿ + n A δ^(n-1) δ')",
    source="Kuwabara & Kono 1987, doi 10.1143/JJAP.26.1230",
    valid="A ≥ 0; 1-e grows as v0^(1/5)",
)
class KuwabaraKono(AbstractDampedLaw):
    """Viscoelastic spheres: F = K (δⁿ + n A δ^(n-1) δ'), K (δ^(3/2) + (3/2) A √δ δ') for Hertz.

    `A` ≥ 0 is a material time in s. Restitution falls with speed. For a Hertz contact 1 - e ≈
    1.15344 (3/2) A (K/m)^(2/5) v0^(1/5) as long as that is small, so e(v) determines only A
    (K/m)^(2/5). As published, the contact may pull shortly before it ends at δ = 0. With
    `tension=False` it ends where the force vanishes.

    For n = 1 the law is the linear spring and dashpot with ζ = A √(K/m)/2. With tension and ζ ≥ 1
    this contact creeps back without end and the impact is settled. For n = 3/2 free impacts are
    series in ln(1 + A (K/m)^(2/5) v0^(1/5)), certified to 1e-12. Method "exact" applies to these
    two exponents, "event" to all others. At δ = 0 the derivative in δ of √δ is infinite and is
    defined to be 0.

    Raises ValueError for a Python scalar out of range. Source: Kuwabara & Kono (1987), Jpn. J.
    Appl. Phys. 26:1230, doi 10.1143/JJAP.26.1230; Brilliantov et al. (1996), Phys. Rev. E 53:5382,
    doi 10.1103/PhysRevE.53.5382.
    """

    A: Float[Array, "..."] = parameter("A", NOT_NEGATIVE)
    tension = True

    def jumps(self, exponent: Exponent) -> bool:
        return not (static_value(exponent) or 0) > 1

    def _whole_force(self, at: Instant) -> Float[Array, "..."]:
        contact, (depth, rate, _) = at.contact, force_arguments(*at)
        n = contact.exponent
        return contact.stiffness * (power(depth, n) + n * self.A * power(depth, n - 1) * rate)

    def form(self, contact: Contact | None, scale: Scale | None) -> AbstractForm:
        exponent = needed(contact, "contact", self).exponent
        a = self.A / needed(scale, "velocity", self).time
        if static_value(exponent) == 1:
            # The linear spring and dashpot has a closed form.
            return OscillatorForm(zeta=a / 2, tension=self.tension, approach_only=False)
        if static_value(exponent) == 1.5:
            return ViscoelasticSpheresForm(a=a, tension=self.tension)
        return ViscoelasticForm(a=a, tension=self.tension)
