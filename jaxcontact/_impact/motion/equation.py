"""The scaled equation of motion x'' = Γ - f(x, x'): rate, force, and where its energy is."""

from __future__ import annotations

import dataclasses
from typing import Self

import jax.numpy as jnp
from jaxtyping import Array, Bool

from ..._entry import static_value
from ..._forms import Flag, signed_power
from ..._functions import power
from ..._laws import AbstractPlasticForm, JKRForm
from ..._solver.runge_kutta import step
from .coordinates import Coordinates, Number, State

# From this damping c on, a way out is treated as stiff.
_CREEPS = 100.0


class Motion(Coordinates):
    """One lane of an impact: its equation in its coordinates."""

    @property
    def adheres(self) -> bool:
        """True if bodies may stick without a push."""
        return self.form.barrier(jnp.zeros(())) is not None

    @property
    def one_way(self) -> bool:
        """True if bodies that move apart certainly separate at x = 0."""
        return self.push is None and self.form.never_pulls

    @property
    def always_parts(self) -> bool:
        """True if the contact eventually separates, however slowly: nothing pushes or sticks."""
        return self.push is None and self.form.damping(self.n, jnp.asarray(True)) is not None

    @property
    def may_pull(self) -> bool:
        """True if the contact force may become negative."""
        return self.form.may_pull(self.push is not None)

    @property
    def may_creep(self) -> bool:
        """True if the way out may be too stiff for explicit steps."""
        known = self.form.damping(self.n, jnp.asarray(False)) is not None
        return known and (self.push is not None or self.form.creeps_free)

    def creeps(self) -> Bool[Array, ""]:
        """Return whether the way out, if any, certainly creeps."""
        return self.damping_back()[0] > _CREEPS

    def pulling(self, state: State, compressing: Flag) -> Number:
        """Return a smooth function, negative if the contact pulls: f/x^(n-p) if that is known. It
        has full relative precision if u has.
        """
        if self.softness is None:
            return self.form.pulling(state.w, self.velocity(state), self.n, compressing, self.order)
        softness, _ = self.softness
        damping = self.form.damping(self.n, compressing)
        assert damping is not None
        c, p = damping
        return c * state.u + jnp.where(softness > 0, 0, signed_power(state.w, self.order * p))

    def gap_of_force(self, state: State) -> Number:
        """Return a quantity that vanishes with the force, with a slope; negative beyond x = 0."""
        velocity = self.velocity(state)
        if self.softness is None:
            out = jnp.asarray(False)
            pulling = self.form.pulling(state.w, velocity, self.n, out, self.order)
            # A force clamped to zero has vanished already: its gap has a sign but no slope.
            pulling = jnp.where(pulling == 0, -1, pulling) if self.form.may_clamp else pulling
            return jnp.where(state.w < 0, jnp.minimum(pulling, state.w), pulling)
        softness, p = self.softness
        c, _ = self.damping_back()
        if static_value(p) == 0:
            gap = jnp.where(softness > 0, state.u, 1 + c * velocity)
            # Beyond x = 0 time may run back, and the gap may open again. Only earlier states show
            # whether it had closed. Here it counts as closed, but not earlier than x = 0.
            return jnp.where(state.w < 0, state.w + jnp.minimum(gap, 0), gap)
        strong = jnp.where(state.w < 0, jnp.minimum(state.u, velocity), state.u)
        # At the end of a weakly damped contact x^p is flat.
        weak = state.w - power(-c * velocity, 1 / (self.order * p))
        return jnp.where(softness > 0, strong, weak)

    def force(self, state: State, compressing: Flag) -> Number:
        """Return f at a state, for w ≥ 0."""
        if self.softness is not None:
            outer = signed_power(state.w, self.order * (self.n - self.softness[1]))
            return outer * self.pulling(state, compressing)
        x = signed_power(state.w, float(self.order))
        return self.form.force(x, self.velocity(state), self.n, compressing)

    def pull(self, state: State, compressing: Flag) -> Number:
        """Return w^(k-1) f at a state, for forms without a momentum of their own."""
        if self.softness is None:
            return self.form.pull(state.w, self.velocity(state), self.n, compressing, self.order)
        outer = signed_power(state.w, self.order * (self.n - self.softness[1] + 1) - 1)
        return outer * self.pulling(state, compressing)

    def dissipation(self, state: State, velocity: Number, compressing: Flag) -> Number:
        """Return w^(k-1) (f(x, v) - f(x, 0)) v, the rate of dissipation by damping."""
        return self.form.dissipation(state.w, velocity, self.n, compressing, self.order)

    def rate(self, state: State, compressing: Flag) -> State:
        """Return d(w, u, t)/dτ."""
        w, k, momentum = state.w, self.order, self.momentum
        velocity = self.velocity(state)
        clock = signed_power(w, float(k - 1))
        if momentum is not None:
            return State(velocity / k, -momentum.pull(w), clock)
        change = -self.pull(state, compressing)
        if self.softness is not None:
            softness, p = self.softness
            if static_value(p) != 0:
                change = change + softness * p * signed_power(w, k * p - 1) * velocity
        if self.push is not None:
            change = change + self.push * clock
        loss = None
        if state.loss is not None:
            loss = self.dissipation(state, velocity, compressing)
        return State(velocity / k, change, clock, loss)

    def later(self, state: State, time: Number, compressing: Flag) -> State:
        """Return the state a regularised `time` later, by one Runge-Kutta step."""
        return step(lambda s: self.rate(s, compressing), state, time)

    def stored(self, state: State) -> Number:
        """Return the elastic energy at a state."""
        return self.form.stored(state.w, self.n, self.order)

    def lost(self, state: State) -> Number:
        """Return the energy taken by damping up to a state."""
        if state.loss is not None:
            return state.loss
        assert self.momentum is not None
        return self.momentum.lost(self.momentum_at_touch(), state.u)

    def energy(self, state: State) -> Number:
        """Return ½v² + ∫ f(x, 0) dx - Γx, which is conserved without damping."""
        energy = jnp.square(self.velocity(state)) / 2 + self.stored(state)
        return energy if self.push is None else energy - self.push * self.indentation(state.w)

    def after_turn(self, turn: State) -> tuple[Self, State]:
        """Return the motion after the turn, and the state there. From then on a contact with a
        memory unloads, and the energy that it does not return is lost.
        """
        turn = self.still(turn)
        if not self.form.remembers or turn.loss is None:
            return self, turn
        deepest = self.indentation(turn.w)
        kept = self.form.kept(deepest)
        return self.remembering(deepest), turn._replace(loss=turn.loss + kept)

    def remembering(self, deepest: Number) -> Self:
        """Return the motion after a turn at the indentation `deepest`."""
        return dataclasses.replace(self, form=self.form.remembering(deepest))

    def continued(self, inside: State) -> Self:
        """Return the motion under the unclamped force, from a state `inside` the contact."""
        form = self.form.continued(inside.w**self.order, self.velocity(inside))
        return dataclasses.replace(self, form=form)

    def static_indentation(self) -> Number | None:
        """Return the x at rest under the push; None without a push or if it is unknown."""
        if self.push is None:
            return None
        # A pull has no rest position; any positive number keeps its lane finite.
        return self.form.static_indentation(jnp.where(self.push > 0, self.push, 1), self.n)

    def creeping_speed(self, state: State) -> Number:
        """Return the creeping speed x^p/c, for forms whose damping is known."""
        c, p = self.damping_back()
        return signed_power(state.w, self.order * p) / jnp.maximum(c, 1)

    def stiffness(self, state: State) -> Number:
        """Return the rate in regularised time at which a way out relaxes to creep or oscillates."""
        c, p = self.damping_back()
        n, k = self.n, self.order
        return c * signed_power(state.w, k * (n - p + 1) - 1) + signed_power(
            state.w, k * (n + 1) / 2 - 1
        )


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


class PlasticMotion(Motion):
    """One lane of a contact without adhesion: x = w^k up to the turn, and x = x_p + w^k after it.

    So the way back is κ w^(kn), and w = 0 ends the contact.
    """

    form: AbstractPlasticForm

    def indentation(self, w: Number) -> Number:
        return self.form.plastic(w) + w**self.order

    def after_turn(self, turn: State) -> tuple[Self, State]:
        unloads, begun = super().after_turn(turn)
        left = self.indentation(turn.w) - unloads.indentation(jnp.zeros_like(turn.w))
        return unloads, begun._replace(w=power(left, 1 / self.order))

    def gap_of_force(self, state: State) -> Number:
        pulled = False if self.push is None else self.push < 0
        return self.form.gap(state.w, self.velocity(state), pulled)

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
