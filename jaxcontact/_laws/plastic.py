"""Plastic contacts: a force of loading, and an elastic way back that ends before δ = 0."""

from __future__ import annotations

import abc
import math
from typing import TYPE_CHECKING, ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from .._entry import NOT_NEGATIVE, POSITIVE, Range, as_parameter, parameter
from .._forms import (
    AbstractPlasticForm,
    BilinearForm,
    Exponent,
    TwoCurvesForm,
    YieldingForm,
    scale_of,
)
from .base import AbstractLaw, Instant, contact_for, force_arguments, needed, require_exponent
from .registry import register_law

if TYPE_CHECKING:
    from .._contact import Contact
    from .._forms import Scale

STIFFER = Range(low=1.0, inside=1.0)


class AbstractPlastic(AbstractLaw):
    """A law whose force depends on the largest indentation of the contact so far.

    The contact is loading while δ is the largest indentation. From there it unloads and reloads
    elastically, and its force vanishes at a plastic indentation δ_p > 0. It starts afresh at the
    next touch. The contact never pulls.
    """

    tension = False
    remembers: ClassVar[bool] = True

    def __check_init__(self) -> None:
        if self.tension:
            raise ValueError(
                f"Argument `tension` must be False for `{type(self).__name__}`, which unloads to "
                "zero force, but is True."
            )

    def jumps(self, exponent: Exponent) -> bool:
        return False

    @abc.abstractmethod
    def _over_stiffness(self, contact: Contact) -> AbstractPlasticForm:
        """Return F/K as a form of δ in m, with its α in s/m."""

    def force(
        self,
        indentation: ArrayLike,
        velocity: ArrayLike,
        contact: Contact,
        impact_velocity: ArrayLike,
        largest: ArrayLike | None = None,
    ) -> Float[Array, "..."]:
        """Return F in N, zero for δ < 0. `largest` is the largest indentation of the contact so far
        in m. The contact is loading where δ is at least that, or if it is None.
        """
        depth = as_parameter(indentation, "indentation")
        deepest = jnp.zeros_like(depth)
        if largest is not None:
            most = as_parameter(largest, "largest")
            deepest = jnp.where(depth >= most, 0, most)
        force = self._force_after(Instant(depth, velocity, contact, impact_velocity), deepest)
        return jnp.maximum(force, 0)

    def _force_after(self, at: Instant, deepest: ArrayLike) -> Float[Array, "..."]:
        depth, rate, _ = force_arguments(*at)
        require_exponent(self, at.contact)
        deepest = jnp.asarray(deepest)
        form = self._over_stiffness(at.contact).remembering(deepest)
        force = form.force(jnp.maximum(depth, 0), rate, form.own_exponent, deepest <= 0)
        return at.contact.stiffness * force

    def _energies(
        self, indentation: ArrayLike, contact: Contact, speed: ArrayLike, largest: ArrayLike
    ) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
        largest = jnp.asarray(largest)
        form, stiffness = self._over_stiffness(contact).remembering(largest), contact.stiffness
        x = jnp.maximum(jnp.asarray(indentation), 0)
        return stiffness * form.stored(x, 1.0, 1), stiffness * form.kept(largest)


@register_law(
    "walton_braun",
    formula="K δ, back K_u (δ - δ_p), K_u = K ratio + slope F_max",
    source="Walton & Braun 1986, doi 10.1122/1.549893",
    valid="n = 1; ratio ≥ 1, slope ≥ 0; e = (K/K_u)^(1/2)",
)
class WaltonBraun(AbstractPlastic):
    """Walton and Braun's bilinear contact: F = K δ while loading, K_u (δ - δ_p) on the way back.

    `ratio` ≥ 1 is K_u/K without load. `slope` ≥ 0 in 1/m makes unloading stiffer with the largest
    force: K_u = ratio K + slope F_max. The way back begins at F_max and ends at δ_p. Hence e² =
    K/K_u = 1/(ratio + slope v0/ω), ω = √(K/m): a constant e for slope = 0, and an e that falls with
    speed otherwise. The exponent is 1. Largest force, indentation and time of compression are those
    of the spring K; the way back lasts e times as long as compression.

    Raises ValueError for a Python scalar out of range, for `tension=True`, and, where it is used,
    for another exponent. Source: Walton & Braun (1986), J. Rheol. 30:949, doi 10.1122/1.549893.
    """

    ratio: Float[Array, "..."] = parameter("ratio", STIFFER)
    slope: Float[Array, "..."] = parameter("slope", NOT_NEGATIVE, "1/m")
    exponents: ClassVar[tuple[float, ...] | None] = (1.0,)

    @property
    def damped(self) -> bool:
        return False

    def _over_stiffness(self, contact: Contact) -> BilinearForm:
        return BilinearForm(factor=self.ratio, slope=self.slope)

    def form(self, contact: Contact | None, scale: Scale | None) -> BilinearForm:
        contact_for(contact, self)
        length = needed(scale, "velocity", self).length
        return BilinearForm(factor=self.ratio, slope=self.slope * length)


class AbstractElasticPlastic(AbstractPlastic):
    """An elastic-plastic law of your own: a curve of loading, and an elastic way back.

    The state of such a contact is its largest indentation δ_m. While δ = δ_m it is loading, with
    the force `loading`. From there it unloads and reloads along F = K_u (δ - δ_p)ⁿ, where
    `unloading` states K_u and δ_p as functions of δ_m. Both forces are multiplied by 1 + a δ' with
    the `damping` a. The contact never pulls, and the next touch starts afresh.

    A subclass defines `loading` and `unloading`, whose forces must agree at δ_m: `loading(δ_m)` =
    K_u (δ_m - δ_p)ⁿ with 0 ≤ δ_p < δ_m. An impact whose forces differ there by more than 1e-8 (3e-4
    in single precision), relative, is NOT_CONVERGED. A subclass sets `exponents` to a tuple of the
    one n of its way back. `corners` lists where `loading` is not smooth, and `damping` returns a in
    s/m. The law is solved by the event method, with the moments of unloading and reloading as
    events. Source: Johnson (1985), Contact Mechanics, section 11.5, doi
    10.1017/CBO9781139171731.
    """

    exponents: ClassVar[tuple[float, ...] | None] = (1.5,)

    @abc.abstractmethod
    def loading(self, indentation: Float[Array, "..."], contact: Contact) -> Float[Array, "..."]:
        """Return the force in N at the indentation δ ≥ 0 in m of a contact that is loading."""

    @abc.abstractmethod
    def unloading(
        self, largest: Float[Array, "..."], contact: Contact
    ) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
        """Return K_u in N/mⁿ and δ_p in m of the way back from the largest indentation in m."""

    def corners(self, contact: Contact) -> tuple[Float[Array, "..."], ...]:
        """Return the indentations in m, ascending, at which `loading` is not smooth; none by
        default.
        """
        return ()

    def damping(self, contact: Contact) -> Float[Array, "..."] | None:
        """Return the a in s/m of the factor 1 + a δ'; None by default, without damping."""
        return None

    @property
    def damped(self) -> bool:
        return type(self).damping is not AbstractElasticPlastic.damping

    def _over_stiffness(self, contact: Contact) -> TwoCurvesForm:
        return self._in_units(contact, jnp.ones_like(contact.stiffness), contact.stiffness, 1.0)

    def form(self, contact: Contact | None, scale: Scale | None) -> TwoCurvesForm:
        units = needed(scale, "velocity", self)
        return self._in_units(contact_for(contact, self), units.length, units.force, units.speed)

    def _in_units(
        self, contact: Contact, length: Array, force: Array, speed: Array | float
    ) -> TwoCurvesForm:
        if self.exponents is None or len(self.exponents) != 1:
            raise TypeError(
                f"Law `{type(self).__name__}` must set `exponents` in the class to a tuple of the "
                f"one exponent of its way back, but it is {self.exponents!r}."
            )
        damping = self.damping(contact)
        return TwoCurvesForm(
            law=self,
            contact=contact,
            length=length,
            unit=force,
            own_exponent=self.exponents[0],
            alpha=None if damping is None else speed * jnp.asarray(damping),
        )


class AbstractYielding(AbstractPlastic):
    """Spheres that yield: F = K δ^(3/2) up to δ_y, then its tangent; unloading is Hertz's again."""

    yield_speed: eqx.AbstractVar[Float[Array, "..."]]
    exponents: ClassVar[tuple[float, ...] | None] = (1.5,)

    def _damping(self, contact: Contact) -> Float[Array, "..."] | None:
        """Return the damping of F (1 + a δ') in s/m; None without."""
        return None

    def _over_stiffness(self, contact: Contact) -> YieldingForm:
        # The work up to the indentation at yield is the energy of an impact at v_y.
        length = scale_of(contact, self.yield_speed).length
        return YieldingForm(root=1.25**0.2 * jnp.sqrt(length), alpha=self._damping(contact))

    def _root(self, speed: Float[Array, "..."]) -> Float[Array, "..."]:
        """Return √y, y = (5r²/4)^(2/5) with r = v_y/v0."""
        return (1.25 * jnp.square(self.yield_speed / speed)) ** 0.2


@register_law(
    "thornton_plastic",
    formula="K δ^(3/2) up to δ_y, then its tangent; back K_u (δ - δ_p)^(3/2)",
    source="Thornton 1997, doi 10.1115/1.2787319",
    valid="n = 3/2; elastic below v_y and perfectly plastic beyond; then e ~ v0^(-1/4)",
)
class ThorntonPlastic(AbstractYielding):
    """Elastic-plastic spheres of Thornton: e = 1 up to the yield speed v_y, decreasing above.

    `yield_speed` v_y > 0 in m/s is the largest speed of an elastic impact. It determines the
    indentation at yield, (2/5) K δ_y^(5/2) = m v_y²/2. Up to there F = K δ^(3/2); beyond, the
    pressure stays and F = K δ_y^(3/2) + (3/2) K √δ_y (δ - δ_y). The way back from the largest
    indentation δ_m is that of a sphere of larger radius with the same contact area:
    F = K_u (δ - δ_p)^(3/2), (K_u/K)² = K δ_m^(3/2)/F_m, and it ends at δ_p = δ_m - F_m/(K √δ_m).

    Hence `e = √(6√3/5) √(1-r²/6) [r/(r + 2√(6/5-r²/5))]^(1/4)` with `r = v_y/v0`, which approaches
    1.18499 r^(1/4). Spheres of effective radius R, modulus E and mass m whose contact yields at the
    pressure p have `v_y = 3.194 √(p⁵ R³/(E⁴ m))`. The exponent is 3/2. e is a formula, and the
    times are quadratures.

    Raises ValueError for a Python scalar out of range, for `tension=True`, and, where it is used,
    for another exponent. Source: Thornton (1997), J. Appl. Mech. 64:383, doi 10.1115/1.2787319;
    Johnson (1985), Contact Mechanics, doi 10.1017/CBO9781139171731.
    """

    yield_speed: Float[Array, "..."] = parameter("yield_speed", POSITIVE, "m/s")

    @property
    def damped(self) -> bool:
        return False

    def restitution_at(self, velocity: ArrayLike) -> Float[Array, "..."]:
        """Return e at closing speeds in m/s; ValueError for anything that is not a number."""
        return plastic_restitution(self.yield_speed, as_parameter(velocity, "velocity"))

    def form(self, contact: Contact | None, scale: Scale | None) -> YieldingForm:
        return YieldingForm(root=self._root(needed(scale, "velocity", self).speed))


@register_law(
    "viscoplastic",
    formula="F (1 + (c/K) δ') with the F of thornton_plastic",
    source="Thornton 1997, doi 10.1115/1.2787319; Hunt & Crossley 1975, doi 10.1115/1.3423596",
    valid="n = 3/2; c ≥ 0; damped below v_y, damped and plastic beyond",
)
class Viscoplastic(AbstractYielding):
    """Thornton's elastic-plastic spheres with the damping of Hunt and Crossley.

    The force of `ThorntonPlastic` times 1 + (c/K) δ', in compression and on the way back.
    `yield_speed` v_y > 0 in m/s states the indentation at yield, as there; damped spheres need a
    little more than v_y to reach it. `c` ≥ 0 in N s/m^(n+1) is that of `ConstantDamping`, whose
    contact this is below yield. The exponent is 3/2. e is a formula of α = c v0/K and v_y/v0, and
    the times are quadratures.

    Raises ValueError for a Python scalar out of range, for `tension=True`, and, where it is used,
    for another exponent. Source: Thornton (1997), J. Appl. Mech. 64:383, doi 10.1115/1.2787319;
    Hunt & Crossley (1975), J. Appl. Mech. 42:440, doi 10.1115/1.3423596.
    """

    yield_speed: Float[Array, "..."] = parameter("yield_speed", POSITIVE, "m/s")
    c: Float[Array, "..."] = parameter("c", NOT_NEGATIVE, "N s/m^(n+1)")

    def _damping(self, contact: Contact) -> Float[Array, "..."]:
        return self.c / contact.stiffness

    def form(self, contact: Contact | None, scale: Scale | None) -> YieldingForm:
        speed = needed(scale, "velocity", self).speed
        alpha = speed * self._damping(contact_for(contact, self))
        return YieldingForm(root=self._root(speed), alpha=alpha)


def plastic_restitution(
    yield_speed: Float[Array, "..."], velocity: Float[Array, "..."]
) -> Float[Array, "..."]:
    """Return e of Thornton's spheres; NaN for a yield speed that is not positive."""
    # The slope in r is zero at r = 1, so the two parts join smoothly.
    plastic = velocity > yield_speed
    r = jnp.where(plastic, yield_speed / jnp.where(plastic, velocity, 1), 1)
    r = jnp.where(yield_speed > 0, r, jnp.nan)
    root = jnp.sqrt((6 - jnp.square(r)) / 5)
    e = math.sqrt(1.2 * math.sqrt(3)) * jnp.sqrt(1 - jnp.square(r) / 6)
    e *= jnp.sqrt(jnp.sqrt(r / (r + 2 * root)))
    # Clip a rounding error above 1.
    return jnp.where(r == 1, 1, jnp.minimum(e, 1))
