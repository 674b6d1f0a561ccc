"""The scaled equation of motion in regularised coordinates.

The state is (w, u, t): `x = w^k`, the time t, and a momentum u, which is the velocity v itself; in
a free impact the coordinate that the form puts in its place; or, where strong damping c makes the
bodies creep, `u = v + x^p/c`. That is the force over c x^(n-p), which keeps its digits while v and
x^p/c cancel.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..._elementary import power
from ..._forms import AbstractForm, Exponent, Flag, Momentum, signed_power
from ..._parameter import Specialised
from ..._solver.runge_kutta import step

Number = Float[Array, ""]

# In units of the energy of the impact: a contact that damping takes more from stays for certain,
# with room for the estimate.
_STAYS = 100.0

# The k of a traced exponent. With k = 2 derivatives by n were off by 1e-8 of the outcome at rtol
# 1e-11, with 4 by 1e-12; fixed steps of the phase angle would need to be twice as many.
_SMOOTH = 4

# From this damping c on a way out is taken to be stiff.
_CREEPS = 100.0


class State(NamedTuple):
    """Where the motion is: x = w^k, the momentum u, the time t; or their rates. Scalars in a lane.

    `loss` is the energy that damping has taken so far; None where u tells it or nobody asks.
    """

    w: Number
    u: Number
    t: Number
    loss: Number | None = None


class Motion(eqx.Module):
    """One lane of an impact: a form, an exponent and a scaled external force Γ (None for none).

    `smooth`: whether derivatives by a traced n shall be as smooth as the values: they have
    logarithms of w at touch, of which the step control knows nothing. `peak`: whether damping
    refers to the largest closing speed since touch, instead of that at touch. `prepared`: what
    `ready` computed once for the whole lane.
    """

    form: AbstractForm
    exponent: Specialised
    push: Number | None
    smooth: bool = eqx.field(static=True, default=False)
    peak: bool = eqx.field(static=True, default=False)
    prepared: Number | None = None

    def ready(self) -> Motion:
        """The same with what the lane needs at every stage of every step computed beforehand."""
        if self.momentum is not None:
            return dataclasses.replace(self, prepared=self.momentum.at_touch())
        softness = self.softness
        return self if softness is None else dataclasses.replace(self, prepared=softness[0])

    def momentum_at_touch(self) -> Number:
        """The u at touch, of forms that have a momentum of their own."""
        assert self.momentum is not None
        return self.momentum.at_touch() if self.prepared is None else self.prepared

    @property
    def n(self) -> Exponent:
        """The exponent, a float where it is concrete."""
        return self.exponent.value

    @property
    def order(self) -> int:
        """The k of x = w^k."""
        known = self.form.damping(self.n, jnp.asarray(True)) is not None
        if self.smooth and not isinstance(self.n, float) and known and self.momentum is None:
            return _SMOOTH
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

        zero = of_lane(0.0)
        if self.momentum is not None:
            return State(zero, of_lane(self.momentum_at_touch()), zero)
        return State(zero, of_lane(1.0 + self.creep(zero)), zero, zero)

    @property
    def softness(self) -> tuple[Number, Exponent] | None:
        """The b and p of u = v + b x^p: 1/c with strong damping and 0 with weak; None for u = v.

        The damping is that of the way out: what is damped on approach only does not creep back.
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
        """b x^p, the speed at which bodies creep apart while their force is next to none."""
        if self.softness is None:
            return 0.0
        softness, p = self.softness
        return softness * signed_power(w, self.order * p)

    def velocity(self, state: State) -> Number:
        """x' at a state."""
        momentum = self.momentum
        return state.u - self.creep(state.w) if momentum is None else momentum.velocity(state.u)

    def still(self, state: State) -> State:
        """The state with the velocity 0."""
        rest = jnp.zeros_like(state.u)
        return state._replace(u=rest + self.creep(state.w) if self.momentum is None else rest)

    def pulling(self, state: State, compressing: Flag) -> Number:
        """A smooth function that is negative where the contact pulls: f/x^(n-p) if that is known.

        It has all its digits where u has them.
        """
        if self.softness is None:
            return self.form.pulling(state.w, self.velocity(state), self.n, compressing, self.order)
        softness, _ = self.softness
        damping = self.form.damping(self.n, compressing)
        assert damping is not None
        c, p = damping
        return c * state.u + jnp.where(softness > 0, 0, signed_power(state.w, self.order * p))

    def force(self, state: State, compressing: Flag) -> Number:
        """f at a state, for w ≥ 0."""
        if self.softness is not None:
            outer = signed_power(state.w, self.order * (self.n - self.softness[1]))
            return outer * self.pulling(state, compressing)
        x = signed_power(state.w, float(self.order))
        return self.form.force(x, self.velocity(state), self.n, compressing)

    def pull(self, state: State, compressing: Flag) -> Number:
        """w^(k-1) f at a state, where the form has no momentum of its own."""
        if self.softness is None:
            return self.form.pull(state.w, self.velocity(state), self.n, compressing, self.order)
        outer = signed_power(state.w, self.order * (self.n - self.softness[1] + 1) - 1)
        return outer * self.pulling(state, compressing)

    def rate(self, state: State, compressing: Flag) -> State:
        """d(w, u, t)/dτ."""
        w, k, n, momentum = state.w, self.order, self.n, self.momentum
        velocity = self.velocity(state)
        clock = signed_power(w, float(k - 1))
        if momentum is not None:
            return State(velocity / k, -momentum.pull(w), clock)
        change = -self.pull(state, compressing)
        if self.softness is not None:
            softness, p = self.softness
            if not (isinstance(p, float) and p == 0):
                change = change + softness * p * signed_power(w, k * p - 1) * velocity
        if self.push is not None:
            change = change + self.push * clock
        loss = None
        if state.loss is not None:
            loss = self.form.dissipation(w, velocity, n, compressing, k)
        return State(velocity / k, change, clock, loss)

    def later(self, state: State, time: Number, compressing: Flag) -> State:
        """The state a regularised `time` later, by one Runge-Kutta step."""
        return step(lambda s: self.rate(s, compressing), state, time)

    def stored(self, state: State) -> Number:
        """The elastic energy at a state."""
        return self.form.stored(state.w, self.n, self.order)

    def lost(self, state: State) -> Number:
        """The energy that damping has taken until a state."""
        if state.loss is not None:
            return state.loss
        assert self.momentum is not None
        return self.momentum.lost(self.momentum_at_touch(), state.u)

    def parting(self, state: State) -> State:
        """A state that is nearly apart: what a leg that is not needed starts from."""
        near = jnp.full_like(state.w, 1e-6)
        return state._replace(w=near, u=self.creep(near) - jnp.ones_like(state.u))

    def spare_energy(self, state: State) -> Number:
        """The energy ½v² - Γx that a state without contact force has at x = 0; negative where the
        push lets it not come so far. What settles counts with its elastic energy.
        """
        energy = jnp.square(self.velocity(state)) / 2
        if self.push is not None:
            energy = energy - self.push * jnp.maximum(state.w, 0) ** self.order
        return energy + jnp.where(self.settled(state), self.stored(state), 0)

    def held(self, state: State) -> Bool[Array, ""]:
        """Whether the push keeps the bodies together for good: too little energy is left to part.

        Damping can only decrease ½v² + ∫ f(x, 0) dx - Γx, which is positive at separation. A pull
        holds nothing, though rounding may put the end of a contact below x = 0.
        """
        if self.push is None:
            return jnp.asarray(False)
        kinetic = jnp.square(self.velocity(state)) / 2
        # Energies that agree to this may differ by the errors of the solve alone.
        doubt = math.sqrt(jnp.finfo(state.w.dtype).eps)
        work = self.push * state.w**self.order
        return (self.push > 0) & (kinetic + self.stored(state) < work * (1 - doubt))

    def creeping_speed(self, state: State) -> Number:
        """x^p/c, at which bodies creep apart: of forms whose damping is known."""
        c, p = self.damping_back()
        return signed_power(state.w, self.order * p) / jnp.maximum(c, 1)

    def stiffness(self, state: State) -> Number:
        """The rate at which a way out relaxes to creeping, or swings, in regularised time."""
        c, p = self.damping_back()
        n, k = self.n, self.order
        return c * signed_power(state.w, k * (n - p + 1) - 1) + signed_power(
            state.w, k * (n + 1) / 2 - 1
        )

    def damping_back(self) -> tuple[Number, Exponent]:
        """The c and p of the way out, of forms whose damping is known."""
        damping = self.form.damping(self.n, jnp.asarray(False))
        assert damping is not None
        return damping

    @property
    def may_creep(self) -> bool:
        """Whether the way out may be too stiff for explicit steps."""
        known = self.form.damping(self.n, jnp.asarray(False)) is not None
        return known and (self.push is not None or self.form.creeps_free)

    def creeps(self) -> Bool[Array, ""]:
        """Whether the way out, if any, is one of creeping for certain."""
        return self.damping_back()[0] > _CREEPS

    def creeps_to_rest(self, state: State) -> Bool[Array, ""]:
        """Whether bodies that close up creep to rest under a push and never turn.

        With y = x_s - x, x_s^n = Γ, no motion crosses v = λy upwards before y = 0 if
        λ² - c x^(n-p) λ + n x_s^(n-1) ≤ 0 from here on: they creep if v ≤ λy for the largest λ.
        """
        static, damping = self.static_indentation(), self.form.damping(self.n, jnp.asarray(True))
        if self.push is None or static is None or damping is None:
            return jnp.asarray(False)
        (c, p), n, k = damping, self.n, self.order
        rate = c * signed_power(jnp.maximum(state.w, 0), k * (n - p))
        excess = jnp.square(rate) - 4 * n * power(static, n - 1)
        fastest = (rate + jnp.sqrt(jnp.maximum(excess, 0))) / 2
        left = static - state.w**k
        slow = self.velocity(state) <= fastest * left
        return (self.push > 0) & (excess > 0) & (left > 0) & slow

    def smallness(self) -> tuple[Number | float, Number | float]:
        """How small what ends the motion is beside the forces, and beside the speed of the impact.

        Both are 1 unless damping is strong: a creeping contact without tension ends where forces
        cancel that differ by little on all of its way; before the turn little speed is left.
        """
        form = self.form
        clamped = not (form.tension or form.never_pulls)
        ending = form.creeping_excess(self.n) if clamped else 1.0
        # What the coordinate of strong damping has at touch is small on all of the way.
        momentum = self.momentum
        speed = form.creeping_speed(self.n) if momentum is None else self.momentum_at_touch()
        if self.order == 1 and form.tension and momentum is None:
            # Where no power of w stretches it, a slow way out ends as small as its e.
            tiny = math.sqrt(jnp.finfo(jax.tree.leaves(self)[0].dtype).tiny)
            if self.always_parts:
                speed = tiny
            elif self.push is not None:
                speed = jnp.where(self.push < 0, tiny, speed)
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
    def may_pull(self) -> bool:
        """Whether the force of the contact may become negative."""
        return self.form.may_pull(self.push is not None)

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

    def gaps(self, state: State, compressing: Flag) -> tuple[Number, ...]:
        """What falls through zero where a leg ends: at a turn, and where the bodies part.

        The first one starts a way out at zero.
        """
        velocity = self.velocity(state)
        back = jnp.ones_like(velocity) if self.one_way else -velocity
        apart = (jnp.where(compressing, 1, gap) for gap in self._gaps_apart(state))
        return jnp.where(compressing, velocity, back), *apart

    @property
    def may_dip(self) -> bool:
        """Whether a force that ends a contact where it vanishes might come back, under a push."""
        return self.push is not None and not (self.form.tension or self.form.never_pulls)

    @property
    def may_return(self) -> bool:
        """Whether a force that vanished before x = 0 may come back on the way there.

        A force x^(n-p) (x^p + c v) does so only under a push, other forces also without one.
        """
        if self.form.tension or self.form.never_pulls:
            return False
        return self.push is not None or self.form.damping(self.n, jnp.asarray(False)) is None

    @property
    def may_clamp(self) -> bool:
        """Whether the law may clamp its own force to zero."""
        return self.form.may_clamp

    def continued(self, inside: State) -> Motion:
        """The motion under a force that a clamp does not end, from a state `inside` the contact."""
        form = self.form.continued(inside.w**self.order, self.velocity(inside))
        return dataclasses.replace(self, form=form)

    def parts_at_touch(self) -> Bool[Array, ""]:
        """Whether the bodies, if at all, part at x = 0.

        So does what never pulls, under a push too: where its force vanished that would press.
        """
        if self.form.tension or self.one_way:
            return jnp.asarray(True)
        if self.push is None or not self.form.never_pulls:
            return jnp.asarray(False)
        return self.push > 0

    def _gaps_apart(self, state: State) -> tuple[Number, ...]:
        """Positive until the contact is over: at x = 0, or where a force that may not pull is 0."""
        if self.form.tension or self.one_way:
            return (state.w,)
        pulling = self.gap_of_force(state)
        # Where the force of what never pulls vanished only rounding can get.
        return state.w, jnp.where(self.parts_at_touch(), 1, pulling)

    def gap_of_force(self, state: State) -> Number:
        """What vanishes with the force, with a slope, and stays negative beyond x = 0."""
        velocity = self.velocity(state)
        if self.softness is None:
            out = jnp.asarray(False)
            pulling = self.form.pulling(state.w, velocity, self.n, out, self.order)
            # A force that is clamped to zero vanished before: its gap has a sign, if no slope.
            pulling = jnp.where(pulling == 0, -1, pulling) if self.may_clamp else pulling
            return jnp.where(state.w < 0, jnp.minimum(pulling, state.w), pulling)
        softness, p = self.softness
        c, _ = self.damping_back()
        if isinstance(p, float) and p == 0:
            gap = jnp.where(softness > 0, state.u, 1 + c * velocity)
            # Beyond x = 0 time may run back, and the gap open again. Whether it had closed shows
            # only before: here it counts as closed, and not sooner than x = 0.
            return jnp.where(state.w < 0, state.w + jnp.minimum(gap, 0), gap)
        strong = jnp.where(state.w < 0, jnp.minimum(state.u, velocity), state.u)
        # Where weak damping ends a contact, x^p is flat.
        weak = state.w - power(-c * velocity, 1 / (self.order * p))
        return jnp.where(softness > 0, strong, weak)

    def settled(self, state: State) -> Bool[Array, ""]:
        """Whether a way out ended because the contact turned inwards again."""
        if self.one_way:
            return jnp.asarray(False)
        velocity = self.velocity(state)
        if self.always_parts and self.form.tension:
            # A slow way out ends at a speed below the rounding of w, but is then slowed no more:
            # it would turn sooner than part.
            slowing = jnp.abs(self.rate(state, jnp.asarray(False)).u)
            sooner = jnp.square(velocity) < self.order * state.w * slowing
            return (velocity >= 0) | sooner
        apart = functools.reduce(jnp.minimum, self._gaps_apart(state))
        inwards = -velocity < apart
        # A pull turns nothing inwards: there both are zero but for rounding.
        return inwards if self.push is None else inwards & (self.push > 0)
