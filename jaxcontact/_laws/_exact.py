"""The law that delivers exactly the restitution it is given."""

from __future__ import annotations

from jaxtyping import Array, Float

from .._forms import exact_damping_factor
from .._parameter import RESTITUTION, parameter
from ._hunt_crossley import AbstractHuntCrossley
from ._registry import register_law


@register_law(
    "exact",
    formula="α(1+e) = ln((1+α)/(1-αe))",
    source="energy integral of the family; see jaxcontact.exact_damping_factor",
    valid="all e in (0, 1], exactly",
)
class ExactRestitution(AbstractHuntCrossley):
    """The member of the Hunt-Crossley family that delivers exactly the e it is given.

    α solves `α(1+e) = ln[(1+α)/(1-αe)]`. `e` in (0, 1]. Raises ValueError for a Python scalar out
    of range. Derived from the energy integral of the force of Hunt & Crossley (1975),
    doi 10.1115/1.3423596.
    """

    e: Float[Array, "..."] = parameter("e", RESTITUTION)

    def damping_factor(self, contact=None, velocity=None) -> Float[Array, "..."]:
        return exact_damping_factor(self.e)
