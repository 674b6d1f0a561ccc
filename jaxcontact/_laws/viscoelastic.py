"""Viscoelastic spheres: damping proportional to the rate of the elastic force."""

from __future__ import annotations

import functools
import json
from importlib.resources import files
from typing import TYPE_CHECKING, Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._entry import NOT_NEGATIVE, parameter, static_value
from .._forms import (
    AbstractForm,
    Exponent,
    Flag,
    Lane,
    OscillatorForm,
    Scale,
    ScaledImpact,
)
from .._functions import chebyshev_by_piece, power
from .base import AbstractRateLaw, needed
from .registry import register_law

if TYPE_CHECKING:
    from .._contact import Contact


class ViscoelasticForm(AbstractForm):
    """f = xⁿ + n a x^(n-1) v with a = A v0/X."""

    a: Lane
    tension: bool = eqx.field(static=True)
    creeps_free: ClassVar[bool] = True

    def damping(self, n: Exponent, compressing: Flag) -> tuple[Lane, Exponent]:
        return n * self.a, 1.0

    def force(self, x: Lane, v: Lane, n: Exponent, compressing: Flag) -> Lane:
        return power(x, n) + n * self.a * v * power(x, n - 1)


class ViscoelasticSpheresForm(ViscoelasticForm):
    """The solved viscoelastic form for n = 3/2: its impacts are series in ln(1+a).

    The series are certified to 1e-15, including their slopes, for every a ≥ 0. Each represents a
    slowly growing function, obtained with factors from the limit of strong damping. The times of
    the turn, and of the end without tension, are multiplied by (1+a)^(2/3). The end with tension is
    divided by 1+a. For restitution the function is the q of e = (1 + a q)^-p, with p = 5 with
    tension and 5/3 without. Without tension the contact ends at the first of two roots of an
    analytic equation. These roots differ by half powers of a.
    """

    damping_number: ClassVar[str | None] = "a"

    def restitution(self) -> Lane:
        return jnp.exp(-self._decay())

    def solve(self, n: Exponent) -> ScaledImpact:
        """Return the impact, entirely by series."""
        slowly = jnp.exp(jnp.log1p(self.a) * (2 / 3))
        if self.tension:
            duration = self._series("duration") * (1 + self.a)
        else:
            half = self._series("clamped_duration_half") * self._weak(3.5)
            duration = (self._series("clamped_duration") + half) / slowly
        decay = self._decay()
        return ScaledImpact(
            restitution=jnp.exp(-decay),
            duration=duration,
            compression_time=self._series("compression_time") / slowly,
            max_indentation=self._series("max_indentation") / slowly,
            max_force=self._series("max_force") * slowly,
            min_force=self._min_force() if self.tension else None,
            energy_loss=-jnp.expm1(-2 * decay),
        )

    def _min_force(self) -> Lane:
        half = self._series("min_force_half") * self._weak(1.5)
        return -(self._series("min_force") + half) * jnp.exp(jnp.log1p(self.a) * (-8 / 3))

    def _decay(self) -> Lane:
        """Return -ln e."""
        if self.tension:
            return 5 * jnp.log1p(self.a * self._series("decay"))
        half = self._series("clamped_decay_half") * self._weak(1.5)
        return (5 / 3) * jnp.log1p(self.a * (self._series("clamped_decay") + half))

    def _series(self, name: str) -> Lane:
        ends, rows = _coefficients(name, self.a.dtype)
        return chebyshev_by_piece(ends, rows, jnp.log1p(self.a))

    def _weak(self, exponent: float) -> Lane:
        """Return the half power of a on the first piece; it does not contribute on the others."""
        weakest = float(np.expm1(_stored()["ends"][1]))
        return power(jnp.minimum(self.a, weakest), exponent)


@functools.cache
def _stored() -> dict[str, Any]:
    return json.loads(files("jaxcontact._laws").joinpath("viscoelastic_series.json").read_text())


@functools.cache
def _coefficients(name: str, dtype: Any) -> tuple[list[float], list[list[float]]]:
    """Return the ends of the pieces, and the coefficient rows that matter in a precision."""
    columns = _stored()["series"][name]
    table = np.zeros((max(map(len, columns)), len(columns)))
    for k, column in enumerate(columns):
        table[: len(column), k] = column
    # Slopes weight a coefficient by the square of its degree.
    least = np.abs(table).max() * float(jnp.finfo(dtype).eps) / 1000
    count = 1 + np.flatnonzero(np.abs(table).max(axis=1) > least)[-1]
    return _stored()["ends"], table[:count].tolist()


@register_law(
    "kuwabara_kono",
    formula="K (δⁿ + n A δ^(n-1) δ')",
    source="Kuwabara & Kono 1987, doi 10.1143/JJAP.26.1230",
    valid="A ≥ 0; 1-e grows as v0^(1/5)",
)
class KuwabaraKono(AbstractRateLaw):
    """Viscoelastic spheres: F = K (δⁿ + n A δ^(n-1) δ'), K (δ^(3/2) + (3/2) A √δ δ') for Hertz.

    `A` ≥ 0 is a material time in s. Restitution falls with speed. For a Hertz contact 1 - e ≈
    1.15344 (3/2) A (K/m)^(2/5) v0^(1/5) as long as that is small, so e(v) determines only A
    (K/m)^(2/5). As published, the contact may pull shortly before it ends at δ = 0. With
    `tension=False` it ends where the force vanishes.

    For n = 1 the law is the linear spring and dashpot with ζ = A √(K/m)/2. With tension and ζ ≥ 1
    this contact creeps back without end and the impact is settled. For n = 3/2 free impacts are
    series in ln(1 + A (K/m)^(2/5) v0^(1/5)), certified to 1e-12. Method "exact" applies to these
    two exponents, "event" to all others. At δ = 0 the derivative in δ of √δ is infinite and is
    defined to be 0.

    Raises ValueError for a Python scalar out of range. Source: Kuwabara & Kono (1987), Jpn. J.
    Appl. Phys. 26:1230, doi 10.1143/JJAP.26.1230; Brilliantov et al. (1996), Phys. Rev. E 53:5382,
    doi 10.1103/PhysRevE.53.5382.
    """

    A: Float[Array, "..."] = parameter("A", NOT_NEGATIVE)
    tension = True

    def jumps(self, exponent: Exponent) -> bool:
        return not (static_value(exponent) or 0) > 1

    def _force_at(self, depth: Lane, rate: Lane, contact: Contact) -> Lane:
        n = contact.exponent
        return contact.stiffness * (power(depth, n) + n * self.A * power(depth, n - 1) * rate)

    def form(self, contact: Contact | None, scale: Scale | None) -> AbstractForm:
        exponent = needed(contact, "contact", self).exponent
        a = self.A / needed(scale, "velocity", self).time
        if static_value(exponent) == 1:
            # The linear spring and dashpot has a closed form.
            return OscillatorForm(zeta=a / 2, tension=self.tension, approach_only=False)
        if static_value(exponent) == 1.5:
            return ViscoelasticSpheresForm(a=a, tension=self.tension)
        return ViscoelasticForm(a=a, tension=self.tension)
