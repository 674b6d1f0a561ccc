"""What a coupled solve is asked, the units that it is solved in, and what it answers."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .equations import ClusterState, Drive, Pairs, PerBody, Units

APART, TIME_IS_UP, NOT_CONVERGED, CHANGED, AT_REST, PAUSED = range(6)
"""`ClusterEnd.status`. All pairs are open; `until` was reached; the numbers cannot be trusted; a
pair touched or opened, where `until_change` asked for that; what touches, each body a plane of its
own, does not move along the normal any more; all steps were taken on a way that goes on, as that of
a ball that slides in a shell: another call goes on from here."""


class Problem(NamedTuple):
    """A cluster with its start, in SI units; every float of it may be differentiated. `to_the_end`:
    whether it goes on where it comes to rest.
    """

    law: Any
    contact: Any
    pairs: Pairs
    inverse_mass: Float[Array, " bodies"]
    acceleration: PerBody
    state: ClusterState
    until: Float[Array, ""]
    tolerance: Float[Array, ""]
    floor: Float[Array, ""]
    drive: Drive | None
    to_the_end: Bool[Array, ""]


class Rules(NamedTuple):
    """What is static: whether v0 follows its peak, where a solve ends, and whether all bodies are
    spheres outside of each other, and walls, in one dimension.
    """

    peak: bool
    until_change: bool
    max_steps: int
    in_line: bool


class ClusterEnd(NamedTuple):
    """The `state` at the end, its `status`, and how it was reached.

    `error_estimate`: the larger one of what the steps add up to, relative to the speeds, and of the
    energy that is missing, relative to the energy of the cluster; `error`, the same in m/s. `work`
    in J, of gravity and of prescribed bodies on the free ones.
    """

    state: ClusterState
    work: Float[Array, ""]
    status: Int[Array, ""]
    steps: Int[Array, ""]
    events: Int[Array, ""]
    error_estimate: Float[Array, ""]
    error: Float[Array, ""]


def units_of(problem: Problem) -> Units:
    """Such that lengths and speeds of the softest start are about one; they have no derivative."""
    contact, state, pairs = problem.contact, problem.state, problem.pairs
    used, n = pairs.used, contact.exponent
    mass = 1 / jnp.max(problem.inverse_mass)
    relative = state.velocity[pairs.first] - state.velocity[pairs.second]
    motion = jnp.max(jnp.where(used, jnp.sum(jnp.square(relative), axis=1), 0))
    depth = jnp.where(used & state.closed, jnp.maximum(state.indentation, 0), 0)
    stored = jnp.max(contact.stiffness * depth ** (n + 1)) / mass
    pull = jnp.sqrt(jnp.max(jnp.sum(jnp.square(problem.acceleration), axis=1)))
    tiny = float(jnp.finfo(pull.dtype).tiny) ** 0.5
    static = (jnp.maximum(mass * pull, tiny) / contact.stiffness) ** (1 / n)
    weight = pull * jnp.max(jnp.where(used, static, 0))
    speed = jnp.sqrt(motion + stored + weight + tiny)
    logarithm = jnp.log(mass) + 2 * jnp.log(speed) - jnp.log(contact.stiffness)
    length = jnp.min(jnp.where(used, jnp.exp(logarithm / (n + 1)), jnp.inf))
    length = jnp.where(jnp.isfinite(length), length, 1)
    return jax.tree.map(jax.lax.stop_gradient, Units(length, speed, mass))


def scaled(drive: Drive | None, units: Units) -> Drive | None:
    if drive is None:
        return None
    own = ((one.scaled(units.length, units.time), body) for one, body in drive.own)
    return drive._replace(
        strength=drive.strength / (units.speed / units.time),
        rate=drive.rate * units.time,
        own=tuple(own),
    )
