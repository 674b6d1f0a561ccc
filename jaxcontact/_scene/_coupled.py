"""All spheres of a small scene as one coupled solve: what is not an isolated impact.

The slots are the spheres, then the walls; every pair that can meet has a place, so that bodies join
and leave by flags alone. A call goes on until a pair touches or opens, or another time is up.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ._cluster import cluster, touched
from ._cluster_solve import ClusterEnd
from ._hit import Choice, Flying, accelerations, meeting_of
from ._overlap import ROUNDINGS
from ._side import side
from ._stored import stored_in
from ._system import Layout, Numbers, known_contact_of, law_of
from ._touching import ClusterState, Drive, Pairs

MOST = 8
"""Spheres that a coupled solve has room for."""


class Call(NamedTuple):
    """The decisions about one call: `starts` a solve at the touch of `choice`, or goes on.

    `members` (N,), the spheres in it, of which those that `joins` (N,) come in now; the others are
    in isolated impacts until later. `closed` (P,): the pairs in contact at a start. It ends at the
    time of sphere `until_body`, where that is not -1, or at `until` in s.
    """

    starts: Bool[Array, ""]
    choice: Choice
    members: Bool[Array, " N"]
    joins: Bool[Array, " N"]
    closed: Bool[Array, " P"]
    until_body: Int[Array, ""]
    until: Float[Array, ""]

    def where(self, needed: Bool[Array, ""]) -> Call:
        """The call, without a step where it is not `needed`: in a batch another lane needs one."""
        return self._replace(starts=self.starts | ~needed, closed=self.closed & needed)


def places(layout: Layout) -> tuple[np.ndarray, np.ndarray]:
    """First and second body of every pair that can meet: (P,) each."""
    count = layout.spheres
    pairs = [
        (i, j)
        for i in range(count)
        for j in range(i + 1, count + layout.walls)
        if not (layout.fixed[i] and (j >= count or layout.fixed[j]))
    ]
    # A fixed sphere comes second.
    turned = [(j, i) if layout.fixed[i] and j < count else (i, j) for i, j in pairs]
    first, second = np.array(turned, int).reshape(-1, 2).T
    return first, second


def pairs_of(layout: Layout, numbers: Numbers, members: Bool[Array, " N"]) -> Pairs:
    """The slots of all pairs; those of spheres that are elsewhere are not used."""
    first, second = places(layout)
    count, walls = layout.spheres, layout.walls
    flat = second >= count
    radius = jnp.concatenate([numbers.radius, jnp.zeros(walls, numbers.dtype)])
    none = jnp.zeros((count, layout.dimensions), numbers.dtype)
    normal = jnp.concatenate([none, numbers.normal])[second]
    inside = jnp.concatenate([members, jnp.ones(walls, bool)])
    return Pairs(
        first=jnp.asarray(first),
        second=jnp.asarray(second),
        distance=radius[first] + radius[second],
        normal=normal,
        flat=jnp.asarray(flat),
        used=inside[first] & inside[second],
    )


def placed(layout: Layout, numbers: Numbers, spheres: Flying, time: Array) -> tuple[Array, Array]:
    """Positions and velocities of all slots; a wall stands at the foot of its normal at a time."""
    walls = numbers.walls_at(time)
    position = jnp.concatenate([spheres.position, walls.offset[:, None] * numbers.normal])
    driven = walls.velocity[:, None] * numbers.normal
    return position, jnp.concatenate([spheres.velocity, driven])


def at_once(
    layout: Layout, numbers: Numbers, spheres: Flying, support: Array, time: Array
) -> Flying:
    """All spheres in flight at one time."""
    pull = accelerations(layout, numbers, jnp.arange(layout.spheres), support)
    passed = (time - spheres.time)[:, None]
    velocity = spheres.velocity + pull * passed
    position = spheres.position + (spheres.velocity + velocity) / 2 * passed
    return Flying(position, velocity, jnp.broadcast_to(time, spheres.time.shape))


def touching(
    layout: Layout, numbers: Numbers, there: Flying, choice: Choice, support: Array, held: Array
) -> Array:
    """The pairs in contact at a start: the one that meets, those that touch by rounding and do not
    part, and the bodies that rest on a wall (`held`, their v0, is not zero).
    """
    first, second = places(layout)
    pairs = pairs_of(layout, numbers, jnp.ones(layout.spheres, bool))
    position, velocity = placed(layout, numbers, there, choice.time)
    apart = position[first] - position[second]
    rate = velocity[first] - velocity[second]
    flat = pairs.flat
    length = side(pairs.distance) * jnp.sqrt(jnp.sum(jnp.square(apart), axis=-1))
    height = jnp.sum(apart * pairs.normal, axis=-1)
    gap = jnp.where(flat, height, length) - pairs.distance
    opening = jnp.where(
        flat, jnp.sum(rate * pairs.normal, axis=-1), jnp.sum(apart * rate, axis=-1) / length
    )
    eps = jnp.finfo(numbers.dtype).eps
    scale = jnp.max(jnp.abs(there.position)) + jnp.max(numbers.radius)
    speed = jnp.max(jnp.abs(velocity))
    touches = (gap <= ROUNDINGS * eps * scale) & (opening <= ROUNDINGS * eps * speed)
    meets = (choice.first == first) & (choice.second == second)
    meets = meets | ((choice.first == second) & (choice.second == first))
    rests = flat & (support[first] == second - layout.spheres) & (support[first] >= 0)
    return touches | meets | rests


def call(
    layout: Layout,
    numbers: Numbers,
    spheres: Flying,
    support: Int[Array, " N"],
    held: Float[Array, " N"],
    before: ClusterState,
    decided: Call,
    rtol: Float[Array, ""],
    v0: Any,
) -> tuple[ClusterState, ClusterEnd]:
    """One call of the coupled solve: the state that it starts from, and how it ends."""
    count = layout.spheres
    pairs = pairs_of(layout, numbers, decided.members)
    first, second = places(layout)
    choice = decided.choice

    # A start: all spheres at the time of the touch.
    other = jnp.minimum(choice.second, count - 1)
    who = jnp.stack([choice.first, other])
    two = jax.tree.map(lambda all: all[who], spheres)
    time = meeting_of(layout, numbers, two, choice).time
    there = at_once(layout, numbers, spheres, support, time)
    start = touched(pairs, *placed(layout, numbers, there, time), decided.closed, v0=v0)
    rests = pairs.flat & (support[first] == second - count) & (support[first] >= 0)
    none = jnp.zeros(count, numbers.dtype)
    height = jnp.sum(there.position[first] * pairs.normal, axis=-1)
    sunk = pairs.distance - height + jnp.concatenate([none, numbers.offset])[second]
    outside = jnp.where(start.closed, 0, jnp.minimum(start.indentation, 0))
    start = start._replace(
        time=time,
        indentation=jnp.where(rests, sunk, outside),
        latched=jnp.where(rests, held[first], start.latched),
        rising=start.rising & ~rests,
        since=jnp.zeros_like(start.since) + time,
        force_until=jnp.zeros_like(start.since) + time,
    )
    # Going on: those that join come from their own impacts.
    joins = jnp.concatenate([decided.joins, jnp.zeros(layout.walls, bool)])[:, None]
    position, velocity = placed(layout, numbers, spheres, before.time)
    position = jnp.where(joins, position, before.position)
    velocity = jnp.where(joins, velocity, before.velocity)
    apart = position[first] - position[second]
    length = jnp.sqrt(jnp.sum(jnp.square(jnp.where(pairs.flat[:, None], 1, apart)), axis=-1))
    length = side(pairs.distance) * length
    near = jnp.where(pairs.flat, jnp.sum(apart * pairs.normal, axis=-1), length)
    fresh = (
        decided.joins[first]
        | jnp.concatenate([decided.joins, jnp.zeros(layout.walls, bool)])[second]
    )
    depth = jnp.where(fresh, jnp.minimum(pairs.distance - near, 0), before.indentation)
    on = before._replace(position=position, velocity=velocity, indentation=depth)
    begin = jax.tree.map(lambda a, b: jnp.where(decided.starts, a, b), start, on)

    until = jnp.where(
        decided.until_body >= 0, spheres.time[jnp.maximum(decided.until_body, 0)], decided.until
    )
    inverse = jnp.where(decided.members, numbers.inverse_mass[:count], 0)
    inverse = jnp.concatenate([inverse, numbers.inverse_mass[count:]])
    nothing = jnp.full(count, -1)
    pull = accelerations(layout, numbers, jnp.arange(count), nothing)
    pull = jnp.where(decided.members[:, None], pull, 0)
    pull = jnp.concatenate([pull, jnp.zeros((layout.walls, layout.dimensions), numbers.dtype)])
    contact = jax.vmap(lambda i, j: known_contact_of(layout, numbers, i, j))(
        jnp.asarray(first), jnp.asarray(second)
    )
    law = jax.vmap(lambda i, j: law_of(layout, numbers, i, j))(
        jnp.asarray(first), jnp.asarray(second)
    )
    end = cluster(
        law, contact, pairs, inverse, pull, begin, until,
        rtol=rtol, v0=v0, until_change=True, drive=_drive(layout, numbers, begin.time),
        in_line=layout.dimensions == 1 and layout.visible == layout.spheres,
    )  # fmt: skip
    return begin, end


def _drive(layout: Layout, numbers: Numbers, time: Array) -> Drive | None:
    """How the slots are driven from a time on; None where no wall moves."""
    motion = numbers.motion
    if motion is None:
        return None
    still = jnp.zeros(layout.spheres, numbers.dtype)
    strength = motion.amplitude * jnp.square(motion.rate)
    none = jnp.zeros((layout.spheres, layout.dimensions), numbers.dtype)
    return Drive(
        strength=jnp.concatenate([none, strength[:, None] * numbers.normal]),
        rate=jnp.concatenate([still, motion.rate]),
        phase=jnp.concatenate([still, motion.rate * time + motion.phase]),
        moves=jnp.asarray((False,) * layout.spheres + layout.moving),
    )


def work_of_walls(
    layout: Layout, numbers: Numbers, began: ClusterState, end: ClusterEnd
) -> Float[Array, ""]:
    """What moving walls did to the spheres in one call: all work but that of gravity, in J."""
    if numbers.motion is None:
        return jnp.zeros((), numbers.dtype)
    count = layout.spheres
    inverse = numbers.inverse_mass[:count]
    mass = jnp.where(inverse > 0, 1 / jnp.where(inverse > 0, inverse, 1), 0)
    fall = end.state.position[:count] - began.position[:count]
    weight = jnp.sum(mass * jnp.sum(fall * numbers.gravity[None], axis=-1))
    return end.work - weight


def as_numbers(state: ClusterState) -> ClusterState:
    """The state with its flags as 0 and 1, for a log whose figures have derivatives."""
    dtype = state.position.dtype
    return state._replace(closed=state.closed.astype(dtype), rising=state.rising.astype(dtype))


def as_flags(state: ClusterState) -> ClusterState:
    """The inverse of `as_numbers`."""
    return state._replace(closed=state.closed > 0.5, rising=state.rising > 0.5)


def blank_state(layout: Layout, dtype: Any) -> ClusterState:
    """A state of zeros, with all pairs open."""
    slots, pairs = layout.spheres + layout.walls, places(layout)[0].shape[0]
    vector, each = jnp.zeros((slots, layout.dimensions), dtype), jnp.zeros(pairs, dtype)
    flags = jnp.zeros(pairs, bool)
    return ClusterState(
        jnp.zeros((), dtype), vector, vector, each, flags, flags, each, each, each, each, each, each
    )


def stored_energy(layout: Layout, numbers: Numbers, state: ClusterState) -> Float[Array, ""]:
    """The elastic energy of all contacts, Σ ∫ F(δ, 0) dδ."""
    first, second = places(layout)

    def one(i: Array, j: Array, depth: Array, closed: Array, speed: Array) -> Array:
        contact = known_contact_of(layout, numbers, i, j)
        law = law_of(layout, numbers, i, j)
        return stored_in(law, contact, jnp.where(closed, depth, 0), speed)

    return jnp.sum(
        jax.vmap(one)(
            jnp.asarray(first), jnp.asarray(second), state.indentation, state.closed, state.latched
        )
    )
