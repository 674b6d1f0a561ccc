"""The solved oscillator laws: x'' = -(xⁿ + 2ζ √((n+1)/2) x^((n-1)/2) x'), x(0) = 0, x'(0) = 1.

With `s²/2 = x^(n+1)/(n+1)` and `dτ = (xⁿ/s) dt` this is s'' + 2ζ s' + s = 0. Its solution is
elementary: s = e^(-ζτ) sin(ωτ)/ω, ω² = 1-ζ². The turn is at τ = C with `C(ζ) = arccos(ζ)/ω`, which
is analytic through critical damping. A contact without tension ends at τ = 2C, one with tension at
τ = π/ω. Time follows from `dt = ((n+1)/2)^(-n/(n+1)) s^(-(n-1)/(n+1)) dτ`.
"""

from __future__ import annotations

import functools
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jax.scipy.special import betaln

from .._entry import static_value
from .._functions import arc_over_sine, power, sinc_root
from .base import AbstractForm, Exponent, Flag, Lane
from .quadrature import integrate, lanewise, to_power
from .scale import ScaledImpact


class OscillatorForm(AbstractForm):
    """f = xⁿ + a x^((n-1)/2) v with a = 2ζ √((n+1)/2), ζ ≥ 0."""

    zeta: Lane
    tension: bool = eqx.field(static=True)
    approach_only: bool = eqx.field(static=True)
    damping_number: ClassVar[str | None] = "zeta"

    @property
    def ending(self) -> str:
        """The end of the contact: "tension", "clamped" or "approach".

        "tension": at x = 0, for ζ < 1. "clamped": where the force vanishes. "approach": elastic
        rebound, with damping on approach only.
        """
        if self.approach_only:
            return "approach"
        return "tension" if self.tension else "clamped"

    def may_pull(self, pushed: bool) -> bool:
        return self.tension and not self.approach_only

    def damping(self, n: Exponent, compressing: Flag) -> tuple[Lane, Exponent]:
        zeta = jnp.where(compressing, self.zeta, 0) if self.approach_only else self.zeta
        return zeta * jnp.sqrt(jnp.asarray(2 * (n + 1), self.zeta.dtype)), (n + 1) / 2

    def force(self, x: Lane, v: Lane, n: Exponent, compressing: Flag) -> Lane:
        return power(x, n) + self.damping(n, compressing)[0] * v * power(x, (n - 1) / 2)

    def restitution(self) -> Lane:
        return jnp.exp(-_decay(self.zeta, self.ending))

    def solve(self, n: Exponent) -> ScaledImpact:
        """Return restitution and extrema by formula, the times by quadrature (by formula for n =
        1).
        """
        zeta = self.zeta + jnp.zeros_like(jnp.asarray(n, self.zeta.dtype))
        settled = (zeta >= 1) & (self.ending == "tension")
        s_max = jnp.exp(-zeta * arc_over_sine(zeta))
        compression, duration = lanewise(functools.partial(_times, self.ending), zeta, n)
        decay = _decay(zeta, self.ending)
        return ScaledImpact(
            restitution=jnp.exp(-decay),
            duration=duration,
            compression_time=compression,
            max_indentation=((n + 1) / 2 * jnp.square(s_max)) ** (1 / (n + 1)),
            max_force=_extreme_force(zeta, n),
            min_force=self._min_force(zeta, settled, n),
            settled=settled,
            energy_loss=-jnp.expm1(-2 * decay),
        )

    def _min_force(self, zeta: Lane, settled: Flag, n: Exponent) -> Lane | None:
        """Return the least force; NaN (unknown) if the bodies stay together."""
        if self.ending != "tension":
            return None
        least = _extreme_force(jnp.where(settled, 0, zeta), n, least=True)
        return jnp.where(settled, jnp.nan, least)


def _times(ending: str, zeta: Lane, n: Exponent, unroll: int) -> tuple[Lane, Lane]:
    """Return the times from touch to the turn, and from touch to the end."""
    turn = arc_over_sine(zeta)
    compression = _compression_time(zeta, turn, n, unroll)
    if ending == "tension":
        # From critical damping on the contact has no end.
        return compression, _half_period_time(jnp.where(zeta < 1, zeta, 0), n, unroll)
    if ending == "clamped":
        return compression, compression + _clamped_rebound_time(zeta, turn, n, unroll)
    return compression, compression + _elastic_rebound_time(jnp.exp(-zeta * turn), n)


def _decay(zeta: Lane, ending: str) -> Lane:
    """Return -ln e for the damping ratio ζ: πζ/ω with tension, 2ζC clamped, ζC on approach."""
    if ending == "tension":
        bound = zeta >= 1
        return jnp.where(bound, jnp.inf, _decrement(jnp.where(bound, 0, zeta)))
    loss = zeta * arc_over_sine(zeta)
    return 2 * loss if ending == "clamped" else loss


def _decrement(zeta: Lane) -> Lane:
    return jnp.pi * zeta / jnp.sqrt((1 - zeta) * (1 + zeta))


def _weakness(n: Exponent) -> Exponent:
    """Return q of dt ~ s^(-q) dτ, the strength of the time singularity at touch and separation."""
    return (n - 1) / (n + 1)


def _time_unit(n: Exponent) -> Exponent:
    return ((n + 1) / 2) ** (-n / (n + 1))


def _compression_time(zeta: Lane, turn: Lane, n: Exponent, unroll: int) -> Lane:
    if static_value(n) == 1:
        return turn
    q = _weakness(n)

    def integrand(node: Lane) -> Lane:
        tau = turn * node
        s_over_tau = jnp.exp(-zeta * tau) * sinc_root((1 - zeta) * (1 + zeta) * jnp.square(tau))
        return to_power(s_over_tau, -q)

    return _time_unit(n) * turn ** (1 - q) * integrate(integrand, q, zeta, unroll)


def _half_period_time(zeta: Lane, n: Exponent, unroll: int) -> Lane:
    """Return the time from touch to x = 0 with tension, each half integrated from its own end."""
    omega = jnp.sqrt((1 - zeta) * (1 + zeta))
    if static_value(n) == 1:
        return jnp.pi / omega
    q = _weakness(n)
    decrement = _decrement(zeta)

    def integrand(node: Lane) -> Lane:
        u = node / 2
        shape = jnp.sin(jnp.pi * u) / u
        first = to_power(jnp.exp(-decrement * u) * shape, -q)
        return first + to_power(jnp.exp(-decrement * (1 - u)) * shape, -q)

    integral = integrate(integrand, q, zeta, unroll)
    return _time_unit(n) * jnp.pi * (2 * omega) ** (q - 1) * integral


def _clamped_rebound_time(zeta: Lane, turn: Lane, n: Exponent, unroll: int) -> Lane:
    """Return the time from the turn until the force vanishes, in τ equal to that from touch to
    turn.
    """
    if static_value(n) == 1:
        return turn
    # With weak damping the force vanishes close to x = 0, where the integrand is singular. The time
    # to x = 0 minus the last part is used, both integrated from the singular end.
    weak = zeta < 0.2
    zeta_weak = jnp.where(weak, zeta, 0.1)
    # The last part grows as ζ^(2/(n+1)), with infinite slope at ζ = 0; the derivative is zero
    # there.
    damped = zeta_weak > 0
    last = 2 * jnp.arcsin(jnp.where(damped, zeta_weak, 0.1))
    whole = _end_time(zeta_weak, jnp.pi - jnp.arccos(zeta_weak), n, unroll)
    rest = jnp.where(damped, _end_time(zeta_weak, last, n, unroll), 0)
    zeta_ = jnp.where(weak, 0.5, zeta)

    def integrand(node: Lane) -> Lane:
        tau = turn * (1 + node)
        s = tau * jnp.exp(-zeta_ * tau) * sinc_root((1 - zeta_) * (1 + zeta_) * jnp.square(tau))
        return to_power(jnp.where(weak, 1, s), -_weakness(n))

    direct = _time_unit(n) * turn * integrate(integrand, 0.0, zeta, unroll, count=20)
    return jnp.where(weak, whole - rest, direct)


def _end_time(zeta: Lane, angle: Lane, n: Exponent, unroll: int) -> Lane:
    """Return the time spent in the last `angle` = ωτ before x = 0; ζ < 1."""
    omega = jnp.sqrt((1 - zeta) * (1 + zeta))
    q = _weakness(n)

    def integrand(node: Lane) -> Lane:
        phi = angle * node
        decay = jnp.exp(-(zeta / omega) * (jnp.pi - phi))
        return to_power(decay * sinc_root(jnp.square(phi)) / omega, -q)

    integral = integrate(integrand, q, zeta, unroll)
    return _time_unit(n) * angle ** (1 - q) / omega * integral


def _elastic_rebound_time(s_max: Lane, n: Exponent) -> Lane:
    """Return the time from rest at s_max back to x = 0 without damping, a quarter period ∫
    cos^(-q).
    """
    q = jnp.asarray(_weakness(n), s_max.dtype)
    half = jnp.asarray(0.5, s_max.dtype)
    quarter = jnp.exp(betaln((1 - q) / 2, half)) / 2
    return _time_unit(n) * s_max ** (-_weakness(n)) * quarter


def _extreme_force(zeta: Lane, n: Exponent, *, least: bool = False) -> Lane:
    """Return the largest or the least of ((n+1)/2)^(n/(n+1)) s^q (s + 2ζv), until s = 0.

    Both occur where 2ζq v² + (1+q-4ζ²) s v = 2ζ s². The least has v < 0 and exists for ζ < 1.
    """
    q = _weakness(n)
    b = 1 + q - 4 * jnp.square(zeta)
    # For n = 1 the root is |b|; the derivative of the square root is guarded at zero.
    square = jnp.square(b) + 16 * jnp.square(zeta) * q
    root = jnp.where(square > 0, jnp.sqrt(jnp.where(square > 0, square, 1)), 0)
    early = b <= 0
    v = jnp.where(early, jnp.where(square > 0, root - b, 1), 4 * zeta)
    s = jnp.where(early, 4 * zeta * q, root + b)
    if least:
        # The product of the two values of v/s is -1/q. For n = 1 and ζ = 1/2 it is at the end.
        s, v = jnp.where(early, root - b, 4 * zeta * q), -jnp.where(early, 4 * zeta, s)
    # Along the motion s² + v² + 2ζsv = e^(-2ζτ), which converts the direction into the time.
    size = jnp.sqrt(jnp.square(s) + jnp.square(v) + 2 * zeta * s * v)
    s, v = s / size, v / size
    cosine = v + zeta * s
    if least:
        # Measured from the end of the half period, where the other formula is 0 times infinity.
        omega = jnp.sqrt((1 - zeta) * (1 + zeta))
        moment = jnp.pi / omega - s * arc_over_sine(-cosine)
    else:
        moment = s * arc_over_sine(cosine)
    amplitude = jnp.exp(-zeta * moment)
    s, v = s * amplitude, v * amplitude
    # s vanishes in two cases. For n = 1 the force is extreme at touch or at the end, and s^q is 1.
    # Without damping the least force is zero.
    positive = s > 0
    return (
        jnp.where(positive, jnp.where(positive, s, 1) ** q, 1) * (s + 2 * zeta * v) / _time_unit(n)
    )
