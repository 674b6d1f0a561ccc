"""The scaled equation of motion in regularised coordinates.

The state is (w, u, t) with `x = w^k`, the time t, and a momentum u. u is usually the velocity v. In
a free impact it may be a coordinate of the form instead. If strong damping c makes the bodies
creep, it is `u = v + x^p/c`. This is the force over c x^(n-p), which keeps its digits while v and
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

from ..._entry import Specialised, static_value
from ..._forms import AbstractForm, Exponent, Flag, Momentum, signed_power
from ..._functions import power
from ..._solver.runge_kutta import step

Number = Float[Array, ""]

# In units of the impact's energy: a contact whose damping takes more certainly stays, with a safety
# margin.
_STAYS = 100.0

# The k of a traced exponent. With k = 2, derivatives by n were off by 1e-8 of the outcome at rtol
# 1e-11, with 4 by 1e-12. The phase method would need twice as many steps.
_SMOOTH = 4

# From this damping c on, a way out is treated as stiff.
_CREEPS = 100.0


class State(NamedTuple):
    """The state of one lane: x = w^k, the momentum u, the time t; or their rates. `loss` is the
    energy taken by damping so far; None if u determines it or it is not needed.
    """

    w: Number
    u: Number
    t: Number
    loss: Number | None = None


class Motion(eqx.Module):
    """One lane of an impact: a form, an exponent and a scaled external force Γ, or None.

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

    def ready(self) -> Motion:
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

    @property
    def adheres(self) -> bool:
        """True if bodies may stick without a push."""
        return self.form.barrier(jnp.zeros(())) is not None

    @property
    def one_way(self) -> bool:
        """True if bodies that move apart certainly separate at x = 0."""
        return self.push is None and self.form.never_pulls

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

    def after_turn(self, turn: State) -> tuple[Motion, State]:
        """Return the motion after the turn, and the state there. From then on a contact with a
        memory unloads, and the energy that it does not return is lost.
        """
        turn = self.still(turn)
        if not self.form.remembers or turn.loss is None:
            return self, turn
        deepest = self.indentation(turn.w)
        kept = self.form.kept(deepest)
        return self.remembering(deepest), turn._replace(loss=turn.loss + kept)

    def remembering(self, deepest: Number) -> Motion:
        """Return the motion after a turn at the indentation `deepest`."""
        return dataclasses.replace(self, form=self.form.remembering(deepest))

    def parting(self, state: State) -> State:
        """Return a state just before separation, as the start of a leg that is not needed."""
        near = jnp.full_like(state.w, 1e-6)
        return state._replace(w=near, u=self.creep(near) - jnp.ones_like(state.u))

    def energy(self, state: State) -> Number:
        """Return ½v² + ∫ f(x, 0) dx - Γx, which is conserved without damping."""
        energy = jnp.square(self.velocity(state)) / 2 + self.stored(state)
        return energy if self.push is None else energy - self.push * self.indentation(state.w)

    def spare_energy(self, state: State) -> Number:
        """Return the energy ½v² - Γx that a state without contact force has at x = 0. It is
        negative if the push prevents the bodies from reaching x = 0. A settled contact also counts
        its elastic energy.
        """
        energy = jnp.square(self.velocity(state)) / 2
        if self.push is not None:
            energy = energy - self.push * self.indentation(jnp.maximum(state.w, 0))
        return energy + jnp.where(self.settled(state), self.stored(state), 0)

    def held(self, state: State) -> Bool[Array, ""]:
        """Return whether too little energy is left to separate against the push. Damping can only
        decrease ½v² + ∫ f(x, 0) dx - Γx, which is positive at separation. A pull holds nothing,
        although rounding may put the end of a contact below x = 0.
        """
        # Smaller differences may be errors of the solve.
        doubt = math.sqrt(jnp.finfo(state.w.dtype).eps)
        push = jnp.zeros_like(state.w) if self.push is None else self.push
        barrier = self.form.barrier(push)
        if barrier is not None:
            allowed = doubt * (jnp.abs(barrier) + self.stored(state))
            return self.energy(state) < barrier - allowed
        if self.push is None:
            return jnp.asarray(False)
        kinetic = jnp.square(self.velocity(state)) / 2
        work = self.push * self.indentation(state.w)
        return (self.push > 0) & (kinetic + self.stored(state) < work * (1 - doubt))

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

    def damping_back(self) -> tuple[Number, Exponent]:
        """Return the c and p of the way out, for forms whose damping is known."""
        damping = self.form.damping(self.n, jnp.asarray(False))
        assert damping is not None
        return damping

    @property
    def may_creep(self) -> bool:
        """True if the way out may be too stiff for explicit steps."""
        known = self.form.damping(self.n, jnp.asarray(False)) is not None
        return known and (self.push is not None or self.form.creeps_free)

    def creeps(self) -> Bool[Array, ""]:
        """Return whether the way out, if any, certainly creeps."""
        return self.damping_back()[0] > _CREEPS

    def creeps_to_rest(self, state: State) -> Bool[Array, ""]:
        """Return whether closing bodies creep to rest under a push and never turn. Let y = x_s - x,
        x_s^n = Γ. If λ² - c x^(n-p) λ + n x_s^(n-1) ≤ 0 from here on, no motion crosses v = λy
        upwards before y = 0. The bodies creep if v ≤ λy for the largest such λ.
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
        """Return the relative size of the terms that end the motion, in the forces and the speed.
        Both are 1 unless damping is strong. A creeping contact without tension ends where forces
        cancel that differ little all the way. Before the turn little speed is left.
        """
        form, ending = self.form, 1.0
        # With strong damping the coordinate is small at touch and on all of the way.
        momentum = self.momentum
        speed = form.creeping_speed(self.n) if momentum is None else self.momentum_at_touch()
        if form.tension:
            # For k = 1 a slow way out ends at a speed as small as e.
            tiny = math.sqrt(jnp.finfo(jax.tree.leaves(self)[0].dtype).tiny)
            if self.order == 1 and momentum is None:
                if self.always_parts:
                    speed = tiny
                elif self.push is not None:
                    speed = jnp.where(self.push < 0, tiny, speed)
        elif not form.never_pulls:
            ending = form.creeping_excess(self.n)
        elif self.push is not None:
            # Under a weak pull the force falls to the size of the pull before it vanishes.
            speed = speed * jnp.where(self.push < 0, jnp.clip(-self.push, 1e-12, 1), 1)
        return self._fastest() * ending, speed

    def _fastest(self) -> Number | float:
        """Return the speed of the impact over the largest speed, which a strong push causes.
        Without it, the errors of the fast motion would be large compared with the slow end of a
        contact.
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
        """True if the contact force may become negative."""
        return self.form.may_pull(self.push is not None)

    @property
    def always_parts(self) -> bool:
        """True if the contact eventually separates, however slowly: nothing pushes or sticks."""
        return self.push is None and self.form.damping(self.n, jnp.asarray(True)) is not None

    def creeps_back(self) -> Bool[Array, ""]:
        """Return whether the bodies of a free contact creep apart forever."""
        return self.form.creeps_back(self.n)

    def static_indentation(self) -> Number | None:
        """Return the x at rest under the push; None without a push or if it is unknown."""
        if self.push is None:
            return None
        # A pull has no rest position; any positive number keeps its lane finite.
        return self.form.static_indentation(jnp.where(self.push > 0, self.push, 1), self.n)

    def gaps(self, state: State, compressing: Flag) -> tuple[Number, ...]:
        """Return the functions that fall through zero at the end of a leg. The first one is the
        speed, for the turn; it is zero at the start of a way out. The others are for separation.
        """
        velocity = self.velocity(state)
        back = jnp.ones_like(velocity) if self.one_way else -velocity
        apart = (jnp.where(compressing, 1, gap) for gap in self._gaps_apart(state))
        return jnp.where(compressing, velocity, back), *apart

    @property
    def may_dip(self) -> bool:
        """True if a force that ends a contact when it vanishes might return, under a push."""
        return self.push is not None and not (self.form.tension or self.form.never_pulls)

    @property
    def may_return(self) -> bool:
        """True if a force that vanished before x = 0 may return on the way there. A force x^(n-p)
        (x^p + c v) does so only under a push; other forces may also do so without one.
        """
        if self.form.tension or self.form.never_pulls:
            return False
        return self.push is not None or self.form.damping(self.n, jnp.asarray(False)) is None

    @property
    def may_clamp(self) -> bool:
        """True if the law may clamp its own force to zero."""
        return self.form.may_clamp

    def continued(self, inside: State) -> Motion:
        """Return the motion under the unclamped force, from a state `inside` the contact."""
        form = self.form.continued(inside.w**self.order, self.velocity(inside))
        return dataclasses.replace(self, form=form)

    @property
    def ends_smoothly(self) -> bool:
        """False for a general force that may vanish before x = 0: its gap has a corner there."""
        return self.form.tension or self.one_way or self.softness is not None

    def parts_at_touch(self) -> Bool[Array, ""]:
        """Return whether the bodies can only separate at x = 0. Bodies whose force never pulls also
        do so under a push: without contact force the push would press them together.
        """
        if self.form.tension or self.one_way:
            return jnp.asarray(True)
        if self.push is None or not self.form.never_pulls:
            return jnp.asarray(False)
        return self.push > 0

    def _gaps_apart(self, state: State) -> tuple[Number, ...]:
        """Return gaps that are positive until the contact ends: x, and a force without tension."""
        if self.form.tension or self.one_way:
            return (state.w,)
        pulling = self.gap_of_force(state)
        # Only rounding can make a force that never pulls vanish before x = 0 under a push.
        return state.w, jnp.where(self.parts_at_touch(), 1, pulling)

    def gap_of_force(self, state: State) -> Number:
        """Return a quantity that vanishes with the force, with a slope; negative beyond x = 0."""
        velocity = self.velocity(state)
        if self.softness is None:
            out = jnp.asarray(False)
            pulling = self.form.pulling(state.w, velocity, self.n, out, self.order)
            # A force clamped to zero has vanished already: its gap has a sign but no slope.
            pulling = jnp.where(pulling == 0, -1, pulling) if self.may_clamp else pulling
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

    def settled(self, state: State) -> Bool[Array, ""]:
        """Return whether a way out ended because the contact turned inwards again."""
        if self.one_way:
            return jnp.asarray(False)
        velocity = self.velocity(state)
        if self.always_parts and self.form.tension:
            # A slow way out may end at a speed below the rounding of w, but is no longer slowed. If
            # it is slowed enough to turn before it separates, it has settled.
            slowing = jnp.abs(self.rate(state, jnp.asarray(False)).u)
            sooner = jnp.square(velocity) < self.order * state.w * slowing
            return (velocity >= 0) | sooner
        apart = functools.reduce(jnp.minimum, self._gaps_apart(state))
        inwards = -velocity < apart
        if self.push is None or self.adheres:
            return inwards
        # A pull turns nothing inwards: then both are zero up to rounding.
        return inwards & (self.push > 0)
