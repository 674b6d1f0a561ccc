"""The motion of a contact with a neck, which ends beyond x = 0."""

from __future__ import annotations

import math

import jax.numpy as jnp
from jaxtyping import Array, Bool

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
        return self._energy(state) - self._energy(end._replace(u=end.w))

    def held(self, state: State) -> Bool[Array, ""]:
        """Return whether adhesion and the push hold the bodies: ½v² + ∫ f dx - Γx is conserved."""
        push = jnp.zeros_like(state.w) if self.push is None else self.push
        barrier = self.form.barrier(push)
        # Smaller differences may be errors of the solve.
        doubt = math.sqrt(jnp.finfo(state.w.dtype).eps)
        return self._energy(state) < barrier - doubt * jnp.abs(barrier)

    def settled(self, state: State) -> Bool[Array, ""]:
        # A pull may be weaker than adhesion.
        return -self.velocity(state) < state.w

    def _energy(self, state: State) -> Number:
        energy = jnp.square(self.velocity(state)) / 2 + self.stored(state)
        return energy if self.push is None else energy - self.push * self.indentation(state.w)
