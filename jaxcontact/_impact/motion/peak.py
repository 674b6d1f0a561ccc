"""The largest and the least force of a leg, including between its steps; what is recorded of it."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from ..._functions import bracketed_root, ratio
from ..._solver import Moment, Packed, Record, chosen, in_time
from .coordinates import Number, State
from .ends import Dip, Way, creeps_to_rest, may_dip
from .equation import Motion


class Nearest(NamedTuple):
    """The moment of the largest force so far, and those before and after it, packed. `fresh`:
    whether the moment after it is still missing.
    """

    force: Number
    before: Record
    at: Record
    after: Record
    fresh: Bool[Array, ""]

    def seen(self, last: Record, now: Record, force: Number) -> Nearest:
        """Return the record with the moment `now`, which follows `last`."""
        larger = force > self.force
        return Nearest(
            force=jnp.where(larger, force, self.force),
            before=chosen(larger, last, self.before),
            at=chosen(larger, now, self.at),
            after=chosen(larger | self.fresh, now, self.after),
            fresh=larger,
        )


class Watch(NamedTuple):
    """The largest and the least force; whether the bodies creep to rest; a dip of the force.
    `least` has -F as its force, and is None if the contact cannot pull. `creeps` and `dip` are None
    without a push or if the force cannot vanish.
    """

    nearest: Nearest
    least: Nearest | None
    creeps: Bool[Array, ""] | None
    dip: Dip | None

    @staticmethod
    def begin(motion: Motion, packed: Packed[State]) -> Watch:
        """Return an empty record of a motion."""
        start, zero = packed.start, packed.tau(packed.start)
        no = jnp.isnan(zero)
        nearest = Nearest(jnp.full_like(zero, -jnp.inf), start, start, start, no)
        return Watch(
            nearest=nearest,
            least=nearest if motion.may_pull else None,
            creeps=None if motion.push is None else no,
            dip=Dip.begin(start, zero) if may_dip(motion) else None,
        )

    def seen(self, way: Way, packed: Packed[State], last: Record, now: Record) -> Watch:
        """Return the record with the accepted moment `now`, which follows `last`."""
        frozen, state = jax.lax.stop_gradient((way.motion, packed.state(now)))
        creeps, dip = self.creeps, self.dip
        if creeps is not None:
            creeps = creeps | creeps_to_rest(frozen, state)
        if dip is not None:
            dip = dip.seen(frozen, packed, last, now)
        force = frozen.force(state, way.compressing)
        least = self.least
        if least is not None:
            # Rounding may put the end below w = 0, where there is no force.
            inside = state._replace(w=jnp.maximum(state.w, 0))
            least = least.seen(last, now, -frozen.force(inside, way.compressing))
        return Watch(self.nearest.seen(last, now, force), least, creeps, dip)


def largest_force(way: Way, moments: Moment[State], sign: int = 1) -> Number:
    """Return the largest force at and between consecutive moments; of -F if `sign` is -1."""
    moments = Moment(moments.tau, moments.state._replace(loss=None))
    forces = jax.vmap(lambda state: sign * way.motion.force(state, way.compressing))(moments.state)
    best = jnp.argmax(jax.lax.stop_gradient(forces))
    packed = Packed.of(jax.tree.map(lambda leaf: leaf[0], moments.state))
    near = jnp.clip(best + jnp.arange(-1, 2), 0, moments.tau.size - 1)
    near = jax.tree.map(lambda leaf: leaf[near], moments)
    before, at, after = jax.vmap(packed.record)(near)
    return largest_near(way, packed, Nearest(forces[best], before, at, after, best < 0), sign)


def largest_near(way: Way, packed: Packed[State], near: Nearest, sign: int = 1) -> Number:
    """Return the largest force near the best of three neighbouring states; of -F if `sign` is -1.

    It is as accurate as a step. The step that contains the maximum is repeated with one Runge-Kutta
    step of a fraction θ at which the force is stationary. A stationary value does not depend on θ
    to first order, so θ is a constant to the derivative.
    """
    frozen, fixed = jax.lax.stop_gradient((way, near))
    step = packed.step(in_time)

    def slope(vector: Record) -> Number:
        return _steepness(frozen.motion, packed.state(vector), frozen.compressing, sign)

    def force(vector: Record) -> Number:
        return sign * way.motion.force(packed.state(vector), way.compressing)

    slopes = packed.each(slope, fixed.before, fixed.at, fixed.after)
    # From the best state to the next one, or from the previous one to it.
    rising = slopes[1] > 0
    left = chosen(rising, fixed.at, fixed.before)
    size = packed.tau(chosen(rising, fixed.after, fixed.at)) - packed.tau(left)
    first, last = (jnp.where(rising, slopes[k + 1], slopes[k]) for k in (0, 1))

    def later(fraction: Number) -> Number:
        return slope(step(frozen, left, fraction * size)[0])

    # Without a sign change the maximum is at an end: at touch, for a law whose force jumps there.
    inside = (first > 0) & (last < 0)
    first, last = jnp.where(inside, first, 0), jnp.where(inside, last, -1)
    theta = jnp.where(inside, bracketed_root(later, first, last, iterations=100), 0)
    start = chosen(rising, near.at, near.before)
    between, _ = step(way, start, theta * size)
    return jnp.maximum(*packed.each(force, between, near.at))


def _steepness(motion: Motion, state: State, compressing: Bool[Array, ""], sign: int = 1) -> Number:
    """Return w dF/dτ relative to F dw/dτ along the motion, in [-1, 1], with the sign of dF/dτ. It
    is positive at touch, where a force that is a power of x has no slope. It is bounded, because
    regula falsi is slow if one end is much steeper than the other.
    """
    rate = motion.rate(state, compressing)
    force, change = jax.jvp(lambda s: sign * motion.force(s, compressing), (state,), (rate,))
    pushing = (state.w > 0) & (force > 0)
    # Rounding may put the end of a contact below w = 0.
    alone = jnp.where((force == 0) | (state.w < 0), rate.w, change)
    slope = jnp.where(pushing, state.w * change, alone)
    speed = jnp.abs(rate.w) * jnp.where(pushing, force, 1)
    return ratio(slope, jnp.abs(slope) + speed)


def is_rising(motion: Motion, state: State, compressing: Bool[Array, ""]) -> Bool[Array, ""]:
    """Return whether the force rises with x by more than the nearly constant force of creep."""
    return _steepness(motion, state, compressing) > 0.01
