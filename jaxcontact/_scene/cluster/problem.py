"""A coupled solve as data: its pairs, its state, its input with units, and its result."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..._coupled.modes import Index, Number, Units
from ..._coupled.rows import rows_of
from ..._laws import end_of
from ..bodies.bodies import side
from ..bodies.motion import UserMotion
from .friction import PairFriction, Rubbing, Spins

PerPair = Float[Array, " pairs"]
PerBody = Float[Array, "bodies dim"]


class ClusterPairs(NamedTuple):
    """The bodies of a cluster that can touch, in P slots.

    - `first`, `second`: their slots. A plane is a second body without inverse mass, at any of its
      points.
    - `distance`: in m at touch. R1 + R2, negative in a shell (see `side`), or the radius for a
      plane.
    - `normal` (P, D): of a plane, of unit length, to its free side; arbitrary finite numbers for
      spheres.
    - `flat`: whether the second body is a plane.
    - `used`: False for slots without a pair.
    - `away` (P, D): the offset in m of the image of the second body; None without periodic axes.
    """

    first: Int[Array, " pairs"]
    second: Int[Array, " pairs"]
    distance: PerPair
    normal: Float[Array, "pairs dim"]
    flat: Bool[Array, " pairs"]
    used: Bool[Array, " pairs"]
    away: Float[Array, "pairs dim"] | None = None

    def between(self, position: PerBody) -> Float[Array, "pairs dim"]:
        """Return the vectors from the second bodies to the first."""
        apart = rows_of(position, self.first) - rows_of(position, self.second)
        return apart if self.away is None else apart - self.away

    def gaps(
        self, apart: Float[Array, "pairs dim"], relative: Float[Array, "pairs dim"]
    ) -> tuple[PerPair, PerPair]:
        """Return the gaps in m, and the rates at which they open. `apart` is as from `between`, and
        `relative` is its rate.
        """
        between = jnp.where(self.flat[:, None] | ~self.used[:, None], 1, apart)
        length = side(self.distance) * norm(between)
        height = jnp.sum(apart * self.normal, axis=1)
        rises = jnp.sum(relative * self.normal, axis=1)
        along = jnp.sum(between * relative, axis=1) / length
        gap = jnp.where(self.flat, height, length) - self.distance
        return gap, jnp.where(self.flat, rises, along)


class Drive(NamedTuple):
    """The accelerations -a sin(ω t + φ) of prescribed bodies, with t from the start.

    `strength` is a (M, D), `rate` ω and `phase` φ are (M,). `moves` and `shakes` (M,) mark bodies
    that move and that are accelerated. `own` holds users' functions, each with the number of the
    body that it accelerates, M or larger for an absent one.
    """

    strength: Float[Array, "bodies dim"]
    rate: Float[Array, " bodies"]
    phase: Float[Array, " bodies"]
    moves: Bool[Array, " bodies"]
    shakes: Bool[Array, " bodies"]
    own: tuple[tuple[UserMotion, Index | int], ...]


class ClusterState(NamedTuple):
    """The state of a cluster in SI units, from which a solve can continue.

    `time` is in s; `position` and `velocity` are (M, D). Each pair has an `indentation` δ in m,
    negative if open. The solve continues from it, since differences of positions have fewer digits.
    `closed`: whether the pair is in contact. `rising`: whether its v0 still follows δ'; `latched`
    is that v0 in m/s. `since` in s is the last touch, and `force_until` the end of the force since
    then, where the bodies part with `parting` in m/s; `since` itself while the force acts.
    `max_force` and the energy `lost` are those since that touch. `rubbing` is None without
    friction. `deepest` in m is the largest indentation of a pair that unloads, 0 for one that
    loads; None unless forces depend on it.
    """

    time: Number
    position: PerBody
    velocity: PerBody
    indentation: PerPair
    closed: Bool[Array, " pairs"]
    rising: Bool[Array, " pairs"]
    latched: PerPair
    since: PerPair
    force_until: PerPair
    parting: PerPair
    max_force: PerPair
    lost: PerPair
    rubbing: Rubbing | None = None
    deepest: PerPair | None = None


def norm(vectors: Float[Array, "*pairs dim"]) -> Float[Array, "*pairs"]:
    return jnp.sqrt(jnp.sum(jnp.square(vectors), axis=-1))


class ClusterProblem(NamedTuple):
    """A cluster with its start, in SI units; differentiable with respect to every float.

    - `law`, `contact`: the law, and effective masses and stiffnesses; scalars or one number a pair.
    - `pairs`: the pairs that can touch.
    - `inverse_mass`: in 1/kg, 0 for fixed and prescribed bodies, which keep their velocity.
    - `acceleration`: of each body by gravity, in m/s².
    - `state`, `until`: the start, and the end time in s.
    - `tolerance`: bounds the error of velocities relative to the speeds in the cluster; at least
      1e-5 in float32. In the solve it is that of a step.
    - `drive`: the accelerations of prescribed bodies; None if there are none.
    - `to_the_end`: whether the solve continues at rest.
    - `friction`: the numbers of friction, with a state that holds its springs; None without.
    - `floor`: the least v0 in m/s, which follows from its rule.
    """

    law: Any
    contact: Any
    pairs: ClusterPairs
    inverse_mass: Float[Array, " bodies"]
    acceleration: PerBody
    state: ClusterState
    until: Number
    tolerance: Any
    drive: Drive | None = None
    to_the_end: Any = False
    friction: PairFriction | None = None
    floor: Any = 0.0


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
    rubbed: Number | None


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


class Rubbed(NamedTuple):
    """The part of a state that friction adds: spins, spring forces, and the energies taken."""

    spin: Spins
    spring: PerBody
    taken: PerPair
