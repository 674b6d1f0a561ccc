"""Contact times of two bodies in closed form.

A time is the least τ ≥ 0 at which the gap vanishes while it shrinks; it is infinite if there is
none. Bodies that touch and approach meet now. Bodies that touch and recede do not meet by that
touch. A gap that is negative by rounding is a touch: it is neither found twice nor missed.
"""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

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
