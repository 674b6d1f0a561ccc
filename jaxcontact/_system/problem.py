"""The input of a solve of a mechanism, its state, and its units."""

from __future__ import annotations

import math
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._contact import Contact
from .._coupled.modes import Flags, PerContact, Units
from .._coupled.scalars import Number
from .mechanics import Mechanics, Vector


class SystemState(NamedTuple):
    """The state of a mechanism in SI units, from which a solve can continue.

    `time` is in s. Each gap has its `closing` speed -dg/dt. `closed`: whether it is in contact.
    `rising`: whether its v0 still follows the closing speed; `latched` is that v0, and `mass` the
    effective mass at touch. `since` in s is the last touch, and `force_until` the end of the force
    since then, or `since` itself while it acts; `touch_speed` and `parting` are the closing and the
    opening speed there. `max_force`, `max_depth` and the energy `lost` in J are those since the
    touch. `work` in J is that since the start of the run. `step`
    in s is the length of the next step. `slide` holds the signs of the slip, 0 for contacts that
    stick, if contacts stick and slip. `spring` (m, d) in N are the forces of tangential springs.
    `deepest` in m is the largest indentation of a contact that unloads, 0 for one that loads; None
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
        system, ones = self.mechanics.system, jnp.ones_like(self.state.lost)
        contact = Contact(self.state.mass, system.stiffness * ones)
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


def scales_of(problem: SystemProblem) -> Scales:
    """Return units in which speeds, and lengths during the shortest contact, are about one. They
    follow from the energy at the start, and have no derivative.
    """
    problem = jax.lax.stop_gradient(problem)
    mechanics, state, contact = problem.mechanics, problem.state, problem.contact
    at = state.time, state.position, state.velocity
    n, stiffness, unit = contact.exponent, contact.stiffness, _typical_mass(mechanics, state)
    opening = mechanics.opening(*at)
    force = jnp.zeros_like(opening.gap)
    motion = mechanics.motion(*at, opening, force)
    second = jnp.abs(mechanics.second(*at, motion.acceleration))
    pull = unit * jnp.max(second)
    tiny = math.sqrt(jnp.finfo(unit.dtype).tiny)
    weight = pull * (jnp.maximum(pull, tiny) / jnp.min(stiffness)) ** (1 / n)
    depth = jnp.where(state.closed, jnp.maximum(-opening.gap, 0), 0)
    stored = jnp.sum(stiffness * depth ** (n + 1))
    # A body that starts at rest falls through its gap.
    moving = jnp.max(jnp.square(opening.rate) + 2 * second * jnp.abs(opening.gap))
    energy = 2 * mechanics.kinetic(*at) + stored + jnp.max(weight)
    speed = jnp.sqrt(energy / unit + moving + tiny)
    logarithm = jnp.log(unit) + 2 * jnp.log(speed) - jnp.log(stiffness)
    units = Units(jnp.min(jnp.exp(logarithm / (n + 1))), speed, unit)
    inertia = jnp.diagonal(mechanics.mass(state.time, state.position))
    speeds = speed * jnp.sqrt(unit / jnp.where(inertia > 0, inertia, unit))
    if mechanics.system.rate is None:
        positions = units.time * speeds
    else:
        paces = jax.jacfwd(lambda v: mechanics.rate(*at[:2], v))(at[2])
        positions = units.time * jnp.sum(jnp.abs(paces) * speeds[None], axis=1)
        positions = jnp.where(positions > 0, positions, units.time)
    gap = jnp.maximum(jnp.max(jnp.abs(opening.gap)) / units.length, 1)
    return Scales(
        units, positions, speeds, gap, _reach(mechanics, state) * positions / units.length
    )


def _typical_mass(mechanics: Mechanics, state: SystemState) -> Number:
    """Return the least effective mass of all gaps."""
    t, v = state.time, state.velocity
    masses = (mechanics.effective_mass(t, place, v) for place in _places(state.position))
    return jnp.min(jnp.minimum(*masses))


def _reach(mechanics: Mechanics, state: SystemState) -> Vector:
    """Return the largest derivative of a gap by each coordinate."""

    def at(q: Vector) -> Vector:
        gradient = jax.jacfwd(lambda q: mechanics.system.gap(state.time, q, mechanics.args))(q)
        return jnp.max(jnp.abs(gradient), axis=0)

    return jnp.maximum(*map(at, _places(state.position)))


def _places(q: Vector) -> tuple[Vector, Vector]:
    """Return a position and another one nearby, as a gap may be stationary where it starts: in the
    middle of a bearing.
    """
    finest = math.sqrt(jnp.finfo(q.dtype).eps)
    steps = finest * jnp.maximum(jnp.abs(q), finest) * (1 + jnp.arange(q.shape[0], dtype=q.dtype))
    return q, q + steps
