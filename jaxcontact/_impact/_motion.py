"""The scaled equation of motion in regularised coordinates.

The state is (w, u, t): `x = w^k`, the time t, and a momentum u, which is the velocity v itself or,
in a free impact, the coordinate that the form puts in its place.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._forms import AbstractForm, Exponent, Flag, Momentum, signed_power
from .._parameter import Specialised
from ._runge_kutta import step

Number = Float[Array, ""]

# In units of the energy of the impact: a contact that damping takes more from stays for certain,
# with room for the estimate.
_STAYS = 100.0


class State(NamedTuple):
    """Where the motion is: x = w^k, the momentum u, the time t; or their rates. Scalars in a lane.

    `loss` is the energy that damping has taken so far; None where u tells it or nobody asks.
    """

    w: Number
    u: Number
    t: Number
    loss: Number | None = None


class Motion(eqx.Module):
    """One lane of an impact: a form, an exponent and a scaled external force Γ (None for none)."""

    form: AbstractForm
    exponent: Specialised
    push: Number | None

    @property
    def n(self) -> Exponent:
        """The exponent, a float where it is concrete."""
        return self.exponent.value

    @property
    def order(self) -> int:
        """The k of x = w^k."""
        return self.form.order(self.n)

    @property
    def momentum(self) -> Momentum | None:
        """The coordinate in place of the velocity; None for the velocity itself."""
        return self.form.momentum(self.n) if self.push is None else None

    @property
    def one_way(self) -> bool:
        """Whether the bodies, once they move apart, certainly part at x = 0."""
        return self.push is None and self.form.never_pulls

    def start(self) -> State:
        """The moment of touch: w = 0, v = 1, t = 0."""
        number = jax.tree.leaves(self)[0]

        # It depends on the lane and its tangent, if only formally: otherwise JAX finds out, loop by
        # loop, by tracing their bodies once more for each.
        def of_lane(value: Number | float) -> Number:
            return jnp.where(jnp.isnan(number), number, value)

        touch = of_lane(
            1.0 + self.form.offset() if self.momentum is None else self.momentum.at_touch()
        )
        zero = of_lane(0.0)
        return State(zero, touch, zero, zero if self.momentum is None else None)

    def velocity(self, state: State) -> Number:
        """x' at a state."""
        momentum = self.momentum
        return state.u - self.form.offset() if momentum is None else momentum.velocity(state.u)

    def still(self, state: State) -> State:
        """The state with the velocity 0."""
        rest = jnp.zeros_like(state.u)
        return state._replace(u=rest + self.form.offset() if self.momentum is None else rest)

    def _for_form(self, state: State) -> Number:
        """What the form calls v."""
        return state.u if self.momentum is None else self.velocity(state)

    def force(self, state: State, compressing: Flag) -> Number:
        """f at a state, for w ≥ 0."""
        x = signed_power(state.w, float(self.order))
        return self.form.force(x, self._for_form(state), self.n, compressing)

    def rate(self, state: State, compressing: Flag) -> State:
        """d(w, u, t)/dτ."""
        w, k, n, momentum = state.w, self.order, self.n, self.momentum
        velocity = self.velocity(state)
        clock = signed_power(w, float(k - 1))
        if momentum is not None:
            pull = momentum.pull(w)
        else:
            pull = self.form.pull(w, state.u, n, compressing)
            if self.push is not None:
                pull = pull - self.push * clock
        loss = None
        if state.loss is not None:
            loss = self.form.dissipation(w, self._for_form(state), n, compressing)
        return State(velocity / k, -pull, clock, loss)

    def later(self, state: State, time: Number, compressing: Flag) -> State:
        """The state a regularised `time` later, by one Runge-Kutta step."""
        return step(lambda s: self.rate(s, compressing), state, time)

    def stored(self, state: State) -> Number:
        """The elastic energy at a state."""
        return self.form.stored(state.w, self.n)

    def lost(self, state: State) -> Number:
        """The energy that damping has taken until a state."""
        if state.loss is not None:
            return state.loss
        assert self.momentum is not None
        return self.momentum.lost(state.u)

    def held(self, state: State) -> Bool[Array, ""]:
        """Whether the push keeps the bodies together for good: too little energy is left to part.

        Damping can only decrease ½v² + ∫ f(x, 0) dx - Γx, which is positive at separation.
        """
        if self.push is None:
            return jnp.asarray(False)
        kinetic = jnp.square(self.velocity(state)) / 2
        # Energies that agree to this may differ by the errors of the solve alone.
        doubt = math.sqrt(jnp.finfo(state.w.dtype).eps)
        work = self.push * state.w**self.order
        return kinetic + self.stored(state) < work * (1 - doubt)

    def smallness(self) -> tuple[Number | float, Number | float]:
        """How small what ends the motion is beside the forces, and beside the speed of the impact.

        Both are 1 unless damping is strong: a creeping contact without tension ends where forces
        cancel that differ by little on all of its way; before the turn little speed is left.
        """
        form = self.form
        clamped = not (form.tension or form.never_pulls)
        ending = form.creeping_excess(self.n) if clamped else 1.0
        speed = form.creeping_speed(self.n) if self.momentum is None else 1.0
        if self.order == 1 and self.always_parts and form.tension:
            # Where no power of w stretches it, a slow way out ends as small as its e.
            speed = math.sqrt(jnp.finfo(jax.tree.leaves(self)[0].dtype).tiny)
        if self.push is not None and self.form.never_pulls and not form.tension:
            # Under a weak pull the force falls to that of the pull before it vanishes.
            speed = speed * jnp.where(self.push < 0, jnp.clip(-self.push, 1e-12, 1), 1)
        return self._fastest() * ending, speed

    def _fastest(self) -> Number | float:
        """The speed of the impact in units of the largest one, which a strong push brings about.

        The errors of fast motion would be large beside the slow end of a contact that parts again.
        """
        static, damping = self.static_indentation(), self.form.damping(self.n, jnp.asarray(True))
        if self.push is None or static is None or damping is None:
            return 1.0
        fastest = jnp.sqrt(1 + jnp.maximum(self.push, 0) * static)
        c, p = damping
        parts = c * static ** (self.n - p + 1) * fastest < _STAYS
        return jnp.where(parts, 1 / fastest, 1)

    @property
    def always_parts(self) -> bool:
        """Whether a contact parts in the end, however slowly: nothing pushes or sticks."""
        return self.push is None and self.form.damping(self.n, jnp.asarray(True)) is not None

    def creeps_back(self) -> Bool[Array, ""]:
        """Whether the bodies of a free contact creep apart for ever."""
        return self.form.creeps_back(self.n)

    def static_indentation(self) -> Number | None:
        """The x at rest under the push; None without a push or where the form does not know it."""
        if self.push is None:
            return None
        # A pull has none: any positive number keeps its lane finite.
        return self.form.static_indentation(jnp.where(self.push > 0, self.push, 1), self.n)

    def gaps(self, state: State, compressing: Flag) -> tuple[Number, Number]:
        """What falls through zero where a leg ends: at a turn, and where the bodies part.

        The first one starts a way out at zero.
        """
        velocity = self.velocity(state)
        back = jnp.ones_like(velocity) if self.one_way else -velocity
        apart = state.w if self.one_way else self._gap_apart(state)
        return jnp.where(compressing, velocity, back), jnp.where(compressing, 1, apart)

    def _gap_apart(self, state: State) -> Number:
        """Positive until the contact is over: at x = 0, or where a force that may not pull is 0."""
        if self.form.tension:
            return state.w
        leaving = jnp.asarray(False)
        pulling = self.form.pulling(state.w, self._for_form(state), self.n, leaving)
        apart = jnp.minimum(state.w, pulling)
        if self.push is not None and self.form.never_pulls:
            # Where its force vanished a push would press: there only rounding can get.
            apart = jnp.where(self.push > 0, state.w, apart)
        return apart

    def settled(self, state: State) -> Bool[Array, ""]:
        """Whether a way out ended because the contact turned inwards again."""
        if self.one_way:
            return jnp.asarray(False)
        inwards = -self.velocity(state) < self._gap_apart(state)
        # A pull turns nothing inwards: there both are zero but for rounding.
        return inwards if self.push is None else inwards & (self.push > 0)

    def swings(self, static: Number) -> Bool[Array, ""]:
        """Whether bodies near rest under the push swing about it; otherwise they creep to it.

        There y'' + c x^(n-p) y' + n x^(n-1) y = 0.
        """
        n, damping = self.n, self.form.damping(self.n, jnp.asarray(True))
        if damping is None:
            return jnp.asarray(True)
        c, p = damping
        return jnp.square(c) * static ** (n + 1 - 2 * p) < 4 * n
