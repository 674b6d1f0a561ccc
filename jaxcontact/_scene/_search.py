"""The next event of some spheres: the least of the times at which they meet all other bodies."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ._hit import accelerations
from ._progress import Events, State
from ._system import Layout, Numbers, nearest_image
from ._touch import (
    curved_time,
    image_horizon,
    shaking_wall_time,
    sphere_time,
    wall_time,
)

NOISE = 16
"""Roundings of a speed below which bodies that touch neither close nor part."""

TIED = 64
"""Roundings of a time within which two events are simultaneous."""


def simultaneous(numbers: Numbers, time: Float[Array, ""]) -> Float[Array, ""]:
    """How far apart two times may be that are one but for rounding."""
    finite = jnp.where(jnp.isfinite(time), jnp.abs(time), 0)
    return TIED * jnp.finfo(numbers.dtype).eps * finite


def searched(
    layout: Layout,
    numbers: Numbers,
    state: State,
    who: Int[Array, " M"],
    now: Float[Array, ""],
    end: Float[Array, ""],
) -> Events:
    """The next events of some spheres, searched among all bodies."""
    count, eps = layout.spheres, jnp.finfo(numbers.dtype).eps
    passed = (now - state.time)[:, None]
    velocity, position = state.velocity, state.position
    pull = jnp.zeros_like(velocity)
    if layout.gravity:
        pull = accelerations(layout, numbers, jnp.arange(count), state.support)
        velocity = velocity + pull * passed
    position = position + (state.velocity + velocity) / 2 * passed
    moves = numbers.inverse_mass[:count] > 0
    speeds = jnp.sqrt(jnp.sum(jnp.square(velocity), axis=-1))

    apart = (position[who][:, None] - position[None]).reshape(-1, layout.dimensions)
    apart = nearest_image(layout, numbers, apart)[0].reshape(-1, count, layout.dimensions)
    rate = velocity[who][:, None] - velocity[None]
    bend = pull[who][:, None] - pull[None]
    distance = numbers.radius[who][:, None] + numbers.radius[None]
    noise = NOISE * eps * (speeds[who][:, None] + speeds[None])
    straight = sphere_time(apart, rate, distance, noise)
    if layout.gravity and (layout.walls or any(layout.fixed)):
        bent = jnp.any(bend != 0, axis=-1)
        horizon = jnp.maximum(end - now, 0)

        def curved() -> Array:
            return curved_time(apart, rate, bend, distance, noise, horizon)

        times = jnp.where(bent, jax.lax.cond(jnp.any(bent), curved, lambda: straight), straight)
    else:
        times = straight
    other = (jnp.arange(count)[None] != who[:, None]) & (moves[None] | moves[who][:, None])
    times = jnp.where(other, times, jnp.inf)
    reached = jnp.where(jnp.isfinite(times), times, 0)[..., None]
    at = apart + (rate + bend / 2 * reached) * reached
    closing = -jnp.sum(at * (rate + bend * reached), axis=-1) / distance

    horizon = jnp.full(who.shape, jnp.inf, numbers.dtype)
    for axis in range(layout.dimensions):
        if layout.periodic[axis]:
            bound = image_horizon(
                apart[..., axis], rate[..., axis], bend[..., axis], distance, numbers.period[axis]
            )
            horizon = jnp.minimum(horizon, jnp.min(jnp.where(other, bound, jnp.inf), axis=-1))

    if layout.walls:
        height = jnp.sum(position[who][:, None] * numbers.normal[None], axis=-1)
        walls = numbers.walls_at(now)
        gap = height - walls.offset[None] - numbers.radius[who][:, None]
        fall = jnp.sum(velocity[who][:, None] * numbers.normal[None], axis=-1)
        weight = jnp.sum(pull[who][:, None] * numbers.normal[None], axis=-1)
        noise = NOISE * eps * speeds[who][:, None]
        motion = jax.tree.map(lambda x: x[None], numbers.motion)
        if motion is not None:
            fall = fall - motion.speed
            noise = noise + NOISE * eps * motion.fastest
        wall = wall_time(gap, fall, weight, noise)
        if any(layout.vibrating):
            assert motion is not None
            shaking = jnp.asarray(layout.vibrating)[None]
            left = jnp.maximum(end - now, 0)
            found = shaking_wall_time(gap, fall, weight, noise, motion, now, left)
            wall = jnp.where(shaking, found, wall)
        resting = jnp.arange(layout.walls)[None] == state.support[who][:, None]
        wall = jnp.where(resting | ~moves[who][:, None], jnp.inf, wall)
        reached = jnp.where(jnp.isfinite(wall), wall, 0)
        rises = fall + weight * reached
        if any(layout.vibrating):
            assert motion is not None
            swing = motion.velocity(now + reached) - motion.speed
            rises = rises - jnp.where(jnp.asarray(layout.vibrating)[None], swing, 0)
        times = jnp.concatenate([times, wall], axis=-1)
        closing = jnp.concatenate([closing, -rises], axis=-1)
    # A fixed sphere is found by those that move.
    times = jnp.where(moves[who][:, None], times, jnp.inf)

    least = jnp.min(times, axis=-1, keepdims=True)
    within = TIED * eps * (jnp.abs(now) + jnp.where(jnp.isfinite(least), least, 0))
    together = times <= least + within
    best = jnp.argmax(jnp.where(together, closing, -jnp.inf), axis=-1)
    everyone = jnp.arange(times.shape[-1])[None]
    second = jnp.min(jnp.where(everyone == best[:, None], jnp.inf, times), axis=-1)
    time = jnp.take_along_axis(times, best[:, None], axis=-1)[:, 0]
    speed = jnp.take_along_axis(closing, best[:, None], axis=-1)[:, 0]
    early = horizon < time
    sphere = jnp.minimum(best, count - 1)
    return Events(
        time=now + jnp.minimum(time, horizon),
        partner=jnp.where(early, -1, best),
        count=jnp.where(best < count, state.count[sphere], 0),
        speed=jnp.where(early, jnp.inf, speed),
        second=now + second,
    )
