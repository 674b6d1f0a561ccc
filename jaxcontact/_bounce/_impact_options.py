"""How each impact of a run is to be solved."""

from __future__ import annotations

import equinox as eqx
from jaxtyping import Array

from .._contact import Contact
from .._impact import Impact, impact
from .._laws import AbstractLaw


class ImpactOptions(eqx.Module):
    """The keywords that go to `impact`, all static."""

    method: str = eqx.field(static=True)
    rtol: float | None = eqx.field(static=True)
    atol: float | None = eqx.field(static=True)

    def impact(
        self, law: AbstractLaw, contact: Contact, velocity: Array, weight: Array | None = None
    ) -> Impact:
        """One impact, pushed by `weight` in N where there is one."""
        return impact(
            law,
            contact,
            velocity,
            method=self.method,
            rtol=self.rtol,
            atol=self.atol,
            external_force=weight,
        )
