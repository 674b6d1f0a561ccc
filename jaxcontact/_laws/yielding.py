"""Spheres that yield: Hertz's force up to yield, then its tangent; unloading is Hertz's again.

With damping, the energy integral of the Hunt-Crossley family `G(v) = ∫ v dv/(1+αv)` applies. With W
the work of loading and U the energy that unloading returns, `W(x_m) = G(1)` and `G(-e) = U(x_m)`.
Times are integrals of 1/F over y = ln(1+αv)/α.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from .._entry import NOT_NEGATIVE, POSITIVE, as_parameter, parameter
from .._forms import (
    AbstractForm,
    Exponent,
    Flag,
    Lane,
    Scale,
    ScaledImpact,
    integrate,
    lanewise,
    scale_of,
)
from .._forms.hunt_crossley import (
    half_time,
    peak_velocity,
    rebound_expansion,
    rebound_root,
    restitution_at,
    slowness,
    stored_at,
)
from .._functions import (
    expanded_root,
    implicit_root,
    log1p_over,
    log_remainder,
    power,
    psi,
    speed_of,
)
from .base import contact_for, needed
from .plastic import AbstractPlastic, AbstractPlasticForm
from .registry import register_law

if TYPE_CHECKING:
    from .._contact import Contact


class YieldingForm(AbstractPlasticForm):
    """f = x^(3/2) up to y, then its tangent; unloading is that of a flatter sphere.

    `root` √y > 0, with y = (5r²/4)^(2/5) for r = v_y/v0. The flatter sphere has the radius of the
    contact at x_m: κ = √(x_m^(3/2)/F(x_m)).
    """

    root: Lane
    own_exponent: ClassVar[float] = 1.5
    damping_number: ClassVar[str | None] = "alpha"

    def sound(self) -> tuple[AbstractForm, Flag]:
        good, (form, damps) = (self.root > 0) & jnp.isfinite(self.root), super().sound()
        root = jnp.where(good, self.root, 1)
        return eqx.tree_at(lambda form: form.root, form, root), good & damps

    def loading(self, x: Lane) -> Lane:
        root = self.root
        beyond = jnp.maximum(x - root**2, 0)
        return power(jnp.minimum(x, root**2), 1.5) + 1.5 * root * beyond

    def work(self, x: Lane) -> Lane:
        root = self.root
        beyond = jnp.maximum(x - root**2, 0)
        elastic = power(jnp.minimum(x, root**2), 2.5) * 0.4
        return elastic + root * beyond * (root**2 + 0.75 * beyond)

    def unloading(self, deepest: Lane) -> tuple[Lane, Lane]:
        yielded = deepest > self.root**2
        inside = jnp.where(yielded, deepest, self.root**2)
        force = self.loading(inside)
        factor = jnp.sqrt(power(inside, 1.5) / force)
        return factor, jnp.where(yielded, inside - force / jnp.sqrt(inside), 0)

    def loading_at(self, w: Lane, order: int) -> Lane:
        # A polynomial in w = √x.
        root = self.root
        beyond = jnp.maximum(jnp.square(w) - root**2, 0)
        return jnp.where(w < root, w**3, root**3 + 1.5 * root * beyond)

    def _loaded(self, energy: Lane) -> tuple[Lane, Lane]:
        """Return x and F at which the work of loading is `energy` > 0."""
        root, most = self.root, 0.4 * self.root**5
        elastic = (2.5 * jnp.minimum(energy, most)) ** 0.2
        force = _linear(root, jnp.maximum(energy - most, 0))
        beyond = 2 * jnp.maximum(energy - most, 0) / (force + root**3)
        yielded = energy > most
        return jnp.where(yielded, root**2 + beyond, elastic**2), jnp.where(
            yielded, force, elastic**3
        )

    def _turn(self) -> tuple[Lane, Lane, Lane, Lane]:
        """Return α, the x_m and F of the turn, and ρ = -ln(1-αe)/α."""
        alpha = jnp.zeros_like(self.root) if self.alpha is None else self.alpha
        deepest, force = self._loaded(log_remainder(alpha))
        returned = 0.4 * jnp.square(force) / jnp.sqrt(deepest)
        alpha, deepest, force, returned = jnp.broadcast_arrays(alpha, deepest, force, returned)
        return alpha, deepest, force, rebound_root(alpha, returned)

    def restitution(self) -> Lane:
        alpha, *_, rho = self._turn()
        return restitution_at(rho, alpha)

    def solve(self, n: Exponent) -> ScaledImpact:
        """Return restitution and extrema by formula, the two times by quadrature."""
        alpha, deepest, force, rho = self._turn()
        root = jnp.broadcast_to(self.root, alpha.shape)
        way_in, way_out = lanewise(_times, root, 0.0 if self.alpha is None else alpha)
        return ScaledImpact(
            restitution=restitution_at(rho, alpha),
            duration=way_in + way_out,
            compression_time=way_in,
            max_indentation=deepest,
            max_force=force if self.alpha is None else self._strongest(alpha),
            end_indentation=deepest - force / jnp.sqrt(deepest),
        )

    def _strongest(self, alpha: Lane) -> Lane:
        """Return the largest F (1 + αv): at (n+1) α H = n v, or at α F² = 3/2 √y v beyond yield."""
        root, most = self.root, 0.4 * self.root**5
        elastic = peak_velocity(alpha, jnp.full_like(alpha, 1.5))
        yielded = stored_at(elastic, alpha) > most
        v = jnp.where(yielded, _yielded_peak(alpha, jnp.where(yielded, root, 1)), elastic)
        return self._loaded(stored_at(v, alpha))[1] * (1 + alpha * v)


def _linear(root: Lane, energy: Lane) -> Lane:
    """Return the force after the work `energy` ≥ 0 beyond yield at y = root²."""
    return jnp.sqrt(root**6 + 3 * root * energy)


def _yielded_expansion(v: Lane, alpha: Lane, root: Lane) -> tuple[Lane, Lane, Lane, Lane]:
    # Expansion of α F² - 3/2 √y v over 3/2 √y, F² = y³ + 3 √y (H - W(y)), dH/dv = -v/(1+αv).
    softness = 1 / (1 + alpha * v)
    value = alpha * (2 * stored_at(v, alpha) - root**5 * (2 / 15)) - v
    second = -2 * alpha * jnp.square(softness)
    return value, -2 * alpha * v * softness - 1, second, -2 * alpha * softness * second


# Without yield at all it is the peak for n = 1.
_yielded_peak = expanded_root(
    _yielded_expansion, lambda alpha, root: 2 * alpha / (2 + 3 * alpha), iterations=3
)

# The y > 0 with G = `energy`. From a guess within 4 % two steps leave rounding.
_way_root = expanded_root(
    lambda y, alpha, energy: rebound_expansion(y, -alpha, energy),
    lambda alpha, energy: _way_guess(alpha, jnp.sqrt(2 * energy)),
    iterations=2,
)


def _way_guess(alpha: Lane, p: Lane) -> Lane:
    # αy = ln(1 + αp + (αp)²/2), p = √(2G): right at both ends.
    half = 1 + alpha * p / 2
    return p * half * log1p_over(alpha * p * half)


# The d = (1 - v)/(1 + αv) of an early yield, where the work is W(y); concave, from below.
_early_root = implicit_root(
    lambda d, root, alpha: (
        d * ((1 - d) / (1 + alpha * d) + d * log_remainder(alpha * d)) - 0.4 * root**5
    ),
    lambda root, alpha: 0.4 * root**5 + 0 * alpha,
    iterations=8,
)


def _times(root: Lane, alpha: Lane | float, unroll: int) -> tuple[Lane, Lane]:
    """Return the times from touch to turn, and from turn to separation."""
    alpha = jnp.broadcast_to(jnp.asarray(alpha, root.dtype), root.shape)
    _, deepest, force, rho = YieldingForm(root=root, alpha=alpha)._turn()
    length, left = log1p_over(alpha), log_remainder(alpha) - 0.4 * root**5
    # The force is smooth at yield, so that it does not matter where the integral is split.
    yielded = left > 0
    rest = jnp.where(yielded, _way_root(alpha, jnp.where(yielded, left, 1)), 0)
    # Early yield is a small part of the way, with digits of its own.
    early = 0.4 * root**5 < left
    lost = _early_root(jnp.where(early, root, 0.5), jnp.where(early, alpha, 0))
    soon = lost * log1p_over(alpha * lost)
    rest, soon, whole = jax.lax.stop_gradient((rest, soon, length))
    first = jnp.where(early, soon + (length - whole), length - rest)
    inside = jnp.where(first > 0, first, 1)
    until_yield = integrate(
        lambda node: slowness(inside * node, alpha, length, 0.6), 0.6, alpha, unroll
    )
    until_yield = jnp.where(first > 0, until_yield * inside**0.4, 0) * 2.5**-0.6
    # Beyond yield F = F_m sin φ, since F² grows with the work. Without damping φ is the phase of an
    # oscillation.
    at_rest = jnp.square(rest) * psi(alpha * rest)
    # The work beyond yield is 0 there, but for its derivative.
    work = jnp.where(yielded, left - at_rest, 0)
    begun = _linear(root, work - jax.lax.stop_gradient(work))
    begin = jnp.arctan2(begun, jnp.sqrt(3 * root * jnp.where(yielded, at_rest, 1)))
    # Near the turn strong damping has a layer of 1/α, which y resolves and φ does not.
    split = jnp.maximum(begin, math.pi / 4)
    span = split - begin

    def left_at(phase: Lane) -> Lane:
        """Return the y at a φ."""
        return _way_root(alpha, jnp.square(force * jnp.cos(phase)) / (3 * root))

    def in_phase(node: Lane) -> Lane:
        phase = begin + span * node
        return jnp.cos(phase) / speed_of(left_at(phase), alpha)

    near = left_at(split)

    def near_turn(node: Lane) -> Lane:
        y = near * node
        return jax.lax.rsqrt(jnp.square(force) - 3 * root * jnp.square(y) * psi(alpha * y))

    nodes = 40 if root.dtype == jnp.float64 else 20
    later = span * force / (1.5 * root) * integrate(in_phase, 0.0, alpha, unroll)
    later = later + near * integrate(near_turn, 0.0, alpha, unroll, nodes)
    later = jnp.where(yielded, later, 0)
    factor = jnp.sqrt(power(deepest, 1.5) / force)
    return until_yield + later, half_time(-alpha, rho, 1.5, unroll) * factor**-0.4


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
    damped: ClassVar[bool] = False

    def restitution_at(self, velocity: ArrayLike) -> Float[Array, "..."]:
        """Return e at closing speeds in m/s, NaN for a yield speed that is not positive; ValueError
        for anything that is not a number.
        """
        velocity = as_parameter(velocity, "velocity")
        # The slope in r is zero at r = 1, so the two parts join smoothly.
        plastic = velocity > self.yield_speed
        r = jnp.where(plastic, self.yield_speed / jnp.where(plastic, velocity, 1), 1)
        r = jnp.where(self.yield_speed > 0, r, jnp.nan)
        root = jnp.sqrt((6 - jnp.square(r)) / 5)
        e = math.sqrt(1.2 * math.sqrt(3)) * jnp.sqrt(1 - jnp.square(r) / 6)
        e *= jnp.sqrt(jnp.sqrt(r / (r + 2 * root)))
        # Clip a rounding error above 1.
        return jnp.where(r == 1, 1, jnp.minimum(e, 1))

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
