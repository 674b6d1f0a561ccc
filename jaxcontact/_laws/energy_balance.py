"""Laws from the energy balance of an impact: with an assumed velocity profile, and exact."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from jaxtyping import Array, ArrayLike, Float

from .._entry import POSITIVE, RESTITUTION, parameter
from .._forms import exact_damping_factor
from .._functions import half_gamma_ratio
from .base import contact_for
from .hunt_crossley import AbstractHuntCrossley
from .registry import register_law

if TYPE_CHECKING:
    from .._contact import Contact


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
class ExactRestitution(AbstractHuntCrossley):
    """The member of the Hunt-Crossley family that delivers exactly its parameter e.

    α solves `α(1+e) = ln[(1+α)/(1-αe)]`. `e` in (0, 1]. Raises ValueError for a Python scalar out
    of range. Derived from the energy integral of the force of Hunt & Crossley (1975), doi
    10.1115/1.3423596.
    """

    e: Float[Array, "..."] = parameter("e", RESTITUTION)

    def damping_factor(
        self, contact: Contact | None = None, velocity: ArrayLike | None = None
    ) -> Float[Array, "..."]:
        return exact_damping_factor(self.e)
