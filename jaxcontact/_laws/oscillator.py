"""Laws F = K δⁿ + 2ζ √((n+1)/2) √(Km) δ^((n-1)/2) δ': linear oscillators in a suitable coordinate.

With s²/2 = δ^(n+1)/(n+1) and dτ = (δⁿ/s) dt (in scaled units) each law obeys s'' + 2ζ s' + s = 0
for every n. This is the damped linear oscillator with damping ratio ζ.
"""

from __future__ import annotations

import abc
from typing import TYPE_CHECKING, ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._entry import RESTITUTION, RESTITUTION_FROM_ZERO, parameter, static_value
from .._forms import Exponent, OscillatorForm
from .._functions import arc_over_sine, horner, implicit_root, power
from .base import AbstractDampedLaw, Instant, force_arguments
from .registry import register_law

if TYPE_CHECKING:
    from .._contact import Contact
    from .._forms import Scale


class AbstractOscillator(AbstractDampedLaw):
    """A law whose regularised form is the linear oscillator; a subclass returns ζ."""

    approach_only: ClassVar[bool] = False
    """True if the damping acts only while the bodies approach."""

    def jumps(self, exponent: Exponent) -> bool:
        return not (static_value(exponent) or 0) > 1

    @abc.abstractmethod
    def damping_ratio(self, contact: Contact | None = None) -> Float[Array, "..."]:
        """Return the damping ratio ζ ≥ 0 of the regularised oscillator, dimensionless."""

    def _whole_force(self, at: Instant) -> Float[Array, "..."]:
        # At δ = 0 the derivative in δ is infinite for 1 < n < 3 and is that of the elastic part.
        contact, (depth, rate, _) = at.contact, force_arguments(*at)
        n = contact.exponent
        if self.approach_only:
            rate = jnp.maximum(rate, 0)
        # Two roots instead of the root of the product: K m may overflow float32, its root does not.
        damping = (
            self.damping_ratio(contact)
            * jnp.sqrt(jnp.asarray(2 * (n + 1)))
            * jnp.sqrt(contact.stiffness)
            * jnp.sqrt(contact.mass)
        )
        return contact.stiffness * power(depth, n) + damping * rate * power(depth, (n - 1) / 2)

    def form(self, contact: Contact | None, scale: Scale | None) -> OscillatorForm:
        zeta = self.damping_ratio(contact)
        return OscillatorForm(zeta=zeta, tension=self.tension, approach_only=self.approach_only)


def _log_decrement_ratio(e: Float[Array, "..."]) -> Float[Array, "..."]:
    """Return ζ = -ln e/√(π² + ln² e), for an oscillator released after half a period."""
    decrement = -jnp.log(e)
    return decrement / jnp.sqrt(jnp.pi**2 + jnp.square(decrement))


def _clamped_residual(
    zeta: Float[Array, "..."], half_decrement: Float[Array, "..."]
) -> Float[Array, "..."]:
    return zeta * arc_over_sine(zeta) - half_decrement


def _clamped_guess(half_decrement: Float[Array, "..."]) -> Float[Array, "..."]:
    # ζ = cos θ with θ cot θ = μ below critical damping; ζ = cosh θ with θ coth θ = μ above it.
    mu = half_decrement
    above = mu > 1
    mu_above = jnp.where(above, mu, 1)
    theta_squared = (mu_above - 1) * (mu_above + 1 + 1 / jnp.square(mu_above))
    # At θ = 0 the square root has infinite slope, but the guess is never differentiated.
    over = jnp.cosh(jnp.sqrt(theta_squared))
    under = mu * (2 / jnp.pi + (1 - 2 / jnp.pi) * mu)
    return jnp.where(above, over, under)


_clamped_ratio = implicit_root(_clamped_residual, _clamped_guess, iterations=6)


@register_law(
    "kelvin_voigt",
    formula="K δ + 2ζ √(Km) δ'",
    source="Anagnostopoulos 1988, doi 10.1002/eqe.4290160311; "
    "without tension Schwager & Pöschel 2007, doi 10.1007/s10035-007-0065-z",
    valid="all e in (0, 1], exactly; n = 1",
)
class KelvinVoigt(AbstractOscillator):
    """The linear spring and dashpot F = K δ + 2ζ √(Km) δ', which delivers exactly its parameter e.

    With tension (the default) the contact ends at δ = 0 and ζ = -ln e/√(π² + ln² e). With
    `tension=False` it ends where the force vanishes and ζ solves `ln e = -2ζ arccos(ζ)/√(1-ζ²)`.
    `e` in (0, 1]; requires n = 1. The force jumps at touch; at δ = 0 its derivative in δ is K.
    Raises ValueError for a Python scalar out of range. Source: Anagnostopoulos (1988), Earthquake
    Eng. Struct. Dyn. 16:443, doi 10.1002/eqe.4290160311; without tension Schwager & Pöschel (2007),
    Granular Matter 9:465, doi 10.1007/s10035-007-0065-z.
    """

    e: Float[Array, "..."] = parameter("e", RESTITUTION)
    tension = True
    exponents: ClassVar[tuple[float, ...] | None] = (1.0,)

    def damping_ratio(self, contact: Contact | None = None) -> Float[Array, "..."]:
        if self.tension:
            return _log_decrement_ratio(self.e)
        return _clamped_ratio(-jnp.log(self.e) / 2)


@register_law(
    "antypov_elliott",
    formula="K δ^(3/2) + √5 ζ √(Km) δ^(1/4) δ', ζ = -ln e/√(π²+ln²e)",
    source="Antypov & Elliott 2011, doi 10.1209/0295-5075/94/50004",
    valid="all e in (0, 1], exactly (with tension)",
)
class AntypovElliott(AbstractOscillator):
    """The damped Hertz contact that delivers exactly its e: the oscillator with the ζ of
    Kelvin-Voigt.

    F = K δ^(3/2) + √5 ζ √(Km) δ^(1/4) δ' with ζ = -ln e/√(π² + ln² e). For other exponents the
    damping term is 2ζ √((n+1)/2) √(Km) δ^((n-1)/2) δ', and e is still exact. `e` in (0, 1]. The
    contact may pull; with `tension=False` it delivers more than e. Raises ValueError for a Python
    scalar out of range. Source: Antypov & Elliott (2011), EPL 94:50004, doi
    10.1209/0295-5075/94/50004.
    """

    e: Float[Array, "..."] = parameter("e", RESTITUTION)
    tension = True

    def damping_ratio(self, contact: Contact | None = None) -> Float[Array, "..."]:
        return _log_decrement_ratio(self.e)


_TSUJI = (1.2728, -4.2783, 11.087, -22.348, 27.467, -18.022, 4.8218)


@register_law(
    "tsuji",
    formula="K δ^(3/2) + a √(Km) δ^(1/4) δ', a a polynomial in e",
    source="Tsuji et al. 1992, doi 10.1016/0032-5910(92)88030-L",
    valid="e within 0.001 of the given one below 1; not elastic at e = 1; n = 3/2",
)
class Tsuji(AbstractOscillator):
    """The damped Hertz contact of granular codes: F = K δ^(3/2) + a √(Km) δ^(1/4) δ'.

    a = √2 (1.2728 - 4.2783e + 11.087e² - 22.348e³ + 27.467e⁴ - 18.022e⁵ + 4.8218e⁶), a fit to -√5
    ln e/√(π² + ln² e). `e` in [0, 1]; requires n = 3/2. The contact may pull. At e = 1 a small
    damping remains. Raises ValueError for a Python scalar out of range. Source: Tsuji, Tanaka &
    Ishida (1992), Powder Technol. 71:239, doi 10.1016/0032-5910(92)88030-L; the factor √2 converts
    to the effective mass.
    """

    e: Float[Array, "..."] = parameter("e", RESTITUTION_FROM_ZERO)
    tension = True
    exponents: ClassVar[tuple[float, ...] | None] = (1.5,)

    def damping_ratio(self, contact: Contact | None = None) -> Float[Array, "..."]:
        """Return ζ = a/√5."""
        return jnp.sqrt(0.4) * horner(_TSUJI, self.e)


_THORNTON = (
    0.0,
    -6.918798,
    -16.41105,
    146.8049,
    -796.4559,
    2928.711,
    -7206.864,
    11494.29,
    -11342.18,
    6276.757,
    -1489.915,
)
# The same polynomial in powers of 1-e. In powers of e its terms cancel at e = 1 up to 1e4 to 1;
# these coefficients were summed exactly in decimal arithmetic.
_THORNTON_AT_ONE = (
    -12.181848,
    68.525798,
    -454.45475,
    2293.3307,
    -7919.0789,
    18681.661,
    -29962.436,
    32069.698,
    -21897.542,
    8622.393,
    -1489.915,
)


@register_law(
    "thornton",
    formula="K δ^(3/2) + 2γ √(3/2) √(Km) δ^(1/4) δ', γ(e) a fit",
    source="Thornton et al. 2013, doi 10.1016/j.powtec.2012.08.012",
    valid="e within 0.001 below 0.95; 0.985 at e = 1; n = 3/2",
)
class Thornton(AbstractOscillator):
    """The damped Hertz contact without tension: F = max(0, K δ^(3/2) + 2γ √(3Km/2) δ^(1/4) δ').

    γ = √(1/(1 - (1+e)² exp(Σ h_i e^i)) - 1), i = 1..10. `e` in (0, 1]; requires n = 3/2. The law
    delivers 0.985 at e = 1. The contact ends where its force vanishes. Raises ValueError for a
    Python scalar out of range. Source: Thornton, Cummins & Cleary (2013), Powder Technol. 233:30,
    doi 10.1016/j.powtec.2012.08.012.
    """

    e: Float[Array, "..."] = parameter("e", RESTITUTION)
    tension = False
    exponents: ClassVar[tuple[float, ...] | None] = (1.5,)

    def damping_ratio(self, contact: Contact | None = None) -> Float[Array, "..."]:
        """Return ζ = γ √(6/5)."""
        # 1/(1-q) - 1 = q/(1-q) avoids cancellation near e = 1, where q is small.
        fit = jnp.where(
            self.e > 0.5, horner(_THORNTON_AT_ONE, 1 - self.e), horner(_THORNTON, self.e)
        )
        log_q = 2 * jnp.log1p(self.e) + fit
        gamma_squared = jnp.exp(log_q) / -jnp.expm1(log_q)
        return jnp.sqrt(1.2 * gamma_squared)


@register_law(
    "jankowski",
    formula="K δ^(3/2) + 2ξ √(mK√δ) δ' on approach, K δ^(3/2) after",
    source="Jankowski 2006, doi 10.1002/eqe.537",
    valid="e within 0.008; n = 3/2",
)
class Jankowski(AbstractOscillator):
    """Damping on approach only: F = K δ^(3/2) + 2ξ √(mK√δ) δ' for δ' > 0, F = K δ^(3/2) after.

    ξ = (9√5/2)(1-e²)/(e(e(9π-16)+16)). `e` in (0, 1]; requires n = 3/2. The law delivers e within
    0.008. It never pulls, for either value of `tension`. Raises ValueError for a Python scalar out
    of range. Source: Jankowski (2005), Earthquake Eng. Struct. Dyn. 34:595, doi 10.1002/eqe.434,
    and (2006), 35:517, doi 10.1002/eqe.537.
    """

    e: Float[Array, "..."] = parameter("e", RESTITUTION)
    tension = True
    approach_only: ClassVar[bool] = True
    exponents: ClassVar[tuple[float, ...] | None] = (1.5,)

    def damping_ratio(self, contact: Contact | None = None) -> Float[Array, "..."]:
        """Return ζ = 2ξ/√5."""
        e = self.e
        return 9 * (1 - e) * (1 + e) / (e * (e * (9 * jnp.pi - 16) + 16))
