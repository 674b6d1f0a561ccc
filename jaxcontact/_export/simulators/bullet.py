"""Bullet: contacts with stiffness and damping. Its rigid-body restitution is not exported."""

from __future__ import annotations

import math

import jax.numpy as jnp

from ..._contact import Contact
from ..._laws import KelvinVoigt
from ..engine import Engine, register_engine
from ..wanted import Draft, Wanted, matched_stiffness
from .spring import SpringAndDashpot


@register_engine
class Bullet(Engine):
    """contactStiffness and contactDamping: F = K δ + C δ' while positive.

    Two bodies with k and c each have K = k/2 (springs in series) and C = 2 c (dampings add).
    """

    name = "bullet"

    def draft(self, wanted: Wanted) -> Draft:
        law = KelvinVoigt(e=jnp.asarray(wanted.restitution), tension=False)
        zeta = float(law.damping_ratio())
        stiffness = matched_stiffness(wanted, 1.0, law)
        damping = 2 * zeta * math.sqrt(stiffness) * math.sqrt(wanted.mass)
        of_each = {"contactStiffness": 2 * stiffness, "contactDamping": max(0.0, damping / 2)}
        pasted = ", ".join(f"{name}={value:.12g}" for name, value in of_each.items())
        return Draft(
            model="contactStiffness and contactDamping",
            law=SpringAndDashpot(rate=jnp.asarray(damping / wanted.mass)),
            contact=Contact(wanted.mass, stiffness, 1.0),
            parameters=of_each,
            units={"contactStiffness": "N/m", "contactDamping": "N s/m"},
            snippet=f"pybullet.changeDynamics(body, -1, linearDamping=0, {pasted})",
            steps=600,
            expected_error=0.009,
            limit=(
                "for both bodies, with restitution 0: rigid-body restitution loses up to all of "
                "its value to the gap at the step of touch. Linear: the duration is that of the "
                "law at this speed; the force differs, it jumps at touch. e is the same at all "
                "speeds, for this mass. The time step must resolve the contact."
            ),
            source="changeDynamics in the PyBullet Quickstart Guide, pybullet.org; "
            "Schwager & Pöschel 2007, doi 10.1007/s10035-007-0065-z",
        )
