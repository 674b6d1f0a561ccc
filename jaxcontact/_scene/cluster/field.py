"""The equations of a cluster as a field of coupled contacts. A state is one vector."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..._coupled.clock import ContactClock
from ..._coupled.field import TIME, AbstractCoupledField, Look, LoopRules, W
from ..._coupled.modes import Flags, Modes, Units
from ..._coupled.scalars import Index, Number
from .equations import Geometry, PerBody, PerPair, Touching, incidence_of
from .problem import ClusterProblem, scale_drive
from .rest import rest_of


class VectorLayout(NamedTuple):
    """The layout of a state vector; without damping it has no `lost` part."""

    bodies: int
    dim: int
    pairs: int
    damped: bool

    def pack(
        self, moved: PerBody, velocity: PerBody, lost: PerPair, rest: list[Number]
    ) -> Float[Array, " numbers"]:
        """Return the state vector; `rest` holds the work, the time and w."""
        taken = [lost] if self.damped else []
        return jnp.concatenate([moved.ravel(), velocity.ravel(), *taken, jnp.stack(rest)])

    def moved(self, y: Array) -> PerBody:
        return y[: self.bodies * self.dim].reshape(self.bodies, self.dim)

    def velocity(self, y: Array) -> PerBody:
        m = self.bodies * self.dim
        return y[m : 2 * m].reshape(self.bodies, self.dim)

    def lost(self, y: Array) -> PerPair:
        if not self.damped:
            return jnp.zeros(self.pairs, y.dtype)
        return y[2 * self.bodies * self.dim : -3]


@dataclasses.dataclass(frozen=True)
class ClusterField(AbstractCoupledField):
    """The equations of a cluster for its state as a vector, up to the time `until`. The velocities
    of the state are relative to its `frame`; `tolerance` is that of a step.
    """

    system: Touching
    parts: VectorLayout
    rules: LoopRules
    until: Number
    used: Flags
    frame: PerBody
    tolerance: Number

    def geometry(self, y: Array, clock: ContactClock) -> Geometry:
        """Return the geometry of all pairs; the leaving pair has the depth of the clock."""
        at = self.system.geometry(self.parts.moved(y), self.parts.velocity(y))
        return at._replace(depth=jnp.where(clock.leaving, jnp.square(y[W]), at.depth))

    def rate(self, y: Array, modes: Modes, clock: ContactClock) -> Array:
        """Return d/ds of a state."""
        velocity, at = self.parts.velocity(y), self.geometry(y, clock)
        acceleration, lost, work = self.system.motion(at, velocity, modes, y[TIME])
        pace = 2 * y[W]
        rest = [pace * work, pace, clock.rate(at.rate)]
        return self.parts.pack(pace * velocity, pace * acceleration, pace * lost, rest)

    def look(self, y: Array, modes: Modes, clock: ContactClock) -> Look:
        """Return the quantities of one state."""
        at = self.geometry(y, clock)
        force = self.system.force(at.depth, at.rate, modes)
        acceleration, _ = self.system.accelerations(at, force, y[TIME])
        return Look(at.depth, at.rate, self.system.second(at, acceleration), force)

    def approach(self, y: Array, clock: ContactClock) -> tuple[PerPair, PerPair]:
        at = self.geometry(y, clock)
        return at.depth, at.rate

    def force(self, depth: PerPair, rate: PerPair, modes: Modes) -> PerPair:
        return self.system.force(depth, rate, modes)

    def lost(self, y: Array) -> PerPair:
        return self.parts.lost(y)

    def with_lost(self, y: Array, lost: PerPair) -> Array:
        moved, velocity = self.parts.moved(y), self.parts.velocity(y)
        return self.parts.pack(moved, velocity, lost, [y[k] for k in (-3, -2, -1)])

    def resting(self, y: Array, toward: Array, pace: Number, now: Look, modes: Modes) -> Index:
        moving = self.parts.velocity(y) + self.frame, self.parts.velocity(toward) / pace
        along = now.rate, now.second
        return rest_of(self.system, modes.closed, along, moving, self.tolerance)

    def energy(self, y: Array, modes: Modes) -> Number:
        """Return the energy of bodies and contacts, plus the losses."""
        velocity = self.parts.velocity(y)
        depth = self.system.geometry(self.parts.moved(y), velocity).depth
        stored = jnp.sum(self.system.stored(depth, modes))
        return self.system.kinetic(velocity) + stored + jnp.sum(self.parts.lost(y))


def field_of(
    problem: ClusterProblem, rules: LoopRules, units: Units, frame: PerBody, in_line: bool
) -> ClusterField:
    """Return the field of a problem in its units; `frame` is in m/s."""
    state, pairs, (bodies, dim) = problem.state, problem.pairs, problem.state.position.shape
    free = (problem.inverse_mass > 0)[:, None]
    system = Touching(
        law=problem.law,
        contact=problem.contact,
        units=units,
        pairs=pairs,
        apart=pairs.between(state.position) / units.length,
        depth=state.indentation / units.length,
        inverse_mass=problem.inverse_mass * units.mass,
        acceleration=jnp.where(free, problem.acceleration, 0) / (units.speed / units.time),
        drive=scale_drive(problem.drive, units),
        incidence=incidence_of(pairs, bodies, state.position.dtype),
        in_line=in_line,
    )
    return ClusterField(
        system=system,
        parts=VectorLayout(bodies, dim, pairs.used.shape[0], problem.law.damped),
        rules=rules,
        until=(problem.until - state.time) / units.time,
        used=pairs.used,
        frame=frame / units.speed,
        tolerance=problem.tolerance,
    )
