"""The input of a solve of a mechanism, its state, its units, and its log: a row for each time at
which contacts begin or end.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._contact import Contact
from .._coupled.modes import Flags, Index, Number, PerContact, Units
from .mechanics import Mechanics, Vector
from .system import System


class SystemState(NamedTuple):
    """The state of a mechanism in SI units, from which a solve can continue.

    `time` is in s. Each gap has its `closing` speed -dg/dt. `closed`: whether it is in contact.
    `rising`: whether its v0 still follows the closing speed; `latched` is that v0, and `mass` the
    effective mass at touch. `since` in s is the last touch, and `force_until` the end of the force
    since then, or `since` itself while it acts. `touch_speed` and `parting` are the closing and the
    opening speed there. `max_force`, `max_depth` and the energy `lost` in J are those since the
    touch. `work` in J is that since the start of the run. `step` in s is the length of the next
    step. `slide` holds the signs of the slip, 0 for contacts that stick, if there are any that do.
    `spring` (m, d) are the forces of tangential springs in N, or the states of friction. `deepest`
    in m is the largest indentation of a contact that unloads, 0 for one that loads; None
    unless forces depend on it.
    """

    time: Number
    position: Vector
    velocity: Vector
    closing: PerContact
    closed: Flags
    rising: Flags
    latched: PerContact
    mass: PerContact
    since: PerContact
    touch_speed: PerContact
    force_until: PerContact
    parting: PerContact
    max_force: PerContact
    max_depth: PerContact
    lost: PerContact
    work: Number
    step: Number
    slide: PerContact | None = None
    spring: Array | None = None
    deepest: PerContact | None = None


class SystemProblem(eqx.Module):
    """A mechanism with its start; differentiable with respect to every float. `stops` (S,) are the
    times in s at which the force may jump, and the end. `floor` is the least v0 at touch in m/s.
    """

    mechanics: Mechanics
    state: SystemState
    stops: Float[Array, " S"]
    tolerance: Number
    floor: Number

    @property
    def contact(self) -> Contact:
        """The contact of every gap, with effective masses at touch."""
        return contact_of(self.mechanics.system, self.state.mass)


def contact_of(system: System, mass: PerContact) -> Contact:
    """Return the contact of every gap, with these effective masses."""
    contact = Contact(mass, system.stiffness * jnp.ones_like(mass))
    return eqx.tree_at(lambda c: c._exponent, contact, system._exponent)


class Scales(NamedTuple):
    """The units of a solve: of contacts, of the coordinates q and of the speeds v. Then the largest
    gap at the start, and the largest change of a gap by each coordinate, in these units.
    """

    contact: Units
    position: Vector
    velocity: Vector
    gap: Number
    reach: Vector

    def grown(self, by: Number) -> Scales:
        """Return units of larger lengths and speeds, with the same time and mass."""
        length, speed, mass = self.contact
        units = Units(length * by, speed * by, mass)
        farthest = jnp.maximum(self.gap / by, 1)
        return Scales(units, self.position * by, self.velocity * by, farthest, self.reach)


def scales_of(problem: SystemProblem, state: SystemState) -> Scales:
    """Return units in which speeds, and lengths during the shortest contact, are about one. They
    follow from the motion of a state, and have no derivative.
    """
    problem, state = jax.lax.stop_gradient((problem, state))
    mechanics, contact = problem.mechanics, problem.contact
    n, stiffness = contact.exponent, contact.stiffness
    t, q, v = state.time, state.position, state.velocity
    # A gap may be stationary where it starts, in the middle of a bearing, but not nearby.
    finest = math.sqrt(jnp.finfo(q.dtype).eps)
    steps = finest * jnp.maximum(jnp.abs(q), finest) * (1 + jnp.arange(q.shape[0], dtype=q.dtype))
    unit = jnp.min(mechanics.effective_mass(t, q + steps, v))
    gradient = jax.jacfwd(lambda q: mechanics.system.gap(t, q, mechanics.args))(q + steps)
    (gap, rate), mass = mechanics.gaps(t, q, v), mechanics.mass(t, q)
    depth = jnp.where(state.closed, jnp.maximum(-gap, 0), 0)
    energy = jnp.sum(v * (mass @ v)) + jnp.sum(stiffness * depth ** (n + 1))
    tiny = math.sqrt(jnp.finfo(q.dtype).tiny)
    speed = jnp.sqrt(energy / unit + jnp.max(jnp.square(rate)) + tiny)
    # A contact time depends on the speed at touch; bodies at rest can close a gap within the run.
    left, farthest = problem.stops[-1] - t, jnp.max(jnp.where(state.closed, 0, jnp.abs(gap)))
    left = jnp.where(left > 0, left, 1)
    touching = jnp.maximum(speed, farthest / left)
    logarithm = jnp.log(unit) + 2 * jnp.log(touching) - jnp.log(stiffness)
    lasts = jnp.min(jnp.exp(logarithm / (n + 1))) / touching
    length = speed * jnp.minimum(lasts, left)
    units = Units(length, speed, unit)
    inertia = jnp.diagonal(mass)
    speeds = speed * jnp.sqrt(unit / jnp.where(inertia > 0, inertia, unit))
    if mechanics.system.rate is None:
        positions = units.time * speeds
    else:
        paces = jax.jacfwd(lambda v: mechanics.rate(t, q, v))(v)
        positions = units.time * jnp.sum(jnp.abs(paces) * speeds[None], axis=1)
        positions = jnp.where(positions > 0, positions, units.time)
    reach = jnp.max(jnp.abs(gradient), axis=0) * positions / length
    return Scales(units, positions, speeds, jnp.maximum(jnp.max(jnp.abs(gap)) / length, 1), reach)


class SystemLog(NamedTuple):
    """The rows of a solve (R, ...): the states just after events, with the contacts that begin and
    end there. `count` rows are written.
    """

    states: SystemState
    touches: Bool[Array, "R m"]
    opens: Bool[Array, "R m"]
    count: Index

    @property
    def rows(self) -> int:
        return self.touches.shape[0]

    @property
    def written(self) -> Bool[Array, " R"]:
        return jnp.arange(self.rows, dtype=self.count.dtype) < self.count

    @property
    def times(self) -> Float[Array, " R"]:
        """The times of the rows in s, infinite for blank ones."""
        return jnp.where(self.written, self.states.time, jnp.inf)


def empty_log(state: SystemState, rows: int) -> SystemLog:
    """Return a log without rows written."""
    blank = jax.tree.map(lambda x: jnp.zeros((rows, *x.shape), x.dtype), state)
    none = jnp.zeros((rows, *state.closed.shape), bool)
    return SystemLog(blank, none, none, jnp.zeros((), jnp.int32))


def with_event(
    log: SystemLog,
    state: SystemState,
    touches: Bool[Array, " m"],
    opens: Bool[Array, " m"],
    slides: Bool[Array, " m"] | None = None,
) -> SystemLog:
    """Return the log with a row if any contact begins or ends, or begins to stick or to slip. The
    row after the last one is overwritten in any case, which costs less than a choice.
    """

    def put(rows: Array, row: Array) -> Array:
        return jax.lax.dynamic_update_index_in_dim(rows, row, log.count, 0)

    states, began, ended = jax.tree.map(
        put, (log.states, log.touches, log.opens), (state, touches, opens)
    )
    event = jnp.any(touches | opens if slides is None else touches | opens | slides)
    return SystemLog(states, began, ended, log.count + event.astype(log.count.dtype))
