"""The solved Hunt-Crossley family in scaled units, x'' = -xⁿ (1 + α x'), x(0) = 0, x'(0) = 1.

The energy balance of a free impact reads `G(1) = G(-e)` with `G(v) = ∫ v dv/(1+αv) = v/α -
ln(1+αv)/α²`, for every exponent n. With `z = ln(1-αe) < 0`, `ψ(z) = (e^z-1-z)/z²` and `L(α) =
(α-ln(1+α))/α²` it becomes `(z/α)² ψ(z) = L(α)`. This equation is smooth through α = 0 and keeps all
digits up to the largest α.

With `y = ln(1+αv)/α` the energy integral reads `x^(n+1)/(n+1) = H(y)` and the time is `t = ∫ ((n+1)
H)^(-n/(n+1)) dy`. Each half is measured from its outer end (touch or separation): `H = D (|v| κ(aD)
+ D ψ(aD))`. D is the distance in y, with a = α in compression and a = -α in restitution. Every term
is positive, so nothing cancels at any α.
"""

from __future__ import annotations

import functools
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import ArrayLike

from .._entry import RESTITUTION, as_parameter, static_value
from .._functions import (
    expanded_root,
    implicit_root,
    kappa,
    kappa_and_psi,
    log1p_over,
    log_remainder,
    log_remainder_over,
    power,
    psi,
    speed_of,
)
from .base import AbstractForm, Exponent, Flag, Lane, Momentum, signed_power
from .quadrature import integrate, lanewise, to_power
from .scale import ScaledImpact


class HuntCrossleyForm(AbstractForm):
    """f = xⁿ (1 + α v), α ≥ 0."""

    alpha: Lane
    tension: bool = eqx.field(static=True)
    never_pulls: ClassVar[bool] = True
    damping_number: ClassVar[str | None] = "alpha"

    def damping(self, n: Exponent, compressing: Flag) -> tuple[Lane, Exponent]:
        return self.alpha, 0.0

    def alpha_at(self, speed: Lane) -> Lane:
        """Return the α of an impact at another speed, in units of v0; here a constant."""
        return self.alpha

    def force(self, x: Lane, v: Lane, n: Exponent, compressing: Flag) -> Lane:
        return power(x, n) * (1 + self.alpha * v)

    @property
    def hysteresis_factor(self) -> Lane:
        return self.alpha

    def time_at(self, v: Lane, n: Exponent, duration: Lane) -> Lane:
        """Return the time from touch to the velocity v in [-e, 1], by quadrature."""
        alpha, v, duration = jnp.broadcast_arrays(self.alpha, v, duration)
        return _time_at(alpha, v, duration, n)

    def restitution(self) -> Lane:
        return restitution_of(self.alpha)

    def momentum(self, n: Exponent) -> Momentum:
        """Return y = ln(1+αv)/α, with y' = -xⁿ: not stiff at any α."""
        exponent = self.order(n) * (n + 1) - 1
        return Momentum(
            at_touch=lambda: log1p_over(self.alpha),
            velocity=lambda y: speed_of(y, self.alpha),
            pull=lambda w: signed_power(w, exponent),
            lost=lambda touch, y: self._loss_at(touch) - self._loss_at(y),
        )

    def _loss_at(self, y: Lane) -> Lane:
        """Return ∫ αs²/(1+αs) ds from 0 to v(y): the part of ½v² lost, as xⁿ dx = -v dv/(1+αv)."""
        v = speed_of(y, self.alpha)
        u = self.alpha * v
        weak = jnp.abs(u) < 0.5
        series = self.alpha * v**3 * log_remainder_over(jnp.where(weak, u, 0))
        closed = jnp.square(v) / 2 - (v - y) / jnp.where(weak, 1, self.alpha)
        return jnp.where(weak, series, closed)

    def phase_unit(self) -> Lane:
        """Return (1+α)^0.15, which evens out the rate of change of the solution with the angle.

        With strong damping, restitution takes most of the time. The exponent was chosen among a few
        by the error of the duration up to α = 20.
        """
        return (1 + self.alpha) ** 0.15

    def solve(self, n: Exponent) -> ScaledImpact:
        """Return restitution and extrema by formula, the two times by quadrature."""
        alpha = self.alpha
        if static_value(n) is None:
            alpha, n = jnp.broadcast_arrays(alpha, n)
        compression, rebound, e = lanewise(_course, alpha, n)
        return ScaledImpact(
            restitution=e,
            duration=compression + rebound,
            compression_time=compression,
            max_indentation=((n + 1) * log_remainder(alpha)) ** (1 / (n + 1)),
            max_force=_max_force(alpha, n),
            energy_loss=_energy_lost(alpha, e),
        )


def rebound_expansion(rho: Lane, alpha: Lane, lost: Lane) -> tuple[Lane, Lane, Lane, Lane]:
    # Expansion of ρ² ψ(z) - L with z = -αρ. By the definition of ψ the derivatives are ρ κ(z), e^z
    # and -α e^z. Writing κ by ψ, or e^z by κ, would lose all digits at strong damping.
    z = -alpha * rho
    second = jnp.exp(z)
    kappa_z, psi_z = kappa_and_psi(z)
    value = jnp.square(rho) * psi_z - lost
    return value, rho * kappa_z, second, -alpha * second


def _rebound_guess(alpha: Lane, lost: Lane) -> Lane:
    # With p²/2 = α - ln(1+α): z = -p - p²/6 - p³/36 + ... for weak damping, and z = -(1 + p²/2) up
    # to e^z for strong damping. Both are within 3 % at the switch, p = 2.
    p_over_alpha = jnp.sqrt(2 * lost)
    p = alpha * p_over_alpha
    strong = p > 2
    p_weak = jnp.where(strong, 0, p)
    weak_rho = p_over_alpha * (1 + p_weak / 6 + jnp.square(p_weak) / 36)
    strong_rho = (1 + jnp.square(p) / 2) / jnp.where(strong, alpha, 1)
    return jnp.where(strong, strong_rho, weak_rho)


# From a guess within 3 % one step leaves 1.2e-8, and the second reduces it to its fourth power.
rebound_root = expanded_root(rebound_expansion, _rebound_guess, iterations=2)


def rebound_exponent(alpha: Lane) -> Lane:
    """Return ρ(α) = -ln(1-αe)/α, the regularised rebound speed; ρ(0) = 1."""
    return rebound_root(alpha, log_remainder(alpha))


def restitution_of(alpha: Lane) -> Lane:
    """Return the e that the damping factor α ≥ 0 delivers in a free impact, for every n."""
    return restitution_at(rebound_exponent(alpha), alpha)


def restitution_at(rho: Lane, alpha: Lane) -> Lane:
    return rho * kappa(-alpha * rho)


def _energy_lost(alpha: Lane, e: Lane) -> Lane:
    """Return 1 - e², without cancellation at weak damping.

    With `v²/2 - G(v) = α v³ M(αv)` the balance G(1) = G(-e) reads `1 - e² = 2α (M(α) + e³ M(-αe))`.
    """
    weak = alpha < 0.5
    a, speed = jnp.where(weak, alpha, 0), jnp.where(weak, e, 1)
    little = 2 * a * (log_remainder_over(a) + speed**3 * log_remainder_over(-a * speed))
    return jnp.where(weak, little, (1 - e) * (1 + e))


def _damping_residual(z: Lane, e: Lane) -> Lane:
    ratio = kappa(z) / e  # -α/z
    return psi(z) - jnp.square(ratio) * log_remainder(-z * ratio)


def _damping_guess(e: Lane) -> Lane:
    # Strong damping: α = 1/e up to e^z. Weak damping: the rational fit of Carvalho and Martins.
    strong = e < 0.4
    e_weak = jnp.where(strong, 0.5, e)
    weak_z = jnp.log1p(-1.5 * e_weak * (1 - e_weak) * (11 - e_weak) / (1 + 9 * e_weak))
    alpha = 1 / jnp.where(strong, e, 1)
    return jnp.where(strong, jnp.log1p(alpha) - alpha - 1, weak_z)


_damping_exponent = implicit_root(_damping_residual, _damping_guess, iterations=5)


def exact_damping_factor(e: ArrayLike) -> Lane:
    """Return the damping factor α that delivers the restitution e, for every exponent n.

    Solves `α(1+e) = ln[(1+α)/(1-αe)]`; α → 3(1-e)/2 as e → 1 and α → 1/e as e → 0.

    Arguments: `e` in (0, 1], any shape, dimensionless. Returns α, dimensionless, of the same shape;
    NaN in lanes out of range. Differentiable to any order, also at e = 1. Raises ValueError for a
    Python scalar out of range. Inverse of `restitution`; derived from the energy integral of the
    Hunt-Crossley force, doi 10.1115/1.3423596.
    """
    return _delivering(as_parameter(e, "e", RESTITUTION))


# From Python a loop is traced and compiled anew in each call; this is compiled once for a shape.
@functools.partial(jax.jit, inline=True)
def _delivering(e: Lane) -> Lane:
    valid = RESTITUTION.holds(e)
    safe = jnp.where(valid, e, RESTITUTION.inside)
    z = _damping_exponent(safe)
    return jnp.where(valid, -z * kappa(z) / safe, jnp.nan)


def _course(alpha: Lane, n: Exponent, unroll: int) -> tuple[Lane, Lane, Lane]:
    """Return the times from touch to turn and from turn to separation, and the restitution."""
    rho = rebound_exponent(alpha)
    # The same code runs for one half after the other. Both halves at once would shorten the vectors
    # over lanes.
    halves = jnp.stack([alpha, -alpha]), jnp.stack([log1p_over(alpha), rho])
    way_in, way_out = jax.lax.map(lambda half: half_time(half[0], half[1], n, unroll), halves)
    return way_in, way_out, restitution_at(rho, alpha)


def half_time(a: Lane, length: Lane, n: Exponent, unroll: int) -> Lane:
    """Return the time between touch and turn (a = α) or turn and separation (a = -α)."""
    p = n / (n + 1)
    # With strong damping, restitution is long and the integrand varies only within `layer` of the
    # turn. Farther out the bodies creep apart at the speed 1/α, up to a neglected e^-layer.
    layer = 36.0 if a.dtype == jnp.float64 else 17.0
    creeping = -a * length > layer
    rate = jnp.where(creeping, -a, 1)
    start = jnp.where(creeping, length - layer / rate, 0)
    creep = jnp.where(creeping, rate**p, 0)
    span = length - start

    def integrand(node: Lane) -> Lane:
        distance = start + span * node
        slower = slowness(distance, a, length, p) - creep
        # The rule expects the singularity at the start of its span; here it may lie farther out.
        return slower * to_power(span * node / distance, p)

    integral = integrate(integrand, p, a, unroll) * span ** (1 - p)
    creep_integral = creep * length ** (1 - p) * (n + 1)
    return (integral + creep_integral) * (n + 1) ** -p


def slowness(distance: Lane, a: Lane, length: Lane, p: Exponent) -> Lane:
    """Return (H/D)^-p at the distance D from the outer end of a half."""
    inner = length - distance
    speed = inner * kappa(a * inner)
    kappa_z, psi_z = kappa_and_psi(a * distance)
    return to_power(speed * kappa_z + distance * psi_z, -p)


def _time_at(alpha: Lane, v: Lane, duration: Lane, n: Exponent) -> Lane:
    rho, p = rebound_exponent(alpha), n / (n + 1)
    closing, touch = v >= 0, log1p_over(alpha)
    # The part of the half from its outer end to v: from touch, or to separation.
    y = v * log1p_over(alpha * jnp.where(closing, v, jnp.maximum(v, -restitution_at(rho, alpha))))
    a, length = jnp.where(closing, alpha, -alpha), jnp.where(closing, touch, rho)
    part = jnp.maximum(length - jnp.abs(y), 0)
    inside = jnp.where(part > 0, part, length)

    def integrand(node: Lane) -> Lane:
        return slowness(inside * node, a, length, p)

    outer = integrate(integrand, p, a, 1) * inside ** (1 - p) * (n + 1) ** -p
    outer = jnp.where(part > 0, outer, 0)
    return jnp.where(closing, outer, duration - outer)


def _peak_expansion(v: Lane, alpha: Lane, n: Lane) -> tuple[Lane, Lane, Lane, Lane]:
    # Expansion of (n+1) α H - n v, where dH/dv = -v/(1+αv).
    softness = 1 / (1 + alpha * v)
    value = (n + 1) * alpha * stored_at(v, alpha) - n * v
    slope = -(n + 1) * alpha * v * softness - n
    second = -(n + 1) * alpha * jnp.square(softness)
    return value, slope, second, -2 * alpha * softness * second


def stored_at(v: Lane, alpha: Lane, outer: Lane | float = 1.0) -> Lane:
    """Return H = G(outer) - G(v), the elastic energy stored at the velocity v. The `outer` end of
    the way is 1 in compression and may be -e in restitution, so that nothing cancels.
    """
    delta = (outer - v) / (1 + alpha * v)
    return delta * (v + delta * log_remainder(alpha * delta))


def _peak_guess(alpha: Lane, n: Lane) -> Lane:
    # Exact in the limits of weak and strong damping. One step leaves 1e-5, two leave rounding.
    return (n + 1) * alpha / (2 * n + (2 * n + 1) * alpha)


peak_velocity = expanded_root(_peak_expansion, _peak_guess, iterations=2)


def _max_force(alpha: Lane, n: Exponent) -> Lane:
    """Return the largest force, at (n+1) α H = n v, which lies in compression for any α > 0."""
    v = peak_velocity(alpha, jnp.broadcast_to(jnp.asarray(n, alpha.dtype), alpha.shape))
    return (1 + alpha * v) * ((n + 1) * stored_at(v, alpha)) ** (n / (n + 1))
