"""Contacts that several simulators have: a spring and a dashpot, and a clamped sphere."""

from __future__ import annotations

import math
from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..._contact import Contact
from ..._entry import NOT_NEGATIVE, parameter
from ..._laws import AbstractOscillator, AntypovElliott, KelvinVoigt
from ..engine import Wanted, matched_stiffness

_LEAST = math.exp(-2)
"""Restitution of a damped Hertz contact without tension at critical damping. The codes set ζ = -ln
e/√(π² + ln² e) < 1, so they cannot deliver less.
"""


class SpringAndDashpot(AbstractOscillator):
    """δ'' = -(K/m) δ - b δ', without tension unless `tension`; requires n = 1.

    `rate` b ≥ 0 in 1/s. Source: Schwager & Pöschel (2007), Granular Matter 9:465, doi
    10.1007/s10035-007-0065-z.
    """

    rate: Float[Array, "..."] = parameter("rate", NOT_NEGATIVE)
    tension = False
    exponents: ClassVar[tuple[float, ...] | None] = (1.0,)

    def damping_ratio(self, contact: Contact | None = None) -> Float[Array, "..."]:
        """Return ζ = b/(2√(K/m)); ValueError if `contact` is missing."""
        if contact is None:
            raise ValueError("Argument `contact` is needed for `SpringAndDashpot`, but is None.")
        return self.rate / 2 * jnp.sqrt(contact.mass) / jnp.sqrt(contact.stiffness)


def pulling_dashpot(wanted: Wanted) -> tuple[SpringAndDashpot, float, float]:
    """Return the law F = K δ + c δ', which may pull, with K in N/m and c in N s/m."""
    # An elastic contact is requested by c = 0, not by e = 1.
    scaled = KelvinVoigt(e=jnp.asarray(wanted.restitution))
    stiffness = matched_stiffness(wanted, 1.0, scaled)
    root = math.sqrt(stiffness) * math.sqrt(wanted.mass)
    damping = max(0.0, 2 * float(scaled.damping_ratio()) * root)
    law = SpringAndDashpot(rate=jnp.asarray(damping / wanted.mass), tension=True)
    return law, stiffness, damping


def clamped_sphere(wanted: Wanted, where: str, instead: str) -> tuple[AntypovElliott, float, float]:
    """Return the law K δ^(3/2) + √5 ζ √(Km) δ^(1/4) δ', clamped instead of pulling, K in N/m^1.5,
    and the e of Antypov and Elliott with this ζ, which delivers more.

    Raises ValueError for too small a restitution, which names `where` and what to try `instead`.
    """
    clamped = KelvinVoigt(e=jnp.asarray(wanted.restitution), tension=False)
    zeta = float(clamped.damping_ratio())
    if not zeta < 1:
        raise ValueError(
            f"Argument `law` must deliver a restitution above {_LEAST:.4f} for {where}, but "
            f"delivers {wanted.restitution:g}; try {instead}."
        )
    nominal = math.exp(-math.pi * zeta / math.sqrt(1 - zeta**2))
    law = AntypovElliott(e=jnp.asarray(nominal), tension=False)
    return law, matched_stiffness(wanted, 1.5, law), nominal
