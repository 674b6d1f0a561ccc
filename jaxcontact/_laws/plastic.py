"""Plastic contacts: a force of loading, and an elastic way back that ends before δ = 0.

The scaled force depends on x and on the largest indentation x_m of the contact so far. While
x = x_m it is that of loading, F. From there it follows κ (x - x_p)ⁿ, which is F at x_m and ends at
x_p. Damping multiplies both by 1 + αv, as in the Hunt-Crossley family.
"""

from __future__ import annotations

import abc
import dataclasses
import math
from typing import TYPE_CHECKING, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._entry import NOT_NEGATIVE, Range, as_parameter, parameter, rendered
from .._forms import AbstractForm, Exponent, Flag, Lane, Scale, ScaledImpact, signed_power
from .._functions import power
from .base import AbstractLaw, Instant, contact_for, force_arguments, needed, require_exponent
from .registry import register_law

if TYPE_CHECKING:
    from .._contact import Contact

STIFFER = Range(low=1.0, inside=1.0)


class AbstractPlasticForm(AbstractForm):
    """A contact whose force remembers its largest indentation x_m, `deepest`.

    `alpha` is None without damping. A subclass states its exponent, and the forces of loading and
    unloading. `deepest` is 0 or None while the contact is loading. `way_back` is the κ and x_p of
    unloading from it, computed once for all steps.
    """

    deepest: Lane | None = eqx.field(default=None, kw_only=True)
    way_back: tuple[Lane, Lane] | None = eqx.field(default=None, kw_only=True)
    alpha: Lane | None = eqx.field(default=None, kw_only=True)
    tension: bool = eqx.field(static=True, default=False, kw_only=True)
    own_exponent: eqx.AbstractVar[float]
    remembers: ClassVar[bool] = True
    never_pulls: ClassVar[bool] = True

    @property
    def follows_phase_angle(self) -> bool:
        """False: the contact ends at x_p."""
        return False

    @abc.abstractmethod
    def loading(self, x: Lane) -> Lane:
        """Return the force F of loading, without damping, for x ≥ 0."""

    @abc.abstractmethod
    def work(self, x: Lane) -> Lane:
        """Return W, the integral of the force of loading from 0 to x."""

    @abc.abstractmethod
    def unloading(self, deepest: Lane) -> tuple[Lane, Lane]:
        """Return the κ of unloading from x_m, and the x_p at which it ends."""

    def remembering(self, deepest: Lane) -> AbstractPlasticForm:
        # A contact that loads has no way back yet.
        way_back = self.unloading(jnp.where(deepest > 0, deepest, 1))
        return dataclasses.replace(self, deepest=deepest, way_back=way_back)

    def damped(self, v: Lane) -> Lane | float:
        """Return the factor 1 + αv of the force."""
        return 1.0 if self.alpha is None else 1 + self.alpha * v

    def _back(self, x: Lane) -> tuple[Lane, Lane]:
        """Return the κ of unloading and the distance of x to its end, if the contact unloads."""
        factor, end = self.unloading(jnp.ones_like(x)) if self.way_back is None else self.way_back
        return factor, x - end

    def force(self, x: Lane, v: Lane, n: Exponent, compressing: Flag) -> Lane:
        factor, left = self._back(x)
        back = factor * signed_power(left, self.own_exponent)
        return jnp.where(compressing, self.loading(x), back) * self.damped(v)

    def pulling(
        self, w: Lane, v: Lane, n: Exponent, compressing: Flag, order: int | None = None
    ) -> Lane:
        x = w ** (order or self.order(n))
        gap = self.gap(self.left(x), v, True)
        return jnp.where(compressing, self.force(x, v, n, compressing), gap)

    def pressing(self, x: Lane, v: Lane, n: Exponent, compressing: Flag) -> Lane:
        # A contact that loads keeps its force.
        left = jnp.where(compressing, 1, self.left(x))
        return left if self.alpha is None else jnp.minimum(left, self.damped(v) / (1 + self.alpha))

    def left(self, x: Lane) -> Lane:
        """Return the distance of x to the end of the way back."""
        return self._back(x)[1]

    def gap(self, left: Lane, v: Lane, pulled: Flag | bool) -> Lane:
        """Return what falls through zero at the end of a contact, `left` before x_p.

        Only a pull ends it before x_p, where damping exceeds the elastic force: 1 + αv = 0. While a
        contact creeps apart at the speed 1/α, that number is smaller than the error of a solve.
        """
        if self.alpha is None:
            return left
        return jnp.where((left < 0) | jnp.logical_not(pulled), left, left * self.damped(v))

    def loading_at(self, w: Lane, order: int) -> Lane:
        """Return the force of loading at x = w^k."""
        return self.loading(w**order)

    def force_at(self, w: Lane, order: int, compressing: Flag) -> Lane:
        """Return the force without damping at x = x_p + w^k, with x_p = 0 before the turn."""
        load = self.loading_at(w, order)
        if self.way_back is None:
            return load
        back = self.way_back[0] * signed_power(w, order * self.own_exponent)
        return jnp.where(compressing, load, back)

    def plastic(self, like: Lane) -> Lane:
        """Return the x_p of a contact that unloads; 0 for one that loads."""
        if self.deepest is None or self.way_back is None:
            return jnp.zeros_like(like)
        return jnp.where(self.deepest > 0, self.way_back[1], 0)

    def stored(self, w: Lane, n: Exponent, order: int | None = None) -> Lane:
        """Return the energy that unloading from w returns."""
        x = w ** (order or self.order(n))
        # A contact that loads would unload from here.
        deepest = x if self.deepest is None else jnp.where(self.deepest > 0, self.deepest, x)
        return self.returned(x, deepest)

    def kept(self, deepest: Lane) -> Lane:
        return self.work(deepest) - self.returned(deepest, deepest)

    def returned(self, x: Lane, deepest: Lane) -> Lane:
        """Return ∫ f dx from the end to x on the way back from x_m."""
        (factor, end), more = self.unloading(deepest), self.own_exponent + 1
        return factor * power(x - end, more) / more


class AbstractPlastic(AbstractLaw):
    """A law whose force depends on the largest indentation of the contact so far.

    The contact is loading while δ is the largest indentation. From there it unloads and reloads
    elastically. Unless it adheres, its force vanishes at a plastic indentation δ_p > 0. It starts
    afresh at the next touch.
    """

    tension = False
    remembers: ClassVar[bool] = True
    _only_tension: ClassVar[tuple[bool, str] | None] = False, "unloads to zero force"

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
        force = self._of_form(Instant(depth, velocity, contact, impact_velocity), deepest)
        return force if self.tension else jnp.maximum(force, 0)

    def _force_after(self, at: Instant, deepest: ArrayLike) -> Float[Array, "..."]:
        return self._of_form(at, deepest)

    def _of_form(self, at: Instant, deepest: ArrayLike) -> Float[Array, "..."]:
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


class BilinearForm(AbstractPlasticForm):
    """f = x while loading and κ (x - x_p) on the way back, κ = `factor` + `slope` x_m."""

    factor: Lane
    slope: Lane
    own_exponent: ClassVar[float] = 1.0

    def loading(self, x: Lane) -> Lane:
        return x

    def work(self, x: Lane) -> Lane:
        return jnp.square(x) / 2

    def unloading(self, deepest: Lane) -> tuple[Lane, Lane]:
        factor = self.factor + self.slope * deepest
        return factor, deepest * (1 - 1 / factor)

    def restitution(self) -> Lane:
        return jax.lax.rsqrt(self.factor + self.slope)

    def solve(self, n: Exponent) -> ScaledImpact:
        """Return a quarter of each of two oscillations."""
        factor, e = self.factor + self.slope, self.restitution()
        one, lost = jnp.ones_like(factor), (self.factor - 1 + self.slope) / factor
        quarter = math.pi / 2 * one
        return ScaledImpact(
            restitution=e,
            duration=quarter * (1 + e),
            compression_time=quarter,
            max_indentation=one,
            max_force=one,
            energy_loss=lost,
            end_indentation=lost,
        )


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
    damped: ClassVar[bool] = False

    def _over_stiffness(self, contact: Contact) -> BilinearForm:
        return BilinearForm(factor=self.ratio, slope=self.slope)

    def form(self, contact: Contact | None, scale: Scale | None) -> BilinearForm:
        contact_for(contact, self)
        length = needed(scale, "velocity", self).length
        return BilinearForm(factor=self.ratio, slope=self.slope * length)


class TwoCurvesForm(AbstractPlasticForm):
    """f from the curves of a law, in units of `length` X and of the `unit` of force."""

    law: AbstractElasticPlastic
    contact: Contact
    length: Lane
    unit: Lane
    own_exponent: float = eqx.field(static=True)

    def loading(self, x: Lane) -> Lane:
        force = self.law.loading(self.length * x, self.contact)
        return as_parameter(force, "force") / self.unit

    def unloading(self, deepest: Lane) -> tuple[Lane, Lane]:
        # A contact that has not been loaded is never asked, but its derivative is.
        loaded = deepest > 0
        most = self.length * jnp.where(loaded, deepest, 1)
        found = self.law.unloading(most, self.contact)
        if not (isinstance(found, tuple) and len(found) == 2):
            raise TypeError(
                f"`{type(self.law).__name__}.unloading` must return the stiffness of unloading and "
                f"the indentation at its end, but returns {rendered(found)}."
            )
        stiffness, end = map(jnp.asarray, found)
        scaled = stiffness * self.length**self.own_exponent / self.unit
        # Curves that do not meet have no impact.
        force = self.law.loading(most, self.contact)
        gap = stiffness * power(most - end, self.own_exponent) - force
        meet = jnp.abs(gap) <= jnp.sqrt(jnp.finfo(scaled.dtype).eps) * jnp.abs(force)
        return jnp.where(meet, scaled, jnp.nan), jnp.where(loaded, end / self.length, 0)

    def work(self, x: Lane) -> Lane:
        """Return the work of loading by Gauss rules between the corners. In √x, any sum of powers
        of √x up to that of degree 30 is exact.
        """
        nodes, weights = np.polynomial.legendre.leggauss(16)
        rule = list(zip(nodes.tolist(), weights.tolist(), strict=True))
        corners = self.law.corners(self.contact)
        if not isinstance(corners, tuple):
            raise TypeError(
                f"`{type(self.law).__name__}.corners` must return a tuple of indentations, but "
                f"returns {rendered(corners)}."
            )
        corners = [jnp.asarray(corner) / self.length for corner in corners]
        begins = [jnp.zeros_like(x), *(jnp.clip(corner, 0, x) for corner in corners)]
        total = jnp.zeros_like(x)
        for begin, end in zip(begins, [*begins[1:], x], strict=True):
            low, high = power(begin, 0.5), power(end, 0.5)
            half = (high - low) / 2
            for node, weight in rule:
                root = low + half * (1 + node)
                total = total + 2 * weight * half * root * self.loading(jnp.square(root))
        return total


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
