"""Newton: springs with dashpots on approach only, in its semi-implicit solver."""

from __future__ import annotations

import math
from typing import ClassVar

import jax.numpy as jnp

from ..._contact import Contact
from ..._laws import KelvinVoigt
from ..at_time_step import Scheme
from ..engine import Engine, register_engine
from ..wanted import Draft, Wanted, matched_stiffness
from .spring import SpringAndDashpot


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
        pasted = ", ".join(f"{name}={value:.12g}" for name, value in parameters.items())
        return Draft(
            model="SolverSemiImplicit",
            law=ApproachDashpot(rate=jnp.asarray(damping / wanted.mass)),
            contact=Contact(wanted.mass, stiffness, 1.0),
            parameters=parameters,
            units={"ke": "N/m", "kd": "N s/m"},
            snippet=f"newton.ModelBuilder.ShapeConfig({pasted})",
            steps=1800,
            expected_error=0.009,
            scheme=Scheme.SEMI_IMPLICIT,
            limit=(
                "for both shapes, each with these numbers (Newton takes their means), and no "
                "margin. Linear: the duration is that of the law at this speed; the force "
                "differs, it jumps at touch. e is the same at all speeds, for this mass. The "
                "time step must resolve the contact. For SolverMuJoCo export to engine mujoco; "
                "other solvers are not supported."
            ),
            source="eval_body_contact in newton/_src/solvers/semi_implicit/kernels_contact.py, "
            "github.com/newton-physics/newton",
        )
