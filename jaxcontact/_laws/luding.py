"""Luding's contact of powders: linear, elastic-plastic and adhesive."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from .._entry import NOT_NEGATIVE, as_parameter, parameter
from .._forms import Exponent, LudingForm
from .base import AbstractLaw, Instant, contact_for, force_arguments, needed, require_exponent
from .plastic import STIFFER
from .registry import register_law

if TYPE_CHECKING:
    from .._contact import Contact
    from .._forms import Scale


@register_law(
    "luding",
    formula="K δ, back the larger of K_u (δ - δ_0) and -K_c δ, K_u = K ratio + slope F_max",
    source="Luding 2008, doi 10.1007/s10035-008-0099-x",
    valid="n = 1; ratio ≥ 1, slope ≥ 0, adhesion ≥ 0; sticks where η (κ - 2) ≥ 1",
)
class Luding(AbstractLaw):
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
    remembers: ClassVar[bool] = True
    forgets: ClassVar[bool] = True
    exponents: ClassVar[tuple[float, ...] | None] = (1.0,)

    def __check_init__(self) -> None:
        if not self.tension:
            raise ValueError(
                "Argument `tension` must be True for `Luding`, which pulls by adhesion, but is "
                "False."
            )

    @property
    def damped(self) -> bool:
        return False

    def jumps(self, exponent: Exponent) -> bool:
        return False

    def force(
        self,
        indentation: ArrayLike,
        velocity: ArrayLike,
        contact: Contact,
        impact_velocity: ArrayLike,
        largest: ArrayLike | None = None,
    ) -> Float[Array, "..."]:
        """Return F in N, zero for δ < 0. `largest` is the largest indentation of the contact so far
        in m. The contact is loading where δ is at least that, or if it is None.
        """
        depth, _, _ = force_arguments(indentation, velocity, contact, impact_velocity)
        require_exponent(self, contact)
        pressed = jnp.maximum(depth, 0)
        most = as_parameter(0.0 if largest is None else largest, "largest")
        form = self._of_depths().remembering(most)
        return contact.stiffness * form.force(pressed, pressed, 1.0, pressed >= most)

    def _of_depths(self) -> LudingForm:
        """Return F/K as a form of δ in m."""
        return LudingForm(factor=self.ratio, slope=self.slope, adhesion=self.adhesion)

    def _force_after(self, at: Instant, deepest: ArrayLike) -> Float[Array, "..."]:
        require_exponent(self, at.contact)
        depth, most = jnp.maximum(jnp.asarray(at.indentation), 0), jnp.asarray(deepest)
        factor, end = self._of_depths().unloading(jnp.maximum(most, 0))
        back = jnp.where(most < 0, -self.adhesion * depth, factor * (depth - end))
        return at.contact.stiffness * jnp.where(most == 0, depth, back)

    def _energies(
        self, indentation: ArrayLike, contact: Contact, speed: ArrayLike, largest: ArrayLike
    ) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
        largest, stiffness = jnp.asarray(largest), contact.stiffness
        form, depth = self._of_depths(), jnp.maximum(jnp.asarray(indentation), 0)
        returned = form.remembering(largest).stored(depth, 1.0, 1)
        return stiffness * returned, stiffness * form.kept(largest)

    def _adheres_below(self, largest: ArrayLike) -> Float[Array, "..."]:
        return self._of_depths().least(jnp.asarray(largest))

    def _shrunk(self, indentation: ArrayLike) -> Float[Array, "..."]:
        return self._of_depths().shrunk(jnp.asarray(indentation))

    def form(self, contact: Contact | None, scale: Scale | None) -> LudingForm:
        contact_for(contact, self)
        length = needed(scale, "velocity", self).length
        return LudingForm(factor=self.ratio, slope=self.slope * length, adhesion=self.adhesion)
