"""The motion of a yielding contact, which unloads to its plastic indentation x_p."""

from __future__ import annotations

import jax.numpy as jnp

from ..._forms import Flag, YieldingForm
from ..._functions import power
from .motion import Motion, Number, State


class YieldingMotion(Motion):
    """One lane of a yielding contact: x = w² up to the turn, and x = x_p + w² after it.

    Both forces are polynomials in w, and w = 0 ends the contact.
    """

    form: YieldingForm

    def indentation(self, w: Number) -> Number:
        return self.form.plastic() + jnp.square(w)

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

    def gap_of_force(self, state: State) -> Number:
        # Under a pull, strong damping may pull before w = 0.
        damped = self.form.damped(self.velocity(state))
        return jnp.where(state.w < 0, state.w, state.w * damped)
