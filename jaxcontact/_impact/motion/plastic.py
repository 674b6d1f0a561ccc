"""The motion of an elastic-plastic contact, which unloads to its plastic indentation x_p."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Bool

from ..._forms import AbstractPlasticForm, Flag, YieldingForm
from ..._functions import power
from .motion import Motion, Number, State


class PlasticMotion(Motion):
    """One lane of an elastic-plastic contact without adhesion, which ends at x_p.

    Only a pull ends it before, where damping exceeds the elastic force: 1 + αv = 0. In a contact
    that creeps apart at the speed 1/α, that number is smaller than the error of a solve.
    """

    form: AbstractPlasticForm

    def gap_of_force(self, state: State) -> Number:
        left = self.left(state)
        if self.push is None or self.form.alpha is None:
            return left
        damped = self.form.damped(self.velocity(state))
        return jnp.where((left < 0) | (self.push >= 0), left, left * damped)

    def left(self, state: State) -> Number:
        """Return a coordinate that falls through zero at x_p."""
        left = self.form.left(self.indentation(state.w))
        return jnp.where(state.w < 0, jnp.minimum(left, state.w), left)

    def smallness(self) -> tuple[Number | float, Number | float]:
        if self.push is None or self.form.alpha is None:
            return 1.0, 1.0
        # The speed differs little from 1/α where a pull ends the contact.
        slow = jnp.where(self.push < 0, 1 / jnp.maximum(self.form.alpha, 1), 1)
        return slow, slow


class YieldingMotion(PlasticMotion):
    """One lane of a yielding contact: x = w² up to the turn, and x = x_p + w² after it.

    Both forces are polynomials in w, and w = 0 ends the contact.
    """

    form: YieldingForm

    def indentation(self, w: Number) -> Number:
        return self.form.plastic() + jnp.square(w)

    def left(self, state: State) -> Number:
        return state.w

    def after_turn(self, turn: State) -> tuple[Motion, State]:
        unloads, begun = super().after_turn(turn)
        left = self.indentation(turn.w) - unloads.indentation(jnp.zeros_like(turn.w))
        return unloads, begun._replace(w=power(left, 0.5))

    def force(self, state: State, compressing: Flag) -> Number:
        still = self.form.force_at(state.w, compressing)
        return still * self.form.damped(self.velocity(state))

    def pull(self, state: State, compressing: Flag) -> Number:
        return state.w * self.force(state, compressing)

    def dissipation(self, state: State, compressing: Flag) -> Number:
        if self.form.alpha is None:
            return jnp.zeros_like(state.w)
        still = state.w * self.form.force_at(state.w, compressing)
        return self.form.alpha * jnp.square(self.velocity(state)) * still

    def stored(self, state: State) -> Number:
        return self.form.stored(self.indentation(state.w), self.n, 1)

    @property
    def ends_smoothly(self) -> bool:
        return True

    def parts_at_touch(self) -> Bool[Array, ""]:
        return jnp.asarray(True) if self.push is None else self.push >= 0
