"""The motion of an elastic-plastic contact, which unloads to its plastic indentation x_p."""

from __future__ import annotations

import math

import jax.numpy as jnp
from jaxtyping import Array, Bool

from ..._forms import AbstractPlasticForm, Flag
from ..._functions import power
from .motion import Motion, Number, State


class PlasticMotion(Motion):
    """One lane of a contact without adhesion: x = w^k up to the turn, and x = x_p + w^k after it.

    So the way back is κ w^(kn), and w = 0 ends the contact.
    """

    form: AbstractPlasticForm

    def indentation(self, w: Number) -> Number:
        return self.form.plastic(w) + w**self.order

    def after_turn(self, turn: State) -> tuple[Motion, State]:
        unloads, begun = super().after_turn(turn)
        left = self.indentation(turn.w) - unloads.indentation(jnp.zeros_like(turn.w))
        return unloads, begun._replace(w=power(left, 1 / self.order))

    def force(self, state: State, compressing: Flag) -> Number:
        still = self.form.force_at(state.w, self.order, compressing)
        return still * self.form.damped(self.velocity(state))

    def pull(self, state: State, compressing: Flag) -> Number:
        return state.w ** (self.order - 1) * self.force(state, compressing)

    def dissipation(self, state: State, velocity: Number, compressing: Flag) -> Number:
        if self.form.alpha is None:
            return jnp.zeros_like(state.w)
        still = self.form.force_at(state.w, self.order, compressing) * state.w ** (self.order - 1)
        return self.form.alpha * jnp.square(velocity) * still

    def stored(self, state: State) -> Number:
        return self.form.stored(self.indentation(state.w), self.n, 1)

    def smallness(self) -> tuple[Number | float, Number | float]:
        if self.push is None or self.form.alpha is None:
            return 1.0, 1.0
        # The speed differs little from 1/α where a pull ends the contact.
        slow = jnp.where(self.push < 0, 1 / jnp.maximum(self.form.alpha, 1), 1)
        return slow, slow

    def force_is_sharp(self, end: State, allowed: float) -> Bool[Array, ""]:
        """Return whether rounding moves an end before x_p by less than the `allowed` share of the
        duration. The speed there is 1/α, and a pull Γ changes it by its rounding in eps/(αΓ).
        """
        if self.push is None or self.form.alpha is None:
            return jnp.asarray(True)
        velocity, eps = self.velocity(end), jnp.finfo(end.w.dtype).eps
        whole = (self.push >= 0) | (self.form.damped(velocity) > math.sqrt(eps))
        late = eps * jnp.abs(velocity)
        return whole | (late <= allowed * end.t * jnp.abs(self.push))

    @property
    def ends_smoothly(self) -> bool:
        return True

    def parts_at_touch(self) -> Bool[Array, ""]:
        return jnp.asarray(True) if self.push is None else self.push >= 0

    def gap_of_force(self, state: State) -> Number:
        pulled = False if self.push is None else self.push < 0
        return self.form.gap(state.w, self.velocity(state), pulled)
