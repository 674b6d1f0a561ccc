"""Laws with a dashpot coefficient in N s/m in parallel with the elastic force K δⁿ."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._entry import NOT_NEGATIVE, POSITIVE, parameter, static_value
from .._forms import AbstractForm, Exponent, Flag, Lane, OscillatorForm, Scale
from .._functions import power
from .base import AbstractLaw, AbstractRateLaw, needed
from .registry import register_law

if TYPE_CHECKING:
    from .._contact import Contact


class DashpotForm(AbstractForm):
    """f = xⁿ + a v for x ≥ 0, with a = c X/(m v0) ≥ 0."""

    a: Lane
    tension: bool = eqx.field(static=True)
    creeps_free: ClassVar[bool] = True
    damping_number: ClassVar[str | None] = "a"

    def damping(self, n: Exponent, compressing: Flag) -> tuple[Lane, Exponent] | None:
        # With tension and n > 1 a strongly damped contact creeps back without end, a weakly damped
        # one separates. No formula gives the limit, so the contact is solved like a general force.
        return None if self.tension else (self.a, n)

    def force(self, x: Lane, v: Lane, n: Exponent, compressing: Flag) -> Lane:
        return power(x, n) + self.a * v


@register_law(
    "linear_dashpot",
    formula="max(0, K δⁿ + c δ')",
    source="Schwager & Pöschel 2007, doi 10.1007/s10035-007-0065-z; "
    "with tension Anagnostopoulos 1988, doi 10.1002/eqe.4290160311",
    valid="c ≥ 0; e is constant at n = 1, and rises with speed for n > 1",
)
class LinearDashpot(AbstractRateLaw):
    """A spring with a linear dashpot given by its coefficient: F = max(0, K δⁿ + c δ').

    `c` ≥ 0 in N s/m. For n = 1 it is the Kelvin-Voigt contact with ζ = c/(2√(Km)) and has its
    closed form; `KelvinVoigt` computes that ζ from e. For other exponents e rises with the closing
    speed, since the dashpot force becomes small relative to K δⁿ. The force jumps to c v0 at touch;
    at δ = 0 its derivative in δ is that of K δⁿ.

    The contact ends where the force vanishes. With `tension=True` it may pull and ends at δ = 0. A
    strongly damped contact with tension creeps back without end: it is reported as settled for n =
    1, and as not converged for other exponents.

    Raises ValueError for a Python scalar out of range. Source: Schwager & Pöschel (2007), Granular
    Matter 9:465, doi 10.1007/s10035-007-0065-z; with tension Anagnostopoulos (1988), Earthquake
    Eng. Struct. Dyn. 16:443, doi 10.1002/eqe.4290160311.
    """

    c: Float[Array, "..."] = parameter("c", NOT_NEGATIVE)
    tension = False

    def _force_at(self, depth: Lane, rate: Lane, contact: Contact) -> Lane:
        dashpot = jnp.where(depth < 0, 0, self.c * rate)
        return contact.stiffness * power(depth, contact.exponent) + dashpot

    def form(self, contact: Contact | None, scale: Scale | None) -> AbstractForm:
        contact, scale = needed(contact, "contact", self), needed(scale, "velocity", self)
        a = self.c * scale.time / contact.mass
        if static_value(contact.exponent) == 1:
            return OscillatorForm(zeta=a / 2, tension=self.tension, approach_only=False)
        return DashpotForm(a=a, tension=self.tension)


@register_law(
    "step_damping",
    formula="max(0, K δⁿ + STEP(δ, 0, 0, d, c_max) δ')",
    source="IMPACT function, Adams Solver documentation, MSC Software",
    valid="c_max ≥ 0, d > 0",
)
class StepDamping(AbstractRateLaw):
    """The IMPACT function of MSC Adams: F = max(0, K δⁿ + STEP(δ, 0, 0, d, c_max) δ').

    STEP(δ, 0, 0, d, c_max) = c_max (δ/d)² (3 - 2 δ/d) rises from 0 at touch to `c_max` ≥ 0 in N s/m
    at the depth `d` > 0 in m, and stays constant beyond. The force starts at zero. The force and
    STEP have continuous first derivatives in δ and d, also at δ = 0 and δ = d, where the derivative
    of STEP in δ is zero. The second derivatives of STEP jump at these points; at δ = d they take
    their values from δ < d.

    For indentations far below d the damping is 3 c_max (δ/d)². For d far below the indentations it
    is that of `LinearDashpot(c_max)`. The force never pulls. After it has vanished in restitution
    it may push again before δ = 0. With `tension=True` it is not clamped; the IMPACT function of
    Adams is clamped.

    Raises ValueError for a Python scalar out of range. Source: IMPACT and STEP in the Adams Solver
    documentation, MSC Software (Hexagon).
    """

    c_max: Float[Array, "..."] = parameter("c_max", NOT_NEGATIVE)
    d: Float[Array, "..."] = parameter("d", POSITIVE)
    tension = False

    def jumps(self, exponent: Exponent) -> bool:
        return False

    def _force_at(self, depth: Lane, rate: Lane, contact: Contact) -> Lane:
        # Beyond d the cubic is not evaluated, because it or its derivative in d may overflow.
        inside = depth <= self.d
        part = jnp.maximum(jnp.where(inside, depth, 1), 0) / jnp.where(inside, self.d, 1)
        damping = self.c_max * jnp.square(part) * (3 - 2 * part)
        return contact.stiffness * power(depth, contact.exponent) + damping * rate

    def form(self, contact: Contact | None, scale: Scale | None) -> AbstractForm:
        # A clamped force has zero slope at the end of the contact, so the form uses the unclamped
        # one.
        unclamped = dataclasses.replace(self, tension=True)
        form = AbstractLaw.form(unclamped, contact, scale)
        return dataclasses.replace(form, tension=self.tension)
