"""The Hunt-Crossley family solved: x'' = -xⁿ (1 + α x'), x(0) = 0, x'(0) = 1.

With `y = ln(1+αv)/α` the energy integral reads `x^(n+1)/(n+1) = H(y)` and the time is
`t = ∫ ((n+1) H)^(-n/(n+1)) dy`. Measured from the outer end of a half (touch or separation),
`H = D (|v| κ(aD) + D ψ(aD))`, where D is the distance in y, a = α on the way in and a = -α on the
way out. Every term is positive, so nothing cancels, at any α.
"""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._elementary import kappa, log1p_over, log_remainder, psi
from .._implicit import implicit_root
from .._laws import rebound_exponent
from ._quadrature import UNROLL, Exponent, integrate, to_power, with_exponent
from ._scaled import Scaled
from ._sensitivity import lanewise

Lane = Float[Array, "..."]


def solve_hunt_crossley(alpha: Lane, n: Exponent) -> Scaled:
    """Everything about the scaled impact with damping factor α ≥ 0 and exponent n in [1, 3].

    Restitution and extrema by formula, the two times by quadrature.
    """
    alpha, n = with_exponent(alpha, n)
    rho = rebound_exponent(alpha)
    if isinstance(n, float):
        compression, rebound = lanewise(
            lambda alpha: _times(alpha, n, UNROLL), lambda alpha: _times(alpha, n, 1)
        )(alpha)
    else:
        compression, rebound = lanewise(
            lambda alpha, n: _times(alpha, n, UNROLL), lambda alpha, n: _times(alpha, n, 1)
        )(alpha, n)
    ones = jnp.ones_like(alpha, dtype=bool)
    return Scaled(
        restitution=rho * kappa(-alpha * rho),
        duration=compression + rebound,
        compression_time=compression,
        max_indentation=((n + 1) * log_remainder(alpha)) ** (1 / (n + 1)),
        max_force=_max_force(alpha, n),
        converged=ones,
        settled=~ones,
    )


def _times(alpha: Lane, n: Exponent, unroll: int) -> tuple[Lane, Lane]:
    """From touch to the turn, and from there to separation."""
    way_in = _half_time(alpha, log1p_over(alpha), n, unroll)
    return way_in, _half_time(-alpha, rebound_exponent(alpha), n, unroll)


def _half_time(a: Lane, length: Lane, n: Exponent, unroll: int) -> Lane:
    """Time between touch and turn (a = α) or turn and separation (a = -α)."""
    p = n / (n + 1)
    # Where strong damping makes the way out long, all that happens lies within `layer` of the
    # turn: before it the bodies creep apart at the speed 1/α, which leaves e^-layer to neglect.
    double = a.dtype == jnp.float64
    layer = 36.0 if double else 17.0
    creeping = -a * length > layer
    rate = jnp.where(creeping, -a, 1)
    start = jnp.where(creeping, length - layer / rate, 0)
    creep = jnp.where(creeping, rate**p, 0)
    span = length - start

    def integrand(node: Lane) -> Lane:
        distance = start + span * node
        z = a * distance
        inner = length - distance
        speed = inner * kappa(a * inner)
        slowness = to_power(speed * kappa(z) + distance * psi(z), -p) - creep
        # The rule expects the singularity at the start of its span; here it may lie further out.
        return slowness * to_power(span * node / distance, p)

    integral = integrate(integrand, p, a, 20 if double else 10, unroll) * span ** (1 - p)
    creep_integral = creep * length ** (1 - p) * (n + 1)
    return (integral + creep_integral) * (n + 1) ** -p


def _peak_residual(v: Lane, alpha: Lane, n: Lane) -> Lane:
    return (n + 1) * alpha * _stored(v, alpha) - n * v


def _stored(v: Lane, alpha: Lane) -> Lane:
    """H = G(1) - G(v), the elastic energy stored when the speed has fallen from 1 to v ≥ 0."""
    delta = (1 - v) / (1 + alpha * v)
    return delta * (v + delta * log_remainder(alpha * delta))


def _peak_guess(alpha: Lane, n: Lane) -> Lane:
    # Right in both limits, weak damping and strong.
    return (n + 1) * alpha / (2 * n + (2 * n + 1) * alpha)


_peak_velocity = implicit_root(_peak_residual, _peak_guess, iterations=5)


def _max_force(alpha: Lane, n: Exponent) -> Lane:
    """The largest force: where (n+1) α H = n v, on the way in for any α > 0."""
    v = _peak_velocity(alpha, jnp.broadcast_to(jnp.asarray(n, alpha.dtype), alpha.shape))
    return (1 + alpha * v) * ((n + 1) * _stored(v, alpha)) ** (n / (n + 1))
