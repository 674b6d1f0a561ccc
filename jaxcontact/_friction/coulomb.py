"""Friction laws without a tangential spring."""

from __future__ import annotations

from typing import Any, cast

import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from .._entry import NOT_NEGATIVE, POSITIVE, Range, parameter, refuses_unknown
from .._functions import ratio
from .base import AbstractFriction, Lane, NormalPath, Tangential, TangentialOutcome

TANGENTIAL_RESTITUTION = Range(low=-1.0, high=1.0, inside=0.0)


def margin_of(slip: Lane, jump: Lane) -> Lane:
    """Return |u0/u_jump - 1|, infinite without friction."""
    return jnp.where(jump > 0, jnp.abs(ratio(slip, jump) - 1), jnp.inf)


class RigidCoulomb(AbstractFriction):
    """Coulomb friction of bodies that are rigid in the tangential direction.

    u' = max(0, u0 - λ μ (1+e) v0): the contact point slides until it sticks, for every normal law.
    The slope of the outcome jumps at u0 = λ μ (1+e) v0. Arguments: the coefficient `mu` μ ≥ 0, a
    leaf. Raises ValueError for a Python scalar out of range. Source: Keller (1986), Impact with
    friction, doi 10.1115/1.3171712.
    """

    kind = "rigid"
    mu: Float[Array, "..."] = parameter("mu", NOT_NEGATIVE)

    @refuses_unknown
    def __init__(self, mu: ArrayLike):
        self.mu = cast(Any, mu)  # the field has a converter

    def rebound(self, problem: Tangential) -> TangentialOutcome:
        left, e = problem.after_sliding(self.mu), problem.restitution
        grip = problem.mobility * self.mu
        stop = jnp.maximum(1 - ratio(problem.slip, grip), -e)
        return TangentialOutcome(
            slip=jnp.maximum(left, 0),
            slid=left > 0,
            stop=jnp.where(left > 0, -e, stop),
            start=-e,
            margin=margin_of(problem.slip, grip * (1 + e)),
        )

    def along(self, problem: Tangential, path: NormalPath) -> tuple[Lane, Lane]:
        left = problem.slip - problem.mobility * self.mu * (1 - path.velocity)
        return jnp.maximum(left, 0), jnp.where(left > 0, self.mu * path.force, 0)


class WaltonFriction(AbstractFriction):
    """Walton's friction: u' = -β u0 with β = min(β0, λ μ (1+e) v0/u0 - 1).

    The contact point slides throughout, or it rebounds with the tangential restitution β0. The
    slope of the outcome jumps between the two. Arguments: the coefficient `mu` μ ≥ 0, and `beta0`
    β0 in [-1, 1]; leaves. Raises ValueError for a Python scalar out of range. Source: Walton, in
    Roco (ed.), Particulate two-phase flow (1993), ch. 25; measured by Foerster et al. (1994), doi
    10.1063/1.868282.
    """

    mu: Float[Array, "..."] = parameter("mu", NOT_NEGATIVE)
    beta0: Float[Array, "..."] = parameter("beta0", TANGENTIAL_RESTITUTION, "-")

    @refuses_unknown
    def __init__(self, mu: ArrayLike, beta0: ArrayLike):
        self.mu, self.beta0 = cast(Any, (mu, beta0))  # the fields have converters

    def rebound(self, problem: Tangential) -> TangentialOutcome:
        left, back = problem.after_sliding(self.mu), -self.beta0 * problem.slip
        most = problem.mobility * self.mu * (1 + problem.restitution)
        reach = 1 + self.beta0
        return TangentialOutcome(
            slip=jnp.maximum(left, back),
            slid=left > back,
            margin=jnp.where(reach > 0, margin_of(problem.slip * reach, most), jnp.inf),
        )


class RegularizedCoulomb(AbstractFriction):
    """Coulomb friction whose force grows with the slip speed up to v_d: f = μ F min(|u|/v_d, 1).

    Arguments: the coefficient `mu` μ ≥ 0, and the speed `v_d` > 0 in m/s, each a number or, in a
    `System`, one for each gap. Both are leaves. The force acts against the slip. Below v_d a
    contact creeps, so that nothing sticks. In an impact the slip falls to v_d, then as an
    exponential of the normal impulse, for every normal law. Raises ValueError for a Python scalar
    out of range. Source: Pennestrì et al. (2016), doi 10.1007/s11071-015-2485-3.
    """

    kind = "ramp"
    mu: Float[Array, "..."] = parameter("mu", NOT_NEGATIVE)
    v_d: Float[Array, "..."] = parameter("v_d", POSITIVE)

    @refuses_unknown
    def __init__(self, mu: ArrayLike, v_d: ArrayLike):
        self.mu, self.v_d = cast(Any, (mu, v_d))

    @property
    def is_followed(self) -> bool:
        # A subclass may have another outcome.
        return type(self) is RegularizedCoulomb

    def force(
        self, normal: Float[Array, " contacts"], slip: Float[Array, "contacts ..."]
    ) -> Float[Array, "contacts ..."]:
        """Return the friction in N on the mechanism, in the directions of `slip` in m/s: (m,) in
        the plane, (m, 2) in space. `normal` is the normal force in N.
        """
        square = jnp.square(slip) if slip.ndim == 1 else jnp.sum(jnp.square(slip), axis=1)
        # The larger square is never zero, so that the root has a derivative at rest.
        pace = jnp.sqrt(jnp.maximum(square, jnp.square(self.v_d)))
        strength = self.mu * normal / pace
        return -strength.reshape(strength.shape + (1,) * (slip.ndim - 1)) * slip

    def rebound(self, problem: Tangential) -> TangentialOutcome:
        e = problem.restitution
        slip = self._after(problem, 1 + e)
        return TangentialOutcome(slip=slip, slid=slip >= 0, stop=-e, start=-e)

    def along(self, problem: Tangential, path: NormalPath) -> tuple[Lane, Lane]:
        slip = self._after(problem, 1 - path.velocity)
        return slip, self.mu * path.force * jnp.minimum(slip * problem.speed / self.v_d, 1)

    def _after(self, problem: Tangential, impulse: Lane) -> Lane:
        """Return the slip after a normal impulse: to the ramp, then down as an exponential."""
        grip, ramp = problem.mobility * self.mu, self.v_d / problem.speed
        left = problem.slip - grip * impulse
        rest = jnp.maximum(impulse - ratio(jnp.maximum(problem.slip - ramp, 0), grip), 0)
        slow = jnp.minimum(problem.slip, ramp) * jnp.exp(-grip * rest / ramp)
        return jnp.where(left > ramp, left, slow)
