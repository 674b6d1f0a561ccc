"""The input of a coupled solve, its units, and its result."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..._coupled.modes import Flag, Index, Number, Units
from ..._coupled.rows import rows_of
from ..._laws import end_of
from .equations import ClusterPairs, ClusterState, Drive, PerBody
from .friction import PairFriction


class ClusterProblem(NamedTuple):
    """A cluster with its start, in SI units; differentiable with respect to every float.
    `to_the_end`: whether the solve continues at rest.
    """

    law: Any
    contact: Any
    pairs: ClusterPairs
    inverse_mass: Float[Array, " bodies"]
    acceleration: PerBody
    state: ClusterState
    until: Number
    tolerance: Number
    floor: Number
    drive: Drive | None
    to_the_end: Flag
    friction: PairFriction | None = None


class ClusterEnd(NamedTuple):
    """The `state` at the end, its `status`, and its statistics.

    `error_estimate` is the larger of two errors: the summed step errors relative to the speeds, and
    the energy imbalance relative to the cluster's energy. `error` is the same in m/s. `work` in J
    is that of gravity and prescribed bodies on the free ones; `rubbed` in J is the energy taken by
    friction, None without.
    """

    state: ClusterState
    work: Number
    status: Index
    steps: Index
    error_estimate: Number
    error: Number
    rubbed: Number | None = None


def units_of(problem: ClusterProblem) -> Units:
    """Return units in which lengths and speeds of the softest pair are about one. They have no
    derivative.
    """
    problem = jax.lax.stop_gradient(problem)
    contact, state, pairs = problem.contact, problem.state, problem.pairs
    used, n = pairs.used, contact.exponent
    mass = 1 / jnp.max(problem.inverse_mass)
    first, second = (rows_of(state.velocity, k) for k in (pairs.first, pairs.second))
    motion = jnp.max(jnp.where(used, jnp.sum(jnp.square(first - second), axis=1), 0))
    if problem.friction is not None and state.rubbing is not None:
        surface = problem.friction.radius[:, None] * state.rubbing.spin
        motion = jnp.maximum(motion, jnp.max(jnp.sum(jnp.square(surface), axis=1)))
    depth = jnp.where(used & state.closed, jnp.maximum(state.indentation, 0), 0)
    if problem.law.ends_apart:
        # Adhesion moves bodies that touch without a speed.
        neck = jnp.where(used & state.closed, -end_of(problem.law, contact), 0)
        depth = jnp.maximum(depth, neck)
    stored = jnp.max(contact.stiffness * depth ** (n + 1)) / mass
    pull = jnp.sqrt(jnp.max(jnp.sum(jnp.square(problem.acceleration), axis=1)))
    tiny = math.sqrt(jnp.finfo(pull.dtype).tiny)
    static = (jnp.maximum(mass * pull, tiny) / contact.stiffness) ** (1 / n)
    weight = pull * jnp.max(jnp.where(used, static, 0))
    speed = jnp.sqrt(motion + stored + weight + tiny)
    logarithm = jnp.log(mass) + 2 * jnp.log(speed) - jnp.log(contact.stiffness)
    length = jnp.min(jnp.where(used, jnp.exp(logarithm / (n + 1)), jnp.inf))
    length = jnp.where(jnp.isfinite(length), length, 1)
    return Units(length, speed, mass)


def scale_drive(drive: Drive | None, units: Units) -> Drive | None:
    if drive is None:
        return None
    users = ((user.scaled(units.length, units.time), body) for user, body in drive.own)
    return drive._replace(
        strength=drive.strength / (units.speed / units.time),
        rate=drive.rate * units.time,
        own=tuple(users),
    )
