"""The exact relation between the damping factor α and the restitution e of F = K δⁿ (1 + α δ'/v0).

In units of the closing speed the energy balance of a free impact reads `G(1) = G(-e)` with
`G(v) = ∫ v dv/(1+αv) = v/α - ln(1+αv)/α²`, for every exponent n. With `z = ln(1-αe) < 0`,
`ψ(z) = (e^z-1-z)/z²` and `L(α) = (α-ln(1+α))/α²` it becomes `(z/α)² ψ(z) = L(α)`, which is smooth
through α = 0 and keeps all its digits up to the largest α.
"""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from .._elementary import kappa, log_remainder, psi
from .._implicit import implicit_root
from .._parameter import RESTITUTION, as_parameter


def _rebound_residual(rho: Float[Array, "..."], alpha: Float[Array, "..."]) -> Float[Array, "..."]:
    return jnp.square(rho) * psi(-alpha * rho) - log_remainder(alpha)


def _rebound_guess(alpha: Float[Array, "..."]) -> Float[Array, "..."]:
    # With p²/2 = α - ln(1+α): z = -p - p²/6 - p³/36 + ... for weak damping, and
    # z = -(1 + p²/2) up to e^z for strong damping. Either is within 3 % at the switch, p = 2.
    p_over_alpha = jnp.sqrt(2 * log_remainder(alpha))
    p = alpha * p_over_alpha
    strong = p > 2
    p_weak = jnp.where(strong, 0, p)
    weak_rho = p_over_alpha * (1 + p_weak / 6 + jnp.square(p_weak) / 36)
    strong_rho = (1 + jnp.square(p) / 2) / jnp.where(strong, alpha, 1)
    return jnp.where(strong, strong_rho, weak_rho)


# Four Newton steps from a guess within 3 %: the error squares to 1e-3, 1e-6, 1e-12, rounding.
rebound_exponent = implicit_root(_rebound_residual, _rebound_guess, iterations=4)
"""ρ(α) = -ln(1-αe)/α, the regularised rebound speed; ρ(0) = 1."""


def restitution_of(alpha: Float[Array, "..."]) -> Float[Array, "..."]:
    """The e that the damping factor α ≥ 0 delivers in a free impact, for every exponent n."""
    rho = rebound_exponent(alpha)
    return rho * kappa(-alpha * rho)


def _damping_residual(z: Float[Array, "..."], e: Float[Array, "..."]) -> Float[Array, "..."]:
    ratio = kappa(z) / e  # -α/z
    return psi(z) - jnp.square(ratio) * log_remainder(-z * ratio)


def _damping_guess(e: Float[Array, "..."]) -> Float[Array, "..."]:
    # Strong damping: α = 1/e up to e^z. Weak damping: the rational fit of Carvalho and Martins.
    strong = e < 0.4
    e_weak = jnp.where(strong, 0.5, e)
    weak_z = jnp.log1p(-1.5 * e_weak * (1 - e_weak) * (11 - e_weak) / (1 + 9 * e_weak))
    alpha = 1 / jnp.where(strong, e, 1)
    return jnp.where(strong, jnp.log1p(alpha) - alpha - 1, weak_z)


_damping_exponent = implicit_root(_damping_residual, _damping_guess, iterations=5)


def exact_damping_factor(e: ArrayLike) -> Float[Array, "..."]:
    """The damping factor α that delivers the restitution e, for every exponent n.

    Solves `α(1+e) = ln[(1+α)/(1-αe)]`; α → 3(1-e)/2 as e → 1 and α → 1/e as e → 0.

    Arguments: `e` in (0, 1], any shape, dimensionless. Returns α, dimensionless, of the same shape;
    NaN in lanes out of range. Differentiable to any order, at e = 1 too. Raises ValueError for a
    Python scalar out of range. Inverse of `restitution`; derived from the energy integral of the
    Hunt-Crossley force, doi 10.1115/1.3423596.
    """
    e = as_parameter(e, "e", RESTITUTION)
    valid = RESTITUTION.holds(e)
    safe = jnp.where(valid, e, RESTITUTION.inside)
    z = _damping_exponent(safe)
    return jnp.where(valid, -z * kappa(z) / safe, jnp.nan)
