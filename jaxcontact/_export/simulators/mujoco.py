"""MuJoCo: a soft constraint, which is a spring and a dashpot if its impedance is constant."""

from __future__ import annotations

import math

import jax.numpy as jnp

from ..._contact import Contact
from ..._laws import KelvinVoigt
from ..at_time_step import Scheme
from ..engine import Engine, register_engine
from ..wanted import Draft, Wanted, matched_stiffness
from .spring import SpringAndDashpot

# MuJoCo's own default at the start of a contact.
IMPEDANCE = 0.9

STEPS = 400
"""Steps per contact at which it was measured."""


@register_engine
class MuJoCo(Engine):
    """solref and solimp: with constant impedance a contact obeys δ'' = -k δ - b δ', without
    tension.

    This is Kelvin-Voigt without tension per unit of mass. ζ = b/(2√k) follows from e in closed
    form, and k from the duration.
    """

    name = "mujoco"

    def draft(self, wanted: Wanted) -> Draft:
        law = KelvinVoigt(e=jnp.asarray(wanted.restitution), tension=False)
        zeta = float(law.damping_ratio())
        stiffness = matched_stiffness(wanted, 1.0, law)
        k = stiffness / wanted.mass
        damping = 2 * zeta * math.sqrt(k)
        parameters = {"stiffness": k, "damping": damping, "dampratio": zeta, "impedance": IMPEDANCE}
        units = {"stiffness": "1/s^2", "damping": "1/s", "dampratio": "", "impedance": ""}
        return Draft(
            model="solref in the direct format, constant solimp",
            law=SpringAndDashpot(rate=jnp.asarray(damping)),
            contact=Contact(wanted.mass, stiffness, 1.0),
            parameters=parameters,
            units=units,
            # 0 - damping, because -0.0 would print as -0.
            snippet=(
                f'<option timestep="{wanted.duration / STEPS:.3g}"/>\n'
                "<default>\n"
                f'  <geom solref="{-k:.12g} {0 - damping:.12g}" '
                f'solimp="{IMPEDANCE:g} {IMPEDANCE:g} 0.001 0.5 2"/>\n'
                "</default>"
            ),
            steps=STEPS,
            expected_error=0.009,
            scheme=Scheme.SEMI_IMPLICIT,
            limit=(
                "for both geoms, here by default. Linear: the duration is that of the law at "
                "this speed; the force differs, it jumps at touch. e is the same at all speeds "
                "and masses. The time step must resolve the contact; the usual steps of "
                "milliseconds do not."
            ),
            source="mujoco.readthedocs.io/en/stable/modeling.html#solver-parameters; "
            "Schwager & Pöschel 2007, doi 10.1007/s10035-007-0065-z",
        )
