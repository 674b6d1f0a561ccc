"""The scaled equation of motion in regularised coordinates, as a solver sees it.

The state is (w, u, t): `x = w^k`, the time t, and a momentum u, which is the velocity v itself or,
for the free Hunt-Crossley family, `y = ln(1+αv)/α`. With y the right-hand side is entire and not
stiff at any α.
"""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._elementary import log1p_over, speed_of
from ._form import AbstractForm, Flag, HuntCrossleyForm, signed_power
from ._quadrature import Exponent

Number = Float[Array, ""]


class State(NamedTuple):
    """Where the motion is: x = w^k, the momentum u, the time t; or their rates. Scalars in a lane.

    `loss` is the work done by damping so far, None where nobody asked for it.
    """

    w: Number
    u: Number
    t: Number
    loss: Number | None = None


class Motion(eqx.Module):
    """One lane of an impact: a form, an exponent and a scaled external force Γ (None for none)."""

    form: AbstractForm
    traced_exponent: Number | None
    push: Number | None
    static_exponent: float | None = eqx.field(static=True)
    audited: bool = eqx.field(static=True, default=False)

    @property
    def n(self) -> Exponent:
        """The exponent, a float where it is concrete."""
        if self.static_exponent is not None:
            return self.static_exponent
        assert self.traced_exponent is not None
        return self.traced_exponent

    @property
    def order(self) -> int:
        """The k of x = w^k."""
        return self.form.order(self.n)

    @property
    def logarithmic(self) -> bool:
        """Whether the momentum is y = ln(1+αv)/α."""
        return isinstance(self.form, HuntCrossleyForm) and self.push is None

    def start(self) -> State:
        """The moment of touch: w = 0, v = 1, t = 0."""
        dtype = jax.tree.leaves(self)[0].dtype
        momentum = jnp.ones((), dtype)
        if self.logarithmic:
            assert isinstance(self.form, HuntCrossleyForm)
            momentum = log1p_over(self.form.alpha)
        zero = jnp.zeros((), dtype)
        return State(zero, momentum, zero, zero if self.audited else None)

    def velocity(self, state: State) -> Number:
        """x' at a state."""
        momentum = state.u
        if not self.logarithmic:
            return momentum
        assert isinstance(self.form, HuntCrossleyForm)
        return speed_of(momentum, self.form.alpha)

    def force(self, state: State, compressing: Flag) -> Number:
        """f at a state, for w ≥ 0."""
        x = signed_power(state.w, float(self.order))
        return self.form.force(x, self.velocity(state), self.n, compressing)

    def rate(self, state: State, compressing: Flag) -> State:
        """d(w, u, t)/dτ."""
        w, k, n = state.w, self.order, self.n
        velocity = self.velocity(state)
        clock = signed_power(w, float(k - 1))
        if self.logarithmic:
            pull = signed_power(w, k * (n + 1) - 1)
        else:
            pull = self.form.pull(w, velocity, n, compressing)
            if self.push is not None:
                pull = pull - self.push * clock
        loss = None
        if self.audited:
            still = jnp.zeros_like(velocity)
            force = self.form.pull(w, velocity, n, compressing)
            loss = (force - self.form.pull(w, still, n, compressing)) * velocity
        return State(velocity / k, -pull, clock, loss)

    def stored(self, state: State) -> Number:
        """∫ f(x, 0) dx from 0 to w^k: by a Gauss rule that is exact for the polynomial forms."""
        nodes, weights = np.polynomial.legendre.leggauss(16)
        still, held = jnp.zeros_like(state.w), jnp.asarray(True)
        at = state.w * jnp.asarray((1 + nodes) / 2, state.w.dtype)
        pulls = jax.vmap(lambda w: self.form.pull(w, still, self.n, held))(at)
        return self.order * state.w * jnp.sum(jnp.asarray(weights / 2, state.w.dtype) * pulls)

    def held(self, state: State) -> Bool[Array, ""]:
        """Whether the push keeps the bodies together for good: too little energy is left to part.

        Damping can only take from ½v² + ∫ f(x, 0) dx - Γx, which is positive at separation.
        """
        if self.push is None:
            return jnp.asarray(False)
        kinetic = jnp.square(self.velocity(state)) / 2
        return kinetic + self.stored(state) < self.push * state.w**self.order

    def gap(self, state: State, compressing: Flag) -> Number:
        """What falls through zero at the end of a leg: the velocity in, the nearest gap out."""
        velocity = self.velocity(state)
        if self.logarithmic:
            return jnp.where(compressing, velocity, state.w)
        return jnp.where(compressing, velocity, jnp.minimum(-velocity, self._gap_apart(state)))

    def _gap_apart(self, state: State) -> Number:
        """Positive until the contact is over: at x = 0, or where a force that may not pull is 0."""
        if self.form.tension:
            return state.w
        leaving = jnp.asarray(False)
        pulling = self.form.pulling(state.w, self.velocity(state), self.n, leaving)
        return jnp.minimum(state.w, pulling)

    def settled(self, state: State) -> Bool[Array, ""]:
        """Whether a way out ended because the contact turned inwards again."""
        if self.logarithmic:
            return jnp.asarray(False)
        return -self.velocity(state) < self._gap_apart(state)
