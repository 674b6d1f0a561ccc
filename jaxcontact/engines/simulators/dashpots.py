"""Springs with dashpots: the laws, and Bullet and Newton, which have them.

Bullet has contacts with stiffness and damping; its rigid-body restitution is not exported. Newton's
semi-implicit solver has springs with dashpots on approach only.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from ... import AntypovElliott, Contact, KelvinVoigt
from ...extend import NOT_NEGATIVE, AbstractOscillator, parameter
from ..at_time_step import Scheme
from ..engine import Draft, Engine, Wanted, matched_stiffness, register_engine

LINEAR = (
    "Linear: the duration is that of the law at this speed; the force differs, it jumps at touch"
)
PULLS = f"{LINEAR} and pulls at the end"
"""Of a spring with a dashpot, which only pushes, or also pulls."""

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


def pushing_dashpot(wanted: Wanted) -> tuple[float, float]:
    """Return K in N/m and ζ of the law F = K δ + c δ' while positive."""
    law = KelvinVoigt(e=jnp.asarray(wanted.restitution), tension=False)
    return matched_stiffness(wanted, 1.0, law), float(law.damping_ratio())


def pasted(parameters: Mapping[str, float]) -> str:
    """Return parameters as keyword arguments."""
    return ", ".join(f"{name}={value:.12g}" for name, value in parameters.items())


@register_engine
class Bullet(Engine):
    """contactStiffness and contactDamping: F = K δ + C δ' while positive.

    Two bodies with k and c each have K = k/2 (springs in series) and C = 2 c (dampings add).
    """

    name = "bullet"

    def draft(self, wanted: Wanted) -> Draft:
        stiffness, zeta = pushing_dashpot(wanted)
        damping = 2 * zeta * math.sqrt(stiffness) * math.sqrt(wanted.mass)
        of_each = {"contactStiffness": 2 * stiffness, "contactDamping": max(0.0, damping / 2)}
        return Draft(
            model="contactStiffness and contactDamping",
            law=SpringAndDashpot(rate=jnp.asarray(damping / wanted.mass)),
            contact=Contact(wanted.mass, stiffness, 1.0),
            parameters=of_each,
            units={"contactStiffness": "N/m", "contactDamping": "N s/m"},
            snippet=f"pybullet.changeDynamics(body, -1, linearDamping=0, {pasted(of_each)})",
            steps=600,
            expected_error=0.009,
            limit=(
                "for both bodies, with restitution 0: rigid-body restitution loses up to all of "
                f"its value to the gap at the step of touch. {LINEAR}. e is the same at all "
                "speeds, for this mass. The time step must resolve the contact."
            ),
            source="changeDynamics in the PyBullet Quickstart Guide, pybullet.org; "
            "Schwager & Pöschel 2007, doi 10.1007/s10035-007-0065-z",
        )


class ApproachDashpot(SpringAndDashpot):
    """δ'' = -(K/m) δ - b δ' for δ' > 0, δ'' = -(K/m) δ after; requires n = 1."""

    approach_only: ClassVar[bool] = True


@register_engine
class Newton(Engine):
    """ke and kd of SolverSemiImplicit: F = ke δ + kd δ' on approach, F = ke δ after.

    A dashpot on approach only delivers the square root of the e of one that acts until the force
    vanishes. ζ = kd/(2√(ke m)) is therefore that of Kelvin-Voigt without tension for e².
    """

    name = "newton"

    def draft(self, wanted: Wanted) -> Draft:
        square = jnp.square(jnp.asarray(wanted.restitution))
        zeta = KelvinVoigt(e=square, tension=False).damping_ratio()
        scaled = ApproachDashpot(rate=2 * zeta)
        stiffness = matched_stiffness(wanted, 1.0, scaled)
        damping = 2 * float(zeta) * math.sqrt(stiffness) * math.sqrt(wanted.mass)
        parameters = {"ke": stiffness, "kd": max(0.0, damping)}
        return Draft(
            model="SolverSemiImplicit",
            law=ApproachDashpot(rate=jnp.asarray(damping / wanted.mass)),
            contact=Contact(wanted.mass, stiffness, 1.0),
            parameters=parameters,
            units={"ke": "N/m", "kd": "N s/m"},
            snippet=f"newton.ModelBuilder.ShapeConfig({pasted(parameters)})",
            steps=1800,
            expected_error=0.009,
            scheme=Scheme.SEMI_IMPLICIT,
            limit=(
                "for both shapes, each with these numbers (Newton takes their means), and no "
                f"margin. {LINEAR}. e is the same at all speeds, for this mass. The time step must "
                "resolve the contact. For SolverMuJoCo export to engine mujoco; "
                "other solvers are not supported."
            ),
            source="eval_body_contact in newton/_src/solvers/semi_implicit/kernels_contact.py, "
            "github.com/newton-physics/newton",
        )
