"""Coulomb friction with a ramp."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from .._entry import NOT_NEGATIVE, POSITIVE, as_parameter, parameter, refuses_unknown
from .._functions import ratio
from .base import AbstractFriction, Lane, NormalPath, Tangential, TangentialOutcome


class RegularizedCoulomb(AbstractFriction):
    """Coulomb friction whose force grows with the slip speed up to v_d: f = μ F min(|u|/v_d, 1).

    Arguments: the coefficient `mu` μ ≥ 0, and the speed `v_d` > 0 in m/s, each a number or, in a
    `System`, one for each gap. Both are leaves. The force acts against the slip. Below v_d a
    contact creeps, so that nothing sticks. In an impact the slip falls to v_d, then as an
    exponential of the normal impulse, for every normal law. Raises ValueError for a Python scalar
    out of range. Source: Pennestrì et al. (2016), doi 10.1007/s11071-015-2485-3.
    """

    mu: Float[Array, "..."] = parameter("mu", NOT_NEGATIVE)
    v_d: Float[Array, "..."] = parameter("v_d", POSITIVE)

    @refuses_unknown
    def __init__(self, mu: ArrayLike, v_d: ArrayLike):
        self.mu = as_parameter(mu, "mu", NOT_NEGATIVE)
        self.v_d = as_parameter(v_d, "v_d", POSITIVE)

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
