"""Rest on a wall after an instantaneous impact, and the walls that support its bodies."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Int

from ..._coupled.rows import rows_of
from ..._coupled.scalars import Flag, Number
from ..arrays.arrays import Numbers, SceneLayout
from ..arrays.flight import Flying, at_once
from ..bodies.overlap import NOISE
from .instantaneous import Choice, ImpactOutcome
from .rolling import begins_to_roll


def comes_to_rest(
    layout: SceneLayout, numbers: Numbers, choice: Choice, before: Flying, tolerance: Number
) -> Flag:
    """Return whether a ball comes to rest on a wall. If gravity presses it to a wall and e < 1 is
    constant, it bounces infinitely often in a finite time. Once the next bounce is lower than
    `tolerance` radii, that time is summed.
    """
    if not layout.settles:
        return choice.tail
    who = jnp.stack([choice.first, choice.first])
    velocity = at_once(layout, numbers, who, before, choice.support, choice.time)[0].velocity[0]
    wall = jnp.clip(choice.second - layout.spheres, 0)
    face = rows_of(numbers.normal, wall)
    weight = -jnp.sum(face * numbers.gravity)
    driven = numbers.walls_at(choice.time, wall).velocity
    closing = jnp.maximum(driven - jnp.sum(face * velocity), 0)
    e = numbers.restitution[0]
    rests = (choice.second >= layout.spheres) & (weight > 0)
    if layout.laws:
        law = layout.chosen(layout.laws, choice.first, choice.second)
        e = rows_of(numbers.restitution, law)
        rests = rests & rows_of(jnp.asarray(layout.constant), law)
    if any(layout.vibrating):
        # On a shaking wall the bounces do not form a series.
        rests = rests & ~rows_of(jnp.asarray(layout.vibrating), wall)
    if layout.frictions is not None:
        rests = rests & ~begins_to_roll(layout, choice)
    low = jnp.square(e * closing) <= 2 * weight * tolerance * rows_of(numbers.radius, choice.first)
    return rests & (e < 1) & low


def supports_after(
    layout: SceneLayout, numbers: Numbers, choice: Choice, outcome: ImpactOutcome
) -> tuple[Int[Array, "2"], Flag]:
    """Return the walls that support the two bodies after the impact, and whether one needs two."""
    support = choice.support
    if not (layout.settles or numbers.start is not None):
        return support, jnp.asarray(False)
    velocity, on = outcome.after.velocity, jnp.maximum(support, 0)
    leaving = jnp.sum(velocity * rows_of(numbers.normal, on), axis=-1)
    if any(layout.moving):
        leaving = leaving - rows_of(numbers.walls_at(outcome.time).velocity, on)
    leaving = jnp.abs(leaving)
    speed = jnp.sqrt(jnp.sum(jnp.square(velocity), axis=-1)) + outcome.closing
    kept = (support >= 0) & (leaving <= NOISE * jnp.finfo(numbers.dtype).eps * speed)
    support = jnp.where(kept, support, -1)
    wall = choice.second - layout.spheres
    crowded = choice.tail & kept[0] & (support[0] != wall)
    first = jnp.where(choice.tail, wall, support[0])
    return jnp.stack([first, support[1]]), crowded
