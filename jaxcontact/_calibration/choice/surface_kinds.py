"""Kinds of laws of metals, wet and adhesive bodies, which are compared on request."""

from __future__ import annotations

import dataclasses
import math
from types import MappingProxyType
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array

from ..._contact import Contact
from ..._fit import Between, Positive
from ..._forms import LOSS
from ..._impact import restitution
from .kind import AbstractKind, Combination
from .kinds import BOTH, HERTZ, LEAST_E, ConstantC, ConstantE, Plastic, dashpot


@dataclasses.dataclass(frozen=True)
class ViscousAndPlastic(AbstractKind):
    """Elastic-plastic spheres with Hunt and Crossley's damping: e depends on v_y/v and c v/K."""

    law: str = "viscoplastic"
    name: str = "viscous and plastic"
    unidentified = "c and K separately; yield pressure, E, R and m: e(v) determines v_y and c/K"
    parameters = MappingProxyType({**Plastic.parameters, **ConstantC.parameters})
    special = (ConstantC, Plastic)
    exponent = HERTZ

    def start(self, e: float, contact: Contact, reference: float) -> dict[str, float]:
        """Return half of ln e for each of the two losses."""
        root = math.sqrt(e)
        plastic, viscous = (
            kind.start(root, contact, reference) for kind in (Plastic(), ConstantC())
        )
        return {**plastic, **viscous}

    def curve(self, law: Any, contact: Contact, velocity: Array) -> Array:
        return restitution(law, contact, velocity)


@dataclasses.dataclass(frozen=True)
class Wet(AbstractKind):
    """Bodies with a film of liquid: e (1 - v_c/v)."""

    law: str = "wet_restitution"
    name: str = "wet"
    unidentified = "viscosity, radius, mass and St_c separately: e(v) determines the dry e and v_c"
    parameters = MappingProxyType(
        {
            "e": Combination(Between(0, 1), "dry e"),
            "critical_speed": Combination(Positive(), "v_c", "m/s"),
        }
    )
    special = (ConstantE,)

    def start(self, e: float, contact: Contact, reference: float) -> dict[str, float]:
        """Return a film that takes a fifth of the loss."""
        dry = e**0.8
        return {"e": dry, "critical_speed": (1 - e / dry) * reference}

    def curve(self, law: Any, contact: Contact, velocity: Array) -> Array:
        """Return the curve, kept above 0, where its logarithm is defined."""
        return jnp.maximum(law.restitution_at(velocity), LEAST_E)


@dataclasses.dataclass(frozen=True)
class Adhesive(AbstractKind):
    """Elastic spheres with a neck (JKR): e = √(1 - (v_s/v)²)."""

    law: str = "jkr"
    name: str = "adhesive (JKR)"
    unidentified = "pull-off force, K and m separately: e(v) determines the sticking speed"
    parameters = MappingProxyType(
        {
            "pull_off": Combination(
                Positive(), "F_po/(m^(3/5) K^(2/5))", "(m/s)^(6/5)", dashpot, "N", BOTH
            )
        }
    )
    exponent = HERTZ

    def start(self, e: float, contact: Contact, reference: float) -> dict[str, float]:
        """Return the pull-off force of v_s = v √(1 - e²)."""
        lost = (1 - e) * (1 + e) * reference**2 / (2 * LOSS)
        return {"pull_off": lost**0.6 * float(dashpot(contact.mass, contact.stiffness))}

    def curve(self, law: Any, contact: Contact, velocity: Array) -> Array:
        """Return the curve, kept above 0, where its logarithm is defined."""
        return jnp.maximum(restitution(law, contact, velocity), LEAST_E)
