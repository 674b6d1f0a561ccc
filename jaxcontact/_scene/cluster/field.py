"""The motion of a cluster between two events as a field in its clock's variable, with event gaps.
The gaps fall through zero at events. A state is one vector.
"""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..scalars import Number
from .clock import ClusterClock
from .equations import Geometry, Modes, PerBody, PerPair, Touching, Units, incidence_of
from .problem import ClusterProblem, ClusterRules, scale_drive

WORK, TIME, W = -3, -2, -1
"""The indices of work, time and w in the vector of a state."""


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

    def with_w(self, y: Array, w: Number) -> Float[Array, " numbers"]:
        """Return the state with another w."""
        return jnp.concatenate([y[:W], w[None]])

    def moved(self, y: Array) -> PerBody:
        return y[: self.bodies * self.dim].reshape(self.bodies, self.dim)

    def velocity(self, y: Array) -> PerBody:
        m = self.bodies * self.dim
        return y[m : 2 * m].reshape(self.bodies, self.dim)

    def lost(self, y: Array) -> PerPair:
        if not self.damped:
            return jnp.zeros(self.pairs, y.dtype)
        return y[2 * self.bodies * self.dim : -3]


class Look(NamedTuple):
    """The quantities needed at the end of a step, or their slopes in s."""

    depth: PerPair
    rate: PerPair
    second: PerPair
    force: PerPair


@dataclasses.dataclass(frozen=True)
class ClusterField:
    """The equations of a cluster for its state as a vector, up to the time `until`."""

    system: Touching
    parts: VectorLayout
    rules: ClusterRules
    until: Number

    def geometry(self, y: Array, clock: ClusterClock) -> Geometry:
        """Return the geometry of all pairs; the leaving pair has the depth of the clock."""
        at = self.system.geometry(self.parts.moved(y), self.parts.velocity(y))
        return at._replace(depth=jnp.where(clock.leaving, jnp.square(y[W]), at.depth))

    def rate(self, y: Array, modes: Modes, clock: ClusterClock) -> Array:
        """Return d/ds of a state."""
        velocity, at = self.parts.velocity(y), self.geometry(y, clock)
        acceleration, lost, work = self.system.motion(at, velocity, modes, y[TIME])
        pace = 2 * y[W]
        rest = [pace * work, pace, clock.rate(at.rate)]
        return self.parts.pack(pace * velocity, pace * acceleration, pace * lost, rest)

    def look(self, y: Array, modes: Modes, clock: ClusterClock) -> Look:
        """Return the quantities of one state."""
        at = self.geometry(y, clock)
        force = self.system.force(at.depth, at.rate, modes)
        acceleration, _ = self.system.accelerations(at, force, y[TIME])
        return Look(at.depth, at.rate, self.system.second(at, acceleration), force)

    def look_along(
        self, y: Array, modes: Modes, clock: ClusterClock, toward: Array
    ) -> tuple[Look, Look]:
        """Return the quantities of one state, and their slopes along `toward`."""
        if self.rules.peak:
            return jax.jvp(lambda y: self.look(y, modes, clock), (y,), (toward,))
        # No event needs the slope of δ''.
        now, pace = self.look(y, modes, clock), 2 * y[W]
        slopes = (pace * now.rate, pace * now.second)
        force = self.force_slope(modes, (now.depth, now.rate), slopes)
        return now, Look(*slopes, jnp.zeros_like(force), force)

    def force_slope(
        self, modes: Modes, at: tuple[PerPair, PerPair], along: tuple[PerPair, PerPair]
    ) -> PerPair:
        """Return the slope of the forces if depths and their rates change `along`."""
        return jax.jvp(lambda d, r: self.system.force(d, r, modes), at, along)[1]

    def gaps(
        self, modes: Modes, clock: ClusterClock, at: Look, w: Array, latched: Any, left: Array
    ) -> Any:
        """Return the gaps that fall through zero at events, or their slopes if slopes are given."""
        meets = jnp.where(clock.leaving, w, jnp.where(modes.closed, at.depth, -at.depth))
        if not self.rules.peak:
            return jnp.concatenate([meets, left[None]])
        latches = jnp.where(modes.rising, at.second, latched - at.rate)
        return jnp.concatenate([meets, latches, left[None]])

    def has_passed(self, modes: Modes, at: Look, gaps: Array) -> Bool[Array, " events"]:
        """Return which gaps are negative because of an event, not because of rounding."""
        used = self.system.pairs.used
        inwards = jnp.where(modes.closed, at.rate < 0, at.rate > 0)
        meets, last = used & inwards, jnp.ones(1, bool)
        if not self.rules.peak:
            return (gaps < 0) & jnp.concatenate([meets, last])
        latches = used & modes.closed & (modes.rising | (at.second > 0))
        return (gaps < 0) & jnp.concatenate([meets, latches, last])

    def energy(self, y: Array, modes: Modes) -> Number:
        """Return the energy of bodies and contacts, plus the losses."""
        velocity = self.parts.velocity(y)
        depth = self.system.geometry(self.parts.moved(y), velocity).depth
        stored = jnp.sum(self.system.stored(depth, modes))
        return self.system.kinetic(velocity) + stored + jnp.sum(self.parts.lost(y))


def field_of(problem: ClusterProblem, rules: ClusterRules, units: Units) -> ClusterField:
    """Return the field of a problem in its units."""
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
        in_line=rules.in_line,
    )
    parts = VectorLayout(bodies, dim, pairs.used.shape[0], problem.law.damped)
    return ClusterField(system, parts, rules, (problem.until - state.time) / units.time)
