"""What a law is to a solver: its force in scaled units and the numbers it depends on.

In units of `Scale` an impact is `x'' = Γ - f(x, x')`, x(0) = 0, x'(0) = 1. A form knows f and the
coordinate in which f is smooth: `x = w^k`, `dt = w^(k-1) dτ`, so that `w' = v/k` and
`v' = Γ w^(k-1) - pull(w, v)` with `pull = w^(k-1) f(w^k, v)`. Powers of w then take the place of
fractional powers of x, which have no second derivative at touch and separation.
"""

from __future__ import annotations

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._contact import Contact
from .._laws import (
    AbstractHuntCrossley,
    AbstractLaw,
    AbstractOscillator,
    KuwabaraKono,
    power,
)
from .._parameter import as_parameter
from ._quadrature import Exponent
from ._scale import Scale

Lane = Float[Array, "..."]
Flag = Bool[Array, "..."]


def signed_power(w: Lane, exponent: Exponent) -> Lane:
    """w^exponent, continued smoothly to w < 0, where only the last trial step of a solve goes."""
    if isinstance(exponent, float) and exponent == int(exponent):
        return w ** int(exponent)
    return power(w, exponent)


class AbstractForm(eqx.Module):
    """A law in scaled units; a subclass is one shape of force."""

    tension: eqx.AbstractVar[bool]

    @abc.abstractmethod
    def order(self, n: Exponent) -> int:
        """The k of x = w^k."""

    @abc.abstractmethod
    def pull(self, w: Lane, v: Lane, n: Exponent, compressing: Flag) -> Lane:
        """w^(k-1) f(w^k, v), the unclamped force times dt/dτ."""

    @abc.abstractmethod
    def pulling(self, w: Lane, v: Lane, n: Exponent, compressing: Flag) -> Lane:
        """A smooth function that is negative where the force is, for contacts without tension."""

    @abc.abstractmethod
    def force(self, x: Lane, v: Lane, n: Exponent, compressing: Flag) -> Lane:
        """f(x, v), the unclamped force, right in value and derivative for x ≥ 0."""


def _smallest_order(*exponents_at_one: float, default: int = 2) -> int:
    """The smallest k ≤ 4 that makes all exponents k e - 1 whole numbers; 2 if there is none."""
    for k in (1, 2, 3, 4):
        if all(k * e == int(k * e) for e in exponents_at_one):
            return k
    return default


class HuntCrossleyForm(AbstractForm):
    """f = xⁿ (1 + α v)."""

    alpha: Lane
    tension: bool = eqx.field(static=True)

    def order(self, n: Exponent) -> int:
        """The k of x = w^k."""
        return _smallest_order(n + 1) if isinstance(n, float) else 2

    def pull(self, w: Lane, v: Lane, n: Exponent, compressing: Flag) -> Lane:
        """w^(k(n+1)-1) (1 + α v)."""
        return signed_power(w, self.order(n) * (n + 1) - 1) * (1 + self.alpha * v)

    def pulling(self, w: Lane, v: Lane, n: Exponent, compressing: Flag) -> Lane:
        """The sign of the force."""
        return 1 + self.alpha * v

    def force(self, x: Lane, v: Lane, n: Exponent, compressing: Flag) -> Lane:
        """xⁿ (1 + α v)."""
        return power(x, n) * (1 + self.alpha * v)


class OscillatorForm(AbstractForm):
    """f = xⁿ + a x^((n-1)/2) v with a = 2ζ √((n+1)/2)."""

    zeta: Lane
    tension: bool = eqx.field(static=True)
    approach_only: bool = eqx.field(static=True)

    @property
    def ending(self) -> str:
        """How the contact ends: "approach" (damped on approach only), "tension" or "clamped"."""
        if self.approach_only:
            return "approach"
        return "tension" if self.tension else "clamped"

    def order(self, n: Exponent) -> int:
        """The k of x = w^k."""
        return _smallest_order(n + 1, (n + 1) / 2) if isinstance(n, float) else 2

    def _damping(self, n: Exponent, compressing: Flag) -> Lane:
        zeta = jnp.where(compressing, self.zeta, 0) if self.approach_only else self.zeta
        return zeta * jnp.sqrt(jnp.asarray(2 * (n + 1), self.zeta.dtype))

    def pull(self, w: Lane, v: Lane, n: Exponent, compressing: Flag) -> Lane:
        """w^(k(n+1)-1) + a w^(k(n+1)/2-1) v."""
        elastic = self.order(n) * (n + 1) - 1
        viscous = self.order(n) * (n + 1) / 2 - 1
        return signed_power(w, elastic) + self._damping(n, compressing) * v * signed_power(
            w, viscous
        )

    def pulling(self, w: Lane, v: Lane, n: Exponent, compressing: Flag) -> Lane:
        """The sign of the force."""
        return signed_power(w, self.order(n) * (n + 1) / 2) + self._damping(n, compressing) * v

    def force(self, x: Lane, v: Lane, n: Exponent, compressing: Flag) -> Lane:
        """xⁿ + a x^((n-1)/2) v."""
        return power(x, n) + self._damping(n, compressing) * v * power(x, (n - 1) / 2)


class ViscoelasticForm(AbstractForm):
    """f = xⁿ + n a x^(n-1) v with a = A v0/X."""

    a: Lane
    tension: bool = eqx.field(static=True)

    def order(self, n: Exponent) -> int:
        """The k of x = w^k."""
        return _smallest_order(n + 1) if isinstance(n, float) else 2

    def pull(self, w: Lane, v: Lane, n: Exponent, compressing: Flag) -> Lane:
        """w^(k(n+1)-1) + n a w^(kn-1) v."""
        k = self.order(n)
        return signed_power(w, k * (n + 1) - 1) + n * self.a * v * signed_power(w, k * n - 1)

    def pulling(self, w: Lane, v: Lane, n: Exponent, compressing: Flag) -> Lane:
        """The sign of the force."""
        return w ** self.order(n) + n * self.a * v

    def force(self, x: Lane, v: Lane, n: Exponent, compressing: Flag) -> Lane:
        """xⁿ + n a x^(n-1) v."""
        return power(x, n) + n * self.a * v * power(x, n - 1)


class GeneralForm(AbstractForm):
    """Any law: its SI force, called in SI and scaled."""

    law: AbstractLaw
    contact: Contact
    scale: Scale
    tension: bool = eqx.field(static=True)

    def order(self, n: Exponent) -> int:
        """The k of x = w^k: square roots of the indentation are smooth in w."""
        return 1 if isinstance(n, float) and n == int(n) else 2

    def pull(self, w: Lane, v: Lane, n: Exponent, compressing: Flag) -> Lane:
        """w^(k-1) f(w^k, v), with the derivative at touch that the factor w^(k-1) gives it."""
        if self.order(n) == 1:
            return self.force(w, v, n, compressing)
        # The law's own derivative may be infinite at δ = 0, where w f vanishes: it is not asked.
        touching = w == 0
        return jnp.where(
            touching, 0, w * self.force(jnp.where(touching, 1, w) ** 2, v, n, compressing)
        )

    def pulling(self, w: Lane, v: Lane, n: Exponent, compressing: Flag) -> Lane:
        """The sign of the force."""
        return self.force(w ** self.order(n), v, n, compressing)

    def force(self, x: Lane, v: Lane, n: Exponent, compressing: Flag) -> Lane:
        """F(X x, v0 v) in units of m v0²/X."""
        force = self.law.force(
            self.scale.length * x, self.scale.speed * v, self.contact, self.scale.speed
        )
        return as_parameter(force, "force") / self.scale.force


def closed_form(
    law: AbstractLaw, contact: Contact | None, velocity: Lane | None
) -> HuntCrossleyForm | OscillatorForm | None:
    """The form of a law that is solved in closed form; None for other laws."""
    if isinstance(law, AbstractHuntCrossley):
        alpha = law.damping_factor(contact, velocity)
        return HuntCrossleyForm(alpha=alpha, tension=law.tension)
    if isinstance(law, AbstractOscillator):
        zeta = law.damping_ratio(contact)
        return OscillatorForm(zeta=zeta, tension=law.tension, approach_only=law.approach_only)
    return None


def restitution_is_constant(law: AbstractLaw, contact: Contact) -> bool:
    """Whether e is the same at every speed; known for the laws that are solved in closed form."""
    try:
        return jax.eval_shape(lambda: closed_form(law, contact, None)) is not None
    except (TypeError, ValueError):  # the law needs the speed
        return False


def reduce(law: AbstractLaw, contact: Contact, scale: Scale) -> AbstractForm:
    """The form of a law. It keeps only the numbers the scaled problem depends on, unbroadcast."""
    closed = closed_form(law, contact, scale.speed)
    if closed is not None:
        return closed
    if isinstance(law, KuwabaraKono):
        return ViscoelasticForm(a=law.A / scale.time, tension=law.tension)
    return GeneralForm(law=law, contact=contact, scale=scale, tension=law.tension)
