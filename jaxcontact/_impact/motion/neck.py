"""The motion of a contact with a neck, which ends beyond x = 0."""

from __future__ import annotations

import jax.numpy as jnp

from ..._forms import Flag, JKRForm
from .motion import Motion, Number, State


class NeckMotion(Motion):
    """One lane of a JKR contact, in the coordinate w of its form: dt = (dx/dw) dτ, so that w' = v.

    It starts at w > 0, where x = 0, and ends at w = 0, the snap.
    """

    form: JKRForm

    @property
    def order(self) -> int:
        """One: w is a coordinate of its own."""
        return 1

    def indentation(self, w: Number) -> Number:
        return self.form.indentation_at(w)

    def start(self) -> State:
        touch = super().start()
        return touch._replace(w=touch.w + self.form.touch_at())

    def force(self, state: State, compressing: Flag) -> Number:
        del compressing
        return self.form.force_at(state.w)

    def rate(self, state: State, compressing: Flag) -> State:
        clock, force = self.form.pace_at(state.w), self.force(state, compressing)
        if self.push is not None:
            force = force - self.push
        loss = None if state.loss is None else jnp.zeros_like(state.loss)
        return State(state.u, -force * clock, clock, loss)

    def stored(self, state: State) -> Number:
        return self.form.energy_at(state.w)

    def smallness(self) -> tuple[Number | float, Number | float]:
        return 1.0, 1.0

    def spare_energy(self, state: State) -> Number:
        """Return the energy of a state above that of the snap."""
        end = state._replace(w=jnp.zeros_like(state.w))
        return self.energy(state) - self.energy(end._replace(u=end.w))
