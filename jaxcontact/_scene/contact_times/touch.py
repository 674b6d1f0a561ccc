"""The time at which two bodies touch: in closed form, or by steps that cannot pass the touch.

A time is the least τ ≥ 0 at which the gap vanishes while it shrinks; it is infinite if there is
none. Bodies that touch and approach meet now. Bodies that touch and recede do not meet by that
touch. A gap that is negative by rounding is a touch: it is neither found twice nor missed.

With a shaking body, let a gap g change at the rate g', with g'' ≥ -b. Then nothing is touched
before g + g' τ - ½ b τ² vanishes. b is the largest acceleration of the body plus gravity. Motion
around a sphere only widens the gap. Inside a shell the gap is one of squares, q = ρ² - |x|², with
q'' = -2 |x'|² - 2 x·x''. Nothing is touched, either, before the distance to the mean place is the
amplitude. Near a touch these steps are those of Newton's method.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..arrays.movers import CHECKED, Movers
from ..bodies.bodies import side

Lane = Float[Array, "..."]


def wall_time(gap: Lane, rate: Lane, acceleration: Lane, noise: Lane) -> Lane:
    """Return the time at which gap + rate τ + ½ acceleration τ² vanishes. At touch, a rate of at
    most `noise`, a few rounding errors of the speeds, counts as zero.
    """
    half = acceleration / 2
    still = (gap <= 0) & (jnp.abs(rate) <= noise)
    rate = jnp.where(still, 0, rate)
    square = jnp.square(rate) - 4 * half * gap
    touching = gap <= 0
    root = jnp.sqrt(jnp.maximum(square, 0))
    closing = rate < 0
    # The form c/(-b + √D) avoids cancellation for b < 0.
    meets = closing & ((square >= 0) | touching)
    first = 2 * gap / jnp.where(closing, root - rate, 1)
    falls = ~closing & (half < 0)
    back = (rate + root) / jnp.where(falls, -2 * half, 1)
    time = jnp.where(meets, first, jnp.where(falls, back, jnp.inf))
    return jnp.maximum(time, 0)


def sphere_time(
    apart: Lane, rate: Lane, distance: Lane, noise: Lane, *, shells: bool = True
) -> Lane:
    """Return the time until |apart + rate τ| shrinks to `distance`; vectors along the last axis. In
    a shell, with a negative `distance`, it is the time until the length grows to its magnitude.
    Without `shells` no distance is negative.
    """
    along = jnp.sum(apart * rate, axis=-1)
    square = jnp.sum(jnp.square(rate), axis=-1)
    length = jnp.sqrt(jnp.sum(jnp.square(apart), axis=-1))
    gap = length - distance
    touching = gap <= 0
    closing = along < jnp.where(touching, -noise * length, 0)
    safe = jnp.where(closing, square, 1)
    # The discriminant uses the nearest approach p: the test p² < d² loses no digits far away.
    nearest = apart - rate * (along / safe)[..., None]
    discriminant = safe * (jnp.square(distance) - jnp.sum(jnp.square(nearest), axis=-1))
    meets = closing & (touching | (discriminant > 0))
    root = jnp.sqrt(jnp.maximum(discriminant, 0))
    time = gap * (length + distance) / jnp.where(closing, root - along, 1)
    outside = jnp.where(meets, jnp.maximum(time, 0), jnp.inf)
    if not shells:
        return outside
    # Inside a shell a moving body always reaches the surface, at the later of the two roots.
    moves = square > 0
    room = jnp.maximum(-distance - length, 0) * (length - distance)
    root = jnp.sqrt(jnp.square(along) + square * room)
    late = jnp.where(along > 0, room / jnp.where(root > 0, along + root, 1), 0)
    early = (root - along) / jnp.where(moves, square, 1)
    leaves = jnp.where(along > 0, late, early)
    touching = length >= -distance
    leaves = jnp.where(touching & (along > -noise * length), 0, leaves)
    inside = jnp.where(moves & ~(touching & (along == 0)), leaves, jnp.inf)
    return jnp.where(distance < 0, inside, outside)


def curved_time(
    apart: Lane, rate: Lane, acceleration: Lane, distance: Lane, noise: Lane, horizon: Lane
) -> Lane:
    """Return `sphere_time` with a relative `acceleration`, up to `horizon`: a root of a quartic.

    The second derivative of |apart + rate τ + ½ acceleration τ²|² is a quadratic. Between its roots
    the first derivative is monotone. Between the roots of that, the function itself is. Every root
    is therefore bracketed, and the first one is found.
    """
    half = acceleration / 2
    length = jnp.sqrt(jnp.sum(jnp.square(apart), axis=-1))
    along = jnp.sum(apart * rate, axis=-1)
    sign = side(distance)
    touching = sign * length <= distance
    still = touching & (jnp.abs(along) <= noise * length)
    # Coefficients of the function and its derivatives, from the constant on.
    c0 = sign * (length - distance) * (length + distance)
    c1 = sign * 2 * jnp.where(still, 0, along)
    c2 = sign * (jnp.sum(jnp.square(rate), axis=-1) + 2 * jnp.sum(apart * half, axis=-1))
    c3 = sign * 2 * jnp.sum(rate * half, axis=-1)
    c4 = sign * jnp.sum(jnp.square(half), axis=-1)

    def value(t: Lane) -> Lane:
        return (((c4 * t + c3) * t + c2) * t + c1) * t + c0

    def slope(t: Lane) -> Lane:
        return ((4 * c4 * t + 3 * c3) * t + 2 * c2) * t + c1

    zero, end = jnp.zeros_like(c0), jnp.broadcast_to(horizon, c0.shape)
    # 12 c4 τ² + 6 c3 τ + 2 c2 = 0, by the root that does not cancel.
    root = jnp.sqrt(jnp.maximum(jnp.square(6 * c3) - 96 * c4 * c2, 0))
    q = -(6 * c3 + jnp.where(c3 >= 0, root, -root)) / 2
    first = q / jnp.where(c4 != 0, 12 * c4, 1)
    other = 2 * c2 / jnp.where(q != 0, q, 1)
    lower = jnp.clip(jnp.minimum(first, other), zero, end)
    upper = jnp.clip(jnp.maximum(first, other), zero, end)
    # All intervals are searched together, so that the search is in the program once.
    bends = jnp.stack([zero, lower, upper, end])
    turns = _crossing(jax.vmap(slope), bends[:-1], bends[1:])
    ends = jnp.concatenate([zero[None], turns, end[None]])
    heights = jax.vmap(value)(ends)
    falls = (heights[:-1] > 0) & (heights[1:] <= 0)
    roots = _crossing(jax.vmap(value), ends[:-1], ends[1:])
    time = jnp.min(jnp.where(falls, roots, jnp.inf), axis=0)
    starts = touching & ((c1 < 0) | ((c1 == 0) & (c2 < 0)))
    return jnp.where(starts, 0, time)


def _crossing(function: Callable[[Lane], Lane], low: Lane, high: Lane) -> Lane:
    """Return the sign change of a monotone function in [low, high] by bisection; `high` if none."""
    below = function(low) > 0
    changes = below != (function(high) > 0)

    def halve(_: int, ends: tuple[Lane, Lane]) -> tuple[Lane, Lane]:
        low, high = ends
        middle = (low + high) / 2
        left = (function(middle) > 0) == below
        return jnp.where(left, middle, low), jnp.where(left, high, middle)

    root = jax.lax.fori_loop(0, jnp.finfo(low.dtype).nmant + 12, halve, (low, high))[1]
    return jnp.where(changes, root, high)


def image_horizon(
    apart: Lane, rate: Lane, acceleration: Lane, distance: Lane, period: Lane
) -> Lane:
    """Return a time before which no other image along an axis of length `period` can be met.
    `apart` is the distance along the axis to the nearest image. Another image is met at the
    earliest after a displacement of period - |apart| - distance.
    """
    room = jnp.maximum(period - jnp.abs(apart) - distance, 0)
    speed, half = jnp.abs(rate), jnp.abs(acceleration) / 2
    below = speed + jnp.sqrt(jnp.square(speed) + 4 * half * room)
    return jnp.where(below > 0, 2 * room / jnp.where(below > 0, below, 1), jnp.inf)


_PARTS = 1e-6
"""The share of the largest acceleration above which that at a touch counts as non-zero."""

_AWAY = 64
"""The speed that separating bodies must have before the search continues, in rounding errors."""


class _Gap(NamedTuple):
    """A gap that vanishes at a touch, and its bounds. `room` is the gap, `slope` its rate, and
    `bend` the bound b on its curvature, which holds for a time `lasts`. `least` is a step that is
    safe in any direction.
    """

    room: Lane
    slope: Lane
    bend: Lane
    lasts: Lane | float
    least: Lane | float

    def step(self) -> Lane:
        """Return a duration in which nothing is touched."""
        room = jnp.maximum(self.room, 0)
        root = jnp.sqrt(jnp.square(self.slope) + 2 * self.bend * room)
        # This form avoids cancellation for closing gaps. It is infinite without curvature and
        # closing.
        closes, bends = self.slope < 0, self.bend > 0
        ahead = 2 * room / jnp.where(closes, root - self.slope, 1)
        away = (self.slope + root) / jnp.where(bends, self.bend, 1)
        safe = jnp.where(closes, ahead, jnp.where(bends, away, jnp.inf))
        return jnp.maximum(jnp.minimum(safe, self.lasts), self.least)


def _march(
    gap: Callable[[Lane], _Gap],
    step: Callable[[Lane], Lane],
    curve: Lane,
    noise: Lane,
    rounding: Lane,
    finest: Callable[[Lane], Lane],
    horizon: Lane,
    wanted: Bool[Array, "..."],
) -> Lane:
    """Return the time of the touch up to a `horizon`, else infinity; `curve` is g'' now.

    A rate of at most `noise`, a few rounding errors of the speeds, counts as zero. So does a gap of
    at most `rounding`. Touching bodies that neither close nor separate wait until one of them
    moves. This is checked at `CHECKED` times.
    """
    here = gap(jnp.zeros_like(noise))
    slow = jnp.abs(here.slope) <= noise
    still = (here.room <= rounding) & slow
    meets = jnp.where(still, curve < 0, (here.room <= 0) & (here.slope < 0))
    parts = still & (curve > _PARTS * here.bend)
    waits = wanted & still & ~parts & ~meets
    # From a touch that separates, the first step leads to a gap above rounding.
    start = jnp.where(parts, _AWAY * noise / jnp.where(parts, curve, 1), 0)
    deep = jnp.minimum(here.room, 0) - rounding

    def unfinished(carry: tuple[Lane, Lane, Lane, Lane]) -> Array:
        return jnp.any(carry[1])

    def march(carry: tuple[Lane, Lane, Lane, Lane]) -> tuple[Lane, Lane, Lane, Lane]:
        t, on, waits, stride = carry
        at = jnp.where(waits, t + stride, t)
        there, by, least = gap(at), step(at), finest(at)
        # A waiting pair continues while nothing has moved, is free once it separates, or has met
        # before.
        away = waits & (there.slope > noise) & (there.room > rounding)
        met = waits & (there.room < deep)
        begins = met & (stride <= least)
        arrived = ~waits & (there.slope < 0) & ((there.room <= 0) | (by <= least))
        # After a graze that rounding made a touch, the first steps would have zero length.
        flies = jnp.where(on & ~arrived, t + jnp.maximum(by, least), t)
        t = jnp.where(waits, jnp.where(met & ~begins, t, at), flies)
        on = on & ~arrived & ~begins & (t <= horizon)
        return t, on, waits & ~away, jnp.where(met, stride / 2, stride)

    stride = jnp.broadcast_to(horizon / CHECKED, noise.shape)
    carry = (start, wanted & ~meets, waits, stride)
    time, _, _, _ = jax.lax.while_loop(unfinished, march, carry)
    time = jnp.where(meets, 0, time)
    return jnp.where(~wanted | (time > horizon), jnp.inf, time)


def _finest(motion: Movers, now: Lane) -> Callable[[Lane], Lane]:
    """Return a function for the rounding error of a time after `now`."""
    period = 1 / jnp.where(motion.rate > 0, motion.rate, 1)
    return lambda t: 2 * jnp.finfo(t.dtype).eps * (now + t + period)


def shaking_wall_time(
    gap: Lane,
    rate: Lane,
    acceleration: Lane,
    noise: Lane,
    rounding: Lane,
    motion: Movers,
    now: Lane,
    horizon: Lane,
    wanted: Bool[Array, "..."],
) -> Lane:
    """Return the time to the touch of vibrating walls, up to `horizon`. Rows are bodies, columns
    are walls. `gap` and `rate` refer to a wall that would continue at its mean velocity from its
    position `now`. The time is infinite unless `wanted`.
    """
    bend = jnp.maximum(motion.strongest - acceleration, 0)
    envelope = motion.above(now)

    def there(t: Lane) -> _Gap:
        high, fast = motion.swing(now, t)
        room = gap + (rate + acceleration / 2 * t) * t - high
        return _Gap(room, rate + acceleration * t - fast, bend, jnp.inf, 0.0)

    def step(t: Lane) -> Lane:
        safe = there(t).step()
        mean = gap + (rate + acceleration / 2 * t) * t - envelope
        outside = wall_time(mean, rate + acceleration * t, acceleration, jnp.zeros_like(t))
        return jnp.where(mean > 0, jnp.maximum(safe, outside), safe)

    curve, wanted = acceleration - motion.acceleration(now), wanted & motion.accelerated
    return _march(there, step, curve, noise, rounding, _finest(motion, now), horizon, wanted)


def shaking_sphere_time(
    apart: Lane,
    rate: Lane,
    acceleration: Lane,
    distance: Lane,
    noise: Lane,
    rounding: Lane,
    motion: Movers,
    now: Lane,
    horizon: Lane,
    wanted: Bool[Array, "..."],
) -> Lane:
    """Return the time to the touch of accelerated fixed spheres and shells, up to `horizon`.

    Rows are bodies, columns are these spheres and shells; vectors are along the last axis. `apart`
    is measured from their positions `now`, and `rate` as if they stood there. A shell has a
    negative `distance`. The time is infinite unless `wanted`.
    """
    pull = jnp.sqrt(jnp.sum(jnp.square(acceleration), axis=-1))
    strongest, reach = pull + motion.strongest, motion.above(now)
    sign = side(distance)
    wide = distance + jnp.where(jnp.isfinite(reach), reach, 0)
    enveloped = jnp.isfinite(reach) & ((sign > 0) | (wide < 0))

    def mean(t: Lane) -> tuple[Lane, Lane]:
        passed = t[..., None]
        return apart + (rate + acceleration / 2 * passed) * passed, rate + acceleration * passed

    def there(t: Lane) -> _Gap:
        (place, speed), (high, fast) = mean(t), motion.swing(now, t)
        return _gap(place - high, speed - fast, distance, strongest)

    def step(t: Lane) -> Lane:
        safe, outer = there(t).step(), _gap(*mean(t), wide, pull)
        return jnp.where(enveloped & (outer.room > 0), jnp.maximum(safe, outer.step()), safe)

    speed = rate - motion.velocity(now)
    length = jnp.sqrt(jnp.sum(jnp.square(apart), axis=-1))
    along = jnp.sum(apart * speed, axis=-1) / length
    across = jnp.sum(jnp.square(speed), axis=-1) - jnp.square(along)
    drawn = jnp.sum(apart * (acceleration - motion.acceleration(now)), axis=-1)
    curve, noise = sign * (drawn + across) / length, noise + jnp.zeros_like(distance)
    # For the gap of squares in a shell.
    times = jnp.where(sign > 0, 1, 2 * length)
    scaled = (times * curve, times * noise, times * rounding)
    return _march(there, step, *scaled, _finest(motion, now), horizon, wanted)


def _gap(apart: Lane, rate: Lane, distance: Lane, bend: Lane) -> _Gap:
    """Return the gap to a sphere from outside or to a shell; accelerations are at most `bend`."""
    inside = distance < 0
    length = jnp.sqrt(jnp.sum(jnp.square(apart), axis=-1))
    along = jnp.sum(apart * rate, axis=-1)
    gap = side(distance) * length - distance
    # The bound holds until the speed in a shell has grown by itself plus √(ρ b).
    fast = jnp.sqrt(jnp.sum(jnp.square(rate), axis=-1))
    reach = jnp.where(inside, -distance, 0)
    bends = bend > 0
    grown = fast + jnp.where(bends, fast + jnp.sqrt(reach * bend), 0)
    lasts = jnp.where(inside & bends, (grown - fast) / jnp.where(bends, bend, 1), jnp.inf)
    within = 2 * (jnp.square(grown) + reach * bend)
    # In any direction, the body moves no farther than its speed allows.
    room = jnp.maximum(gap, 0)
    total = fast + jnp.sqrt(jnp.square(fast) + 2 * bend * room)
    least = jnp.where(inside & (total > 0), 2 * room / jnp.where(total > 0, total, 1), 0)
    safe = jnp.where(length > 0, length, 1)
    return _Gap(
        room=jnp.where(inside, gap * (length - distance), gap),
        slope=jnp.where(inside, -2 * along, along / safe),
        bend=jnp.where(inside, within, bend),
        lasts=lasts,
        least=least,
    )
