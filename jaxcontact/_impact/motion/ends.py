"""The end of a contact: the gaps that close there, and the verdict on an end that was found.

A way in ends at the turn; a way out at x = 0, or before it, where a force without tension vanishes.
Bodies may also stay: they turn inwards again, creep, or have too little energy to separate.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import operator
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..._entry import static_value
from ..._forms import Flag, signed_power
from ..._functions import bracketed_root, power
from ..._solver import Flags, Packed, Record, chosen, in_time
from .coordinates import Number, State
from .equation import Motion
from .errors import (
    Balance,
    balance_of,
    end_is_sharp,
    force_is_sharp,
    is_spent,
    turn_is_sharp,
)

# The share of a force that its tangent predicts where it vanished. A force that is a power p of the
# time to the end leaves 1-p.
_JUMP = 0.9
# The number of rounds in which place and speed of an end are computed from each other. With x^p = c
# v and v² = E + 2Γx an error of v shrinks by the factor Γx/(p v²) < 1/(2p), p ≥ 1.
_ROUNDS = 3
# The number of moments at which the force is sampled, the last but one at 1e-6 of the depth. A
# force present only between two of them, or returning later, is missed.
_SAMPLES = 32


class Verdict(NamedTuple):
    """How a contact ends; a flag is None if it cannot hold.

    - `arrived`: the motion was followed to its end, and its energies balance.
    - `settled`: the way out ended because the bodies turned inwards again.
    - `creeps`: the bodies certainly creep: to rest without a turn, or apart for ever.
    - `held`: too little energy is left to separate, whatever became of the way out.
    - `sharp`: the outcome is not decided by rounding.
    """

    arrived: Bool[Array, ""]
    settled: Bool[Array, ""] | None = None
    creeps: Bool[Array, ""] | None = None
    held: Bool[Array, ""] | None = None
    sharp: Bool[Array, ""] | None = None

    @property
    def stays(self) -> Bool[Array, ""]:
        """True if the bodies stay together."""
        return _any_of(self.settled, self.held, self.creeps)

    @property
    def known(self) -> Bool[Array, ""]:
        """True if the outcome is known. A contact that creeps needs no way out to be followed."""
        ended = _any_of(self.arrived, self.held)
        return _any_of(ended if self.sharp is None else ended & self.sharp, self.creeps)


def _any_of(*flags: Flag | None) -> Flag:
    return functools.reduce(operator.or_, (flag for flag in flags if flag is not None))


class Followed(NamedTuple):
    """The ends of both ways, whether events ended them, and the number of steps. `creeps`: whether
    the bodies creep to rest without a turn.
    """

    turn: State
    end: State
    arrived: Bool[Array, "2"]
    creeps: Bool[Array, ""]
    steps: Int[Array, ""]


def verdict_of(
    motion: Motion, followed: Followed, balance: Balance, deepest: Number, rtol: float
) -> Verdict:
    """Return the verdict on an impact, with the turn as the start of its way out."""
    turn, end = followed.turn, followed.end
    arrived, settled = on_way_out(motion, followed.arrived, end, balance, deepest, rtol)
    if motion.always_parts:
        # Only creep forever keeps these bodies together.
        return Verdict(arrived, creeps=motion.form.creeps_back(motion.n) & followed.arrived[0])
    if motion.push is None:
        return Verdict(arrived, settled)
    # A contact with too little energy to separate stays, regardless of its way out.
    sound = balance_of(motion, turn, deepest).closes(rtol)
    held = followed.arrived[0] & sound & (is_held(motion, turn) | is_held(motion, end))
    spent = is_spent(motion, end, rtol)
    if motion.form.remembers or motion.adheres:
        # Such a contact also stays if its remaining energy is elastic.
        spent = spent | held
    sharp = jnp.where(settled | held, spent, end_is_sharp(motion, turn, end, rtol))
    if motion.form.remembers:
        sharp = sharp & (settled | held | force_is_sharp(motion, end, rtol))
    sharp = sharp & turn_is_sharp(motion, turn, rtol)
    return Verdict(arrived, settled, followed.creeps, held, sharp)


def on_way_out(
    motion: Motion,
    arrived: Bool[Array, "2"],
    end: State,
    balance: Balance,
    deepest: Number,
    rtol: float,
) -> tuple[Bool[Array, ""], Bool[Array, ""]]:
    """Return whether both ways were followed to their ends, with their energies, and whether the
    bodies then turned inwards.
    """
    good, settled = jnp.all(arrived) & balance.closes(rtol), has_settled(motion, end)
    if motion.always_parts:
        # Bodies that must separate turn because of rounding. Those that creep forever have no end.
        good = good & ~settled & ~motion.form.creeps_back(motion.n)
    if may_return(motion):
        # A force that returns afterwards has no leg left.
        returns, _ = onward(motion, end, deepest)
        good = good & (settled | ~returns)
    return good, settled


def gaps(motion: Motion, state: State, compressing: Flag) -> tuple[Number, ...]:
    """Return the functions that fall through zero at the end of a leg. The first one is the speed,
    for the turn; it is zero at the start of a way out. The others are for separation.
    """
    velocity = motion.velocity(state)
    back = jnp.ones_like(velocity) if motion.one_way else -velocity
    apart = (jnp.where(compressing, 1, gap) for gap in _gaps_apart(motion, state))
    return jnp.where(compressing, velocity, back), *apart


def _gaps_apart(motion: Motion, state: State) -> tuple[Number, ...]:
    """Return gaps that are positive until the contact ends: x, and a force without tension."""
    if motion.form.tension or motion.one_way:
        return (state.w,)
    pulling = motion.gap_of_force(state)
    # Only rounding can make a force that never pulls vanish before x = 0 under a push.
    return state.w, jnp.where(parts_at_touch(motion), 1, pulling)


def parts_at_touch(motion: Motion) -> Bool[Array, ""]:
    """Return whether the bodies can only separate at x = 0, or that of the neck or plastic contact.
    Bodies whose force never pulls also do so under a push: without contact force the push would
    press them together.
    """
    if motion.form.tension or motion.one_way:
        return jnp.asarray(True)
    if motion.push is None or not motion.form.never_pulls:
        return jnp.asarray(False)
    return motion.push >= 0


def has_settled(motion: Motion, state: State) -> Bool[Array, ""]:
    """Return whether a way out ended because the contact turned inwards again."""
    if motion.one_way:
        return jnp.asarray(False)
    velocity = motion.velocity(state)
    if motion.always_parts and motion.form.tension:
        # A slow way out may end at a speed below the rounding of w, but is no longer slowed. If it
        # is slowed enough to turn before it separates, it has settled.
        slowing = jnp.abs(motion.rate(state, jnp.asarray(False)).u)
        sooner = jnp.square(velocity) < motion.order * state.w * slowing
        return (velocity >= 0) | sooner
    apart = functools.reduce(jnp.minimum, _gaps_apart(motion, state))
    inwards = -velocity < apart
    if motion.push is None or motion.adheres:
        return inwards
    # A pull turns nothing inwards: then both are zero up to rounding.
    return inwards & (motion.push > 0)


def is_held(motion: Motion, state: State) -> Bool[Array, ""]:
    """Return whether too little energy is left to separate against the push. Damping can only
    decrease ½v² + ∫ f(x, 0) dx - Γx, which is positive at separation. A pull holds nothing,
    although rounding may put the end of a contact below x = 0.
    """
    # Smaller differences may be errors of the solve.
    doubt = math.sqrt(jnp.finfo(state.w.dtype).eps)
    push = jnp.zeros_like(state.w) if motion.push is None else motion.push
    barrier = motion.form.barrier(push)
    if barrier is not None:
        allowed = doubt * (jnp.abs(barrier) + motion.stored(state))
        return motion.energy(state) < barrier - allowed
    if motion.push is None:
        return jnp.asarray(False)
    kinetic = jnp.square(motion.velocity(state)) / 2
    work = motion.push * motion.indentation(state.w)
    return (motion.push > 0) & (kinetic + motion.stored(state) < work * (1 - doubt))


def creeps_to_rest(motion: Motion, state: State) -> Bool[Array, ""]:
    """Return whether closing bodies creep to rest under a push and never turn. Let y = x_s - x,
    x_s^n = Γ. If λ² - c x^(n-p) λ + n x_s^(n-1) ≤ 0 from here on, no motion crosses v = λy upwards
    before y = 0. The bodies creep if v ≤ λy for the largest such λ.
    """
    static, damping = motion.static_indentation(), motion.form.damping(motion.n, jnp.asarray(True))
    if motion.push is None or static is None or damping is None:
        return jnp.asarray(False)
    (c, p), n, k = damping, motion.n, motion.order
    rate = c * signed_power(jnp.maximum(state.w, 0), k * (n - p))
    excess = jnp.square(rate) - 4 * n * power(static, n - 1)
    fastest = (rate + jnp.sqrt(jnp.maximum(excess, 0))) / 2
    left = static - state.w**k
    slow = motion.velocity(state) <= fastest * left
    return (motion.push > 0) & (excess > 0) & (left > 0) & slow


def spare_energy(motion: Motion, state: State) -> Number | None:
    """Return the energy ½v² - Γx that a state without contact force has at x = 0, or that of a neck
    above its snap; None without a push. It is negative if the push prevents the bodies from
    reaching it. A settled contact also counts its elastic energy.
    """
    if motion.push is None:
        return None
    if motion.form.ends_apart:
        end = state._replace(w=jnp.zeros_like(state.w))
        return motion.energy(state) - motion.energy(end._replace(u=end.w))
    energy = jnp.square(motion.velocity(state)) / 2
    energy = energy - motion.push * motion.indentation(jnp.maximum(state.w, 0))
    return energy + jnp.where(has_settled(motion, state), motion.stored(state), 0)


def at_end(motion: Motion, end: State, arrived: Bool[Array, ""], max_indentation: Number) -> State:
    """Return the end of a way out, computed from its own formulas. The search locates a moment
    within the rounding of a whole step. Place and speed may change within it by much more than
    their values at the end.
    """
    parted = arrived & (motion.velocity(end) < 0) & ~has_settled(motion, end)
    end = chosen(parted & parts_at_touch(motion), motion.touching(end), end)
    softness = motion.softness
    if motion.form.tension or motion.one_way or softness is None:
        return end
    strength, p = softness
    if motion.push is not None and static_value(p) != 0:
        # A weakly damped contact ends at x^p = -c v, with the speed from the energies. After a
        # strong push the speed has the rounding of a much larger one. The place inherits it, and
        # the work of the push over that place is a part of e.
        for _ in range(_ROUNDS):
            speed = balance_of(motion, end, max_indentation).restitution
            place = power(motion.damping_back()[0] * speed, 1 / (motion.order * p))
            end = end._replace(w=jnp.where(parted & (strength == 0), place, end.w))
    rate = motion.rate(end, jnp.asarray(False))
    sooner = jnp.abs(end.u * rate.w) < jnp.abs(end.w * rate.u)
    vanished = (strength > 0) & sooner & ~has_settled(motion, end)
    return end._replace(u=jnp.where(vanished, 0, end.u))


class Way(eqx.Module):
    """The motion of bodies: until they turn if `compressing`, else until they separate."""

    motion: Motion
    compressing: Flag

    def rate(self, state: State) -> State:
        """Return d(w, u, t)/dτ."""
        return self.motion.rate(state, self.compressing)

    def guards(self, state: State) -> tuple[Number, ...]:
        """Return the closing speed, or the separating speed with the gaps that end the contact."""
        return gaps(self.motion, state, self.compressing)

    @property
    def smooth(self) -> bool:
        """False for a general force that may vanish before x = 0: its gap has a corner there."""
        motion, form = self.motion, self.motion.form
        known = form.tension or form.remembers or motion.one_way
        return known or motion.softness is not None

    @property
    def clamped(self) -> bool:
        """True if the law may clamp its own force to zero."""
        return self.motion.form.may_clamp

    def continued(self, inside: State) -> Way:
        """Return the motion under the unclamped force, from a state `inside` the contact."""
        return dataclasses.replace(self, motion=self.motion.continued(inside))

    def jumps(self, inside: State, end: State, closed: Flags) -> Flag:
        """Return whether the force of a way out jumps to zero before x = 0. It does so only if no
        other guard closed, hence not at a turn.
        """
        before, after = map(self.motion.gap_of_force, (inside, end))
        left = (after >= _JUMP * before) & (2 * end.w > inside.w)
        return ~self.compressing & ~closed[0] & closed[-1] & left


def may_dip(motion: Motion) -> bool:
    """Return whether a force that ends a contact when it vanishes might return, under a push."""
    return motion.push is not None and not (motion.form.tension or motion.form.never_pulls)


class Dip(NamedTuple):
    """The step of a way out in which the force first had a minimum, if it was `found`.

    A force without tension ends the contact where it vanishes. Under a push the bodies may slow
    down so much that it soon becomes positive again. The step begins at `start`, has the given
    `size`, and has `slopes` at its ends. `gap` and `slope` are those of the force at the last
    state.
    """

    gap: Number
    slope: Number
    found: Bool[Array, ""]
    start: Record
    size: Number
    slopes: Float[Array, "2"]

    @staticmethod
    def begin(start: Record, zero: Number) -> Dip:
        """Return an empty record for a motion from `start` on."""
        return Dip(zero, zero, jnp.isnan(zero), start, zero, jnp.zeros(2, zero.dtype))

    def seen(self, motion: Motion, packed: Packed[State], last: Record, now: Record) -> Dip:
        """Return the record with the moment `now`, which follows `last`."""
        gap, slope = _gap(*jax.lax.stop_gradient((motion, packed.state(now))))
        turns = ~self.found & (self.slope < 0) & (slope > 0) & (self.gap > 0) & (gap > 0)
        size = jax.lax.stop_gradient(packed.tau(now) - packed.tau(last))
        return Dip(
            gap=gap,
            slope=slope,
            found=self.found | turns,
            start=chosen(turns, last, self.start),
            size=jnp.where(turns, size, self.size),
            slopes=jnp.where(turns, jnp.stack([self.slope, slope]), self.slopes),
        )

    def bottom(self, way: Way, packed: Packed[State]) -> tuple[Bool[Array, ""], Record]:
        """Return whether the force vanishes at its minimum, and that moment."""
        way, start = jax.lax.stop_gradient((way, self.start))
        size, step = jnp.where(self.found, self.size, 1), packed.step(in_time)

        def rise(fraction: Number) -> Number:
            there, _ = step(way, start, fraction * size)
            slope = _gap(way.motion, packed.state(there))[1]
            return jnp.where(self.found, -slope, 0.5 - fraction)

        ends = [jnp.where(self.found, -self.slopes[k], 0.5 - k) for k in (0, 1)]
        lowest = bracketed_root(rise, *ends, iterations=60) * size
        there, _ = step(way, start, lowest)
        closes = _gap(way.motion, packed.state(there))[0] <= 0
        return self.found & closes, there


def _gap(motion: Motion, state: State) -> tuple[Number, Number]:
    """Return a quantity that vanishes with the force, and its slope."""
    state = state._replace(loss=None)
    return jax.jvp(motion.gap_of_force, (state,), (motion.rate(state, jnp.asarray(False)),))


def may_return(motion: Motion) -> bool:
    """Return whether a force that vanished before x = 0 may return on the way there. A force
    x^(n-p) (x^p + c v) does so only under a push; other forces may also do so without one.
    """
    if motion.form.tension or motion.form.never_pulls:
        return False
    return motion.push is not None or motion.form.damping(motion.n, jnp.asarray(False)) is None


def onward(motion: Motion, end: State, deepest: Number) -> tuple[Bool[Array, ""], State]:
    """Return whether a force that vanished returns in the motion x'' = Γ without it, to x = 0, and
    the state then. The moment of return is a constant to the derivative. At zero force the motions
    with and without it agree to first order.
    """
    k = motion.order
    depth, speed = jnp.maximum(end.w, 0) ** k, -motion.velocity(end)
    pull = jnp.zeros_like(depth) if motion.push is None else motion.push
    square = jnp.square(speed) - 2 * pull * depth
    reaches = square >= 0
    root = jnp.sqrt(jnp.where(reaches, square, 0))
    # To x = 0, or until the bodies are at rest.
    landing = 2 * depth / jnp.where(speed + root > 0, speed + root, 1)
    longest = jnp.where(reaches, landing, speed / jnp.where(pull > 0, pull, 1))

    def at(motion: Motion, end: State, time: Number) -> State:
        depth, pull = end.w**k, 0 if motion.push is None else motion.push
        x = depth + (motion.velocity(end) + time * pull / 2) * time
        w = power(jnp.maximum(x, 0), 1 / k)
        freed = end._replace(w=w, u=motion.velocity(end) + time * pull + motion.creep(w))
        # Damping absorbs the work that the elastic force would have done.
        kept = None if end.loss is None else end.loss + motion.stored(end) - motion.stored(freed)
        return freed._replace(t=end.t + time, loss=kept)

    frozen, still, longest, deepest = jax.lax.stop_gradient((motion, end, longest, deepest))

    def force(fraction: Number) -> Number:
        return frozen.pulling(at(frozen, still, fraction * longest), jnp.asarray(False))

    passed = jnp.arange(_SAMPLES + 1, dtype=depth.dtype) / _SAMPLES
    # Samples are denser near x = 0, where a spring may exceed damping that falls faster. At x = 0
    # both vanish.
    fractions = jnp.where(reaches, 1 - (1 - passed) ** 4, passed)
    forces = jax.vmap(force)(fractions[1:])
    present = (forces > 0) & ~(reaches & (passed[1:] == 1))
    first = jnp.argmax(present)
    # An elastic contact has only rounding left at x = 0.
    rounding = math.sqrt(jnp.finfo(depth.dtype).eps)
    deep = (end.w > 0) & (still.w**k > rounding * deepest) & (speed > 0)
    returns = deep & jnp.any(present)
    low, size, last = fractions[first], fractions[first + 1] - fractions[first], forces[first]

    floor = jnp.where(returns, last / 100, 0.5)

    def missing(part: Number) -> Number:
        # Divided by the time passed, since the force is also zero at the beginning. A law that
        # clamps its own force has no sign before the return.
        fraction = low + part * size
        lacking = -force(fraction) / jnp.where(fraction > 0, fraction, 1)
        lacking = jnp.where(lacking >= 0, jnp.maximum(lacking, floor), lacking)
        return jnp.where(returns, lacking, 0.5 - part)

    part = bracketed_root(missing, floor, jnp.where(returns, -last, -0.5), iterations=60)
    return returns, at(motion, end, (low + part * size) * longest)
