"""The impact that an engine must reproduce, and the parameters with which it does."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import jax.numpy as jnp

from .._contact import Contact
from .._impact import Impact, Status, impact
from .._laws import AbstractLaw, Luding, WaltonBraun
from .at_time_step import Scheme


@dataclasses.dataclass(frozen=True)
class Wanted:
    """One impact as plain numbers: its outcome, and the contact in which it takes place.

    `law` is the exported law, for engines that have the same one.
    """

    restitution: float
    duration: float
    mass: float
    stiffness: float
    exponent: float
    velocity: float
    law: AbstractLaw | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class Draft:
    """An engine's law with the parameters found, before it is solved again."""

    model: str
    law: AbstractLaw
    contact: Contact
    parameters: Mapping[str, float]
    units: Mapping[str, str]
    snippet: str
    limit: str
    source: str
    steps: int | None = None
    """Time steps per contact at which the engine was measured; None if it was not run."""
    expected_error: float | None = None
    scheme: Scheme | None = None
    """Time stepping of the engine; None if its user chooses it, or if it is unknown."""


def require_rebound(hit: Impact) -> Impact:
    """Return `hit` if it is one impact that ended in separation; ValueError otherwise."""
    status = Status(int(hit.status))
    if status is not Status.SEPARATED or not float(hit.restitution) > 0:
        raise ValueError(
            "Arguments `law`, `contact` and `velocity` must make an impact with a rebound, but it "
            f"ended as {status.name.lower()!r} with the restitution {float(hit.restitution):g}."
        )
    return hit


def matched_stiffness(wanted: Wanted, exponent: float, scaled_law: AbstractLaw) -> float:
    """Return K in N/mⁿ of an engine with exponent n: the contact's own, or that of equal duration.

    An impact lasts τ (m/K)^(1/(n+1)) v0^((1-n)/(n+1)), with τ that of `scaled_law`, the engine's
    law in units where mass, stiffness and speed are 1. For different exponents no K gives the same
    force. Equal duration preserves the frequencies that a contact excites.
    """
    if wanted.exponent == exponent:
        return wanted.stiffness
    unit = require_rebound(impact(scaled_law, Contact(1.0, 1.0, exponent), 1.0, throw=False))
    tau = float(unit.duration)
    speed = wanted.velocity ** (1 - exponent)
    return wanted.mass * speed * (tau / wanted.duration) ** (exponent + 1)


def as_luding(law: AbstractLaw | None) -> Luding | None:
    """Return a `Luding`, or a `WaltonBraun` as the same without adhesion; None for other laws."""
    if isinstance(law, WaltonBraun):
        return Luding(ratio=law.ratio, slope=law.slope, adhesion=jnp.zeros(()))
    return law if isinstance(law, Luding) else None
