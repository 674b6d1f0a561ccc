"""The regularised coordinates of an impact, in which its equation is smooth at touch.

The state is (w, u, t) with `x = w^k`, the time t, and a momentum u. u is usually the velocity v. In
a free impact it may be a coordinate of the form instead. If strong damping c makes the bodies
creep, it is `u = v + x^p/c`. This is the force over c x^(n-p), which keeps its digits while v and
x^p/c cancel.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple, Self

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..._entry import Specialised, static_value
from ..._forms import AbstractForm, Exponent, Momentum, signed_power

Number = Float[Array, ""]

# The k of a traced exponent. With k = 2, derivatives by n were off by 1e-8 of the outcome at rtol
# 1e-11, with 4 by 1e-12. The phase method would need twice as many steps.
_SMOOTH = 4


class State(NamedTuple):
    """The state of one lane: x = w^k, the momentum u, the time t; or their rates. `loss` is the
    energy taken by damping so far; None if u determines it or it is not needed.
    """

    w: Number
    u: Number
    t: Number
    loss: Number | None = None


class Coordinates(eqx.Module):
    """The coordinates of one lane: of a form, an exponent and a scaled external force Γ, or None.

    `smooth`: whether derivatives by a traced n must be as smooth as the values. They have
    logarithms of w at touch, which the step control does not see. `peak`: whether damping refers to
    the largest closing speed since touch, instead of that at touch. `prepared` holds values that
    `ready` computed once for the lane.
    """

    form: AbstractForm
    exponent: Specialised
    push: Number | None
    smooth: bool = eqx.field(static=True, default=False)
    peak: bool = eqx.field(static=True, default=False)
    prepared: Number | None = None

    def ready(self) -> Self:
        """Return the motion with the constants of the lane computed in advance."""
        if self.momentum is not None:
            return dataclasses.replace(self, prepared=self.momentum.at_touch())
        softness = self.softness
        return self if softness is None else dataclasses.replace(self, prepared=softness[0])

    def momentum_at_touch(self) -> Number:
        """Return the u at touch, for forms with a momentum of their own."""
        assert self.momentum is not None
        return self.momentum.at_touch() if self.prepared is None else self.prepared

    @property
    def n(self) -> Exponent:
        """The exponent; a float if it is concrete."""
        return self.exponent.value

    @property
    def order(self) -> int:
        """The k of x = w^k."""
        known = self.form.damping(self.n, jnp.asarray(True)) is not None
        if self.smooth and static_value(self.n) is None and known and self.momentum is None:
            return _SMOOTH
        return self.form.order(self.n)

    @property
    def momentum(self) -> Momentum | None:
        """The coordinate in place of the velocity; None for the velocity itself."""
        return self.form.momentum(self.n) if self.push is None else None

    def indentation(self, w: Number) -> Number:
        """Return the x of a w."""
        return w**self.order

    def start(self) -> State:
        """Return the state at touch: w = 0, v = 1, t = 0."""
        number = jax.tree.leaves(self)[0]

        # The values formally depend on the lane and its tangent. Otherwise JAX would trace the body
        # of each loop again to find the dependence.
        def of_lane(value: Number | float) -> Number:
            return jnp.where(jnp.isnan(number), number, value)

        zero = of_lane(0.0)
        if self.momentum is not None:
            return State(zero, of_lane(self.momentum_at_touch()), zero)
        return State(zero, of_lane(1.0 + self.creep(zero)), zero, zero)

    def damping_back(self) -> tuple[Number, Exponent]:
        """Return the c and p of the way out, for forms whose damping is known."""
        damping = self.form.damping(self.n, jnp.asarray(False))
        assert damping is not None
        return damping

    @property
    def softness(self) -> tuple[Number, Exponent] | None:
        """The b and p of u = v + b x^p: b = 1/c for strong damping, 0 for weak; None for u = v. The
        damping is that of the way out, since damping on approach only does not cause creep back.
        """
        damping = self.form.damping(self.n, jnp.asarray(False))
        if damping is None or (self.push is None and self.form.follows_phase_angle):
            return None
        c, p = damping
        if self.prepared is not None:
            return self.prepared, p
        strong = c > 1
        return jnp.where(strong, 1 / jnp.where(strong, c, 1), 0), p

    def creep(self, w: Number) -> Number | float:
        """Return b x^p, the speed at which bodies creep apart while their force is almost zero."""
        if self.softness is None:
            return 0.0
        softness, p = self.softness
        return softness * signed_power(w, self.order * p)

    def velocity(self, state: State) -> Number:
        """Return x' at a state."""
        momentum = self.momentum
        return state.u - self.creep(state.w) if momentum is None else momentum.velocity(state.u)

    def still(self, state: State) -> State:
        """Return the state with zero velocity."""
        rest = jnp.zeros_like(state.u)
        return state._replace(u=rest + self.creep(state.w) if self.momentum is None else rest)

    def touching(self, state: State) -> State:
        """Return the state at w = 0, with its velocity."""
        touch = state._replace(w=jnp.zeros_like(state.w))
        if self.momentum is not None:
            return touch
        return touch._replace(u=self.velocity(state) + self.creep(touch.w))

    def parting(self, state: State) -> State:
        """Return a state just before separation, as the start of a leg that is not needed."""
        near = jnp.full_like(state.w, 1e-6)
        return state._replace(w=near, u=self.creep(near) - jnp.ones_like(state.u))
