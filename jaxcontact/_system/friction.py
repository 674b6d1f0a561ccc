"""Friction of contacts in mechanisms."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from .._coupled.modes import PerContact
from .._entry import NOT_NEGATIVE, POSITIVE, as_parameter, parameter, refuses_unknown


class RegularizedCoulomb(eqx.Module):
    """Coulomb friction whose force grows with the slip speed up to v_d: f = μ F min(|v|/v_d, 1).

    Arguments: the coefficient `mu` μ ≥ 0, and the speed `v_d` > 0 in m/s, each a number or one for
    each gap. Both are leaves. The force acts against the slip. Below v_d a contact creeps, so that
    nothing sticks. Raises ValueError for a Python scalar out of range. Source: Pennestrì
    et al. (2016), doi 10.1007/s11071-015-2485-3.
    """

    mu: Float[Array, "..."] = parameter("mu", NOT_NEGATIVE)
    v_d: Float[Array, "..."] = parameter("v_d", POSITIVE)

    @refuses_unknown
    def __init__(self, mu: ArrayLike, v_d: ArrayLike):
        self.mu = as_parameter(mu, "mu", NOT_NEGATIVE)
        self.v_d = as_parameter(v_d, "v_d", POSITIVE)

    def force(self, normal: PerContact, slip: Float[Array, "contacts ..."]) -> Array:
        """Return the friction in N on the mechanism, in the directions of `slip` in m/s: (m,) in
        the plane, (m, 2) in space. `normal` is the normal force in N.
        """
        square = jnp.square(slip) if slip.ndim == 1 else jnp.sum(jnp.square(slip), axis=1)
        # The larger square is never zero, so that the root has a derivative at rest.
        pace = jnp.sqrt(jnp.maximum(square, jnp.square(self.v_d)))
        strength = self.mu * normal / pace
        return -strength.reshape(strength.shape + (1,) * (slip.ndim - 1)) * slip
