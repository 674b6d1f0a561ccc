"""MuJoCo: a soft constraint, which is a spring and a dashpot where its impedance is constant."""

from __future__ import annotations

import math
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..._contact import Contact
from ..._laws import AbstractOscillator, KelvinVoigt, as_tension
from ..._parameter import NOT_NEGATIVE, parameter
from .._engine import Engine, register_engine
from .._wanted import Draft, Wanted, matched_stiffness

# MuJoCo's own default for a contact that is just touched.
IMPEDANCE = 0.9


class SoftConstraint(AbstractOscillator):
    """MuJoCo's contact with constant impedance: δ'' = -k δ - b δ' while that pushes.

    `damping` b ≥ 0 in 1/s, the second number of solref in its direct format without its sign; the
    first, k in 1/s², is K/m of the contact. Needs n = 1. Source: the pages on solver parameters in
    MuJoCo's documentation, mujoco.readthedocs.io/en/stable/modeling.html#solver-parameters.
    """

    damping: Float[Array, "..."] = parameter("damping", NOT_NEGATIVE)
    tension: bool = eqx.field(static=True, default=False, kw_only=True, converter=as_tension)
    exponents: ClassVar[tuple[float, ...] | None] = (1.0,)

    def damping_ratio(self, contact: Contact | None = None) -> Float[Array, "..."]:
        """ζ = b/(2√(K/m)); ValueError if `contact` is missing."""
        if contact is None:
            raise ValueError("Argument `contact` is needed for `SoftConstraint`, but is None.")
        return self.damping / 2 * jnp.sqrt(contact.mass) / jnp.sqrt(contact.stiffness)


@register_engine
class MuJoCo(Engine):
    """solref and solimp: with constant impedance a contact obeys δ'' = -k δ - b δ', pushing only.

    That is Kelvin-Voigt without tension per unit of mass: ζ = b/(2√k) from e in closed form, and k
    from the duration.
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
            law=SoftConstraint(damping=jnp.asarray(damping)),
            contact=Contact(wanted.mass, stiffness, 1.0),
            parameters=parameters,
            units=units,
            # 0 - damping, because -0.0 would print as -0.
            snippet=(
                f'solref="{-k:.12g} {0 - damping:.12g}" '
                f'solimp="{IMPEDANCE:g} {IMPEDANCE:g} 0.001 0.5 2"'
            ),
            steps=400,
            expected_error=0.009,
            limit=(
                "for both geoms. Linear: the duration is that of the law, at this speed; the force "
                "is not, it jumps at touch. e is the same at all speeds and masses. The time step "
                "must resolve the contact; the usual steps of milliseconds do not."
            ),
            source="mujoco.readthedocs.io/en/stable/modeling.html#solver-parameters; "
            "Schwager & Pöschel 2007, doi 10.1007/s10035-007-0065-z",
        )
