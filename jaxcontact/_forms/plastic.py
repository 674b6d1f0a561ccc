"""The forms of plastic contacts: xⁿ up to yield, then its tangent; unloading is elastic.

The force depends on x and on the largest indentation x_m of the contact so far. While x = x_m it is
that of loading, F. From there it follows κ (x - x_p)ⁿ, which is F at x_m and ends at x_p.

Damping multiplies both by 1 + αv, as in the Hunt-Crossley family. Its energy integral `G(v) = ∫ v
dv/(1+αv)` applies. With W the work of loading and U the energy that unloading returns, `W(x_m) =
G(1)` and `G(-e) = U(x_m)`. Times are integrals of 1/F over y = ln(1+αv)/α.
"""

from __future__ import annotations

import abc
import dataclasses
import math
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp

from .._functions import (
    expanded_root,
    implicit_root,
    log1p_over,
    log_remainder,
    power,
    psi,
    speed_of,
)
from .base import AbstractForm, Exponent, Flag, Lane, signed_power, sound_damping
from .hunt_crossley import (
    half_time,
    peak_velocity,
    rebound_expansion,
    rebound_root,
    restitution_at,
    slowness,
    stored_at,
)
from .quadrature import integrate, lanewise
from .scale import ScaledImpact


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
        factor, end = self.unloading(deepest)
        more = self.own_exponent + 1
        return factor * power(x - end, more) / more

    def kept(self, deepest: Lane) -> Lane:
        factor, end = self.unloading(deepest)
        more = self.own_exponent + 1
        return self.work(deepest) - factor * power(deepest - end, more) / more


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


class YieldingForm(AbstractPlasticForm):
    """f = x^(3/2) up to y, then its tangent; unloading is that of a flatter sphere.

    `root` √y > 0, with y = (5r²/4)^(2/5) for r = v_y/v0. The flatter sphere has the radius of the
    contact at x_m: κ = √(x_m^(3/2)/F(x_m)).
    """

    root: Lane
    own_exponent: ClassVar[float] = 1.5

    def sound(self) -> tuple[YieldingForm, Flag]:
        good = (self.root > 0) & jnp.isfinite(self.root)
        form = eqx.tree_at(lambda form: form.root, self, jnp.where(good, self.root, 1))
        if self.alpha is None:
            return form, good
        alpha, sound = sound_damping(self.alpha)
        return eqx.tree_at(lambda form: form.alpha, form, alpha), good & sound

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
