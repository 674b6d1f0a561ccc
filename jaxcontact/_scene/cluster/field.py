"""The equations of a cluster as a field of coupled contacts. A state is one vector."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..._coupled.clock import ContactClock
from ..._coupled.energies import ends_of
from ..._coupled.field import TIME, WORK, AbstractCoupledField, Grip, Look, LoopRules, Settled, W
from ..._coupled.modes import Flags, Index, Modes, Number, Units
from ..._coupled.springs import SMALL, SpringMotion, settled_springs
from ..bodies.bodies import side
from .equations import Geometry, PerBody, PerPair, Pushes, Touching, incidence_of, norm, rest_of
from .friction import Spins, in_plane, spring_pairs
from .problem import ClusterProblem, scale_drive


class Rubbed(NamedTuple):
    """The part of a state that friction adds: spins, spring forces, and the energies taken."""

    spin: Spins
    spring: PerBody
    taken: PerPair


class VectorLayout(NamedTuple):
    """The layout of a state vector. If no contact `loses` energy it has no `lost` part, and without
    `axes` of spins none of friction.
    """

    bodies: int
    dim: int
    pairs: int
    loses: bool
    axes: int = 0

    def pack(
        self,
        moved: PerBody,
        velocity: PerBody,
        rubbed: Rubbed | None,
        lost: PerPair,
        rest: list[Number],
    ) -> Float[Array, " numbers"]:
        """Return the state vector; `rest` holds the work, the time and w."""
        taken = [lost] if self.loses else []
        turning = []
        if rubbed is not None:
            turning = [rubbed.spin.ravel(), rubbed.spring.ravel(), rubbed.taken]
        return jnp.concatenate([moved.ravel(), velocity.ravel(), *turning, *taken, jnp.stack(rest)])

    def moved(self, y: Array) -> PerBody:
        return y[: self.bodies * self.dim].reshape(self.bodies, self.dim)

    def velocity(self, y: Array) -> PerBody:
        m = self.bodies * self.dim
        return y[m : 2 * m].reshape(self.bodies, self.dim)

    def rubbed(self, y: Array) -> Rubbed | None:
        if not self.axes:
            return None
        first = 2 * self.bodies * self.dim
        spins, springs = self.bodies * self.axes, self.pairs * self.dim
        part = y[first : first + spins + springs + self.pairs]
        spin, spring, taken = jnp.split(part, [spins, spins + springs])
        spring = spring.reshape(self.pairs, self.dim)
        return Rubbed(spin.reshape(self.bodies, self.axes), spring, taken)

    def lost(self, y: Array) -> PerPair:
        if not self.loses:
            return jnp.zeros(self.pairs, y.dtype)
        return y[-3 - self.pairs : -3]


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
    ends: PerPair | None

    def geometry(self, y: Array, clock: ContactClock) -> Geometry:
        """Return the geometry of all pairs; the leaving pair has the depth of the clock."""
        at = self.system.geometry(self.parts.moved(y), self.parts.velocity(y))
        return at._replace(depth=jnp.where(clock.leaving, self.left_of(y[W]), at.depth))

    def _turning(self, y: Array) -> tuple[Spins, PerBody] | None:
        """Return spins and spring forces."""
        rubbed = self.parts.rubbed(y)
        return None if rubbed is None else rubbed[:2]

    def rate(self, y: Array, modes: Modes, clock: ContactClock) -> Array:
        """Return d/ds of a state."""
        velocity, at = self.parts.velocity(y), self.geometry(y, clock)
        turning, system = self._turning(y), self.system
        force, pace, rubbed = self.force(at.depth, at.rate, modes), 2 * y[W], None
        pushes = system.pushes(at, force, y[TIME], modes, turning)
        work, lost = system.supplied(at, velocity, y[TIME], pushes), jnp.zeros_like(force)
        if system.law.damped:
            lost = self.power(force, at.depth, at.rate, modes)
        rest = [pace * work, pace, clock.rate(at.rate)]
        if pushes.rub is not None and turning is not None:
            rub, friction = pushes.rub, system.friction
            assert friction is not None
            twist = friction.twist(at.depth, at.normal, rub.force)
            springs = self._spring_motion(at, turning[1], pushes, force, modes).rate
            taken = -jnp.sum(rub.force * rub.slip, axis=1)
            rubbed = Rubbed(pace * twist, pace * springs, pace * taken)
        moving = pace * velocity, pace * pushes.acceleration
        return self.parts.pack(*moving, rubbed, pace * lost, rest)

    def _spring_motion(
        self, at: Geometry, spring: PerBody, pushes: Pushes, force: PerPair, modes: Modes
    ) -> SpringMotion:
        """Return the motion of springs, which turn with their planes."""
        system, rub = self.system, pushes.rub
        assert system.friction is not None and rub is not None and at.turns is not None
        second = system.second(at, pushes.acceleration)
        grows = self.force_slope(modes, (at.depth, at.rate), (at.rate, second))
        spring = in_plane(spring, at.normal)
        depth, limit = (at.depth, at.rate), (force, grows)
        motion = system.friction.motion(system.contact, spring, rub.slip, depth, limit, modes)
        tilts = jnp.sum(at.turns * spring, axis=1, keepdims=True)
        return motion._replace(rate=motion.rate - at.normal * tilts)

    def look(self, y: Array, modes: Modes, clock: ContactClock) -> Look:
        """Return the quantities of one state."""
        at, turning = self.geometry(y, clock), self._turning(y)
        force = self.force(at.depth, at.rate, modes)
        pushes = self.system.pushes(at, force, y[TIME], modes, turning)
        second, press = self.system.second(at, pushes.acceleration), None
        if self.rules.fades:
            press = self.pressing(at.depth, at.rate, modes)
        look = Look(at.depth, at.rate, second, force, press=press)
        if turning is None:
            return look
        hold = self._spring_motion(at, turning[1], pushes, force, modes).hold
        return look._replace(grip=Grip(hold, -jnp.ones_like(hold), hold))

    def settled(
        self, y: Array, modes: Modes, touches: Flags, changes: Flags, friction: PerPair
    ) -> Settled:
        del friction
        system, parts, before, rubbed = self.system, self.parts, modes.slide, self.parts.rubbed(y)
        assert before is not None and rubbed is not None and system.friction is not None
        at = system.geometry(parts.moved(y), parts.velocity(y))
        assert at.across is not None
        units, numbers, contact = system.units, system.friction.numbers, system.contact
        slip = system.friction.slip(at.depth, at.normal, at.across, rubbed.spin, y[TIME])
        limit = numbers.mu * self.force(at.depth, at.rate, modes)
        small = jnp.full_like(at.depth, SMALL)
        stiff = contact.stiffness * (units.length * small) ** contact.exponent
        hardening = units.force * self.force(small, at.rate, modes) / stiff
        slips = system.friction.slips_at_touch(slip, at.rate, hardening)
        events = touches, changes, slips
        reach, spring = system.friction.reach(contact, at.depth, at.rate), rubbed.spring
        springs, slide = settled_springs(spring, slip, limit, before, events, reach)
        changed = modes.closed & (slide != before) | touches
        rubbed = rubbed._replace(spring=springs)
        rest = [y[WORK], y[TIME], y[W]]
        y = parts.pack(parts.moved(y), parts.velocity(y), rubbed, parts.lost(y), rest)
        return Settled(y, modes._replace(slide=slide), changed, jnp.asarray(False))

    def approach(self, y: Array, clock: ContactClock) -> tuple[PerPair, PerPair]:
        at = self.geometry(y, clock)
        return at.depth, at.rate

    def whole_force(self, depth: PerPair, rate: PerPair, modes: Modes) -> PerPair:
        return self.system.whole_force(depth, rate, modes)

    def pressing(self, depth: PerPair, rate: PerPair, modes: Modes) -> PerPair:
        return self.system.pressing(depth, rate, modes)

    def kept(self, deepest: PerPair, modes: Modes) -> PerPair:
        return self.system.kept(deepest, modes)

    def least(self, deepest: PerPair) -> PerPair:
        return self.system.least(deepest)

    def shrunk(self, depth: PerPair) -> PerPair:
        return self.system.shrunk(depth)

    def torn(self, modes: Modes) -> PerPair:
        assert self.ends is not None
        return self.system.stored(self.ends, modes)

    def lost(self, y: Array) -> PerPair:
        return self.parts.lost(y)

    def with_lost(self, y: Array, lost: PerPair) -> Array:
        moved, velocity = self.parts.moved(y), self.parts.velocity(y)
        rest = [y[k] for k in (-3, -2, -1)]
        return self.parts.pack(moved, velocity, self.parts.rubbed(y), lost, rest)

    def resting(self, y: Array, toward: Array, pace: Number, now: Look, modes: Modes) -> Index:
        moving = self.parts.velocity(y) + self.frame, self.parts.velocity(toward) / pace
        turning, twist = self.parts.rubbed(y), self.parts.rubbed(toward)
        if turning is not None and twist is not None:
            turns = turning.spin, twist.spin / pace
            speeds, paces = zip(moving, turns, strict=True)
            moving = jnp.concatenate(speeds, axis=1), jnp.concatenate(paces, axis=1)
        along = now.rate, now.second
        return rest_of(self.system, modes.closed, along, moving, self.tolerance)

    def energy(self, y: Array, modes: Modes) -> Number:
        """Return the energy of bodies and contacts, plus the losses."""
        velocity = self.parts.velocity(y)
        depth = self.system.geometry(self.parts.moved(y), velocity).depth
        energy = self.system.kinetic(velocity) + jnp.sum(self.system.stored(depth, modes))
        rubbed, friction = self.parts.rubbed(y), self.system.friction
        if rubbed is not None and friction is not None:
            energy = energy + friction.energy(rubbed.spin) + jnp.sum(rubbed.taken)
        return energy + jnp.sum(self.parts.lost(y))

    def turnover(self, y: Array, modes: Modes) -> Number:
        """Return the sum of all energies without their signs, and those of necks at their ends."""
        velocity = self.parts.velocity(y)
        stored = self.system.stored(
            self.system.geometry(self.parts.moved(y), velocity).depth, modes
        )
        contacts = jnp.abs(stored) + jnp.abs(self.parts.lost(y))
        if self.ends is not None:
            contacts = contacts + self.torn(modes)
        return self.system.kinetic(velocity) + jnp.sum(contacts)


def field_of(
    problem: ClusterProblem, rules: LoopRules, units: Units, frame: PerBody, in_line: bool
) -> ClusterField:
    """Return the field of a problem in its units; `frame` is in m/s."""
    state, pairs, (bodies, dim) = problem.state, problem.pairs, problem.state.position.shape
    free = (problem.inverse_mass > 0)[:, None]
    incidence = incidence_of(pairs, bodies, state.position.dtype)
    law = problem.law
    friction, axes, loses = None, 0, law.damped or law.remembers or law.ends_apart
    ends = ends_of(law, problem.contact, units.length, pairs.used.shape[0])
    # Planes and unused pairs get a length that is safe to divide by.
    curved = (pairs.used & ~pairs.flat)[:, None]
    apart = jnp.where(curved, pairs.between(state.position) / units.length, 1)
    if problem.friction is not None and state.rubbing is not None:
        who = pairs.first, pairs.second, pairs.flat
        friction = spring_pairs(problem.friction, units, state.time, who, incidence)
        axes = state.rubbing.spin.shape[1]
    system = Touching(
        law=law,
        contact=problem.contact,
        units=units,
        pairs=pairs,
        apart=apart,
        start=side(pairs.distance) * norm(apart),
        depth=state.indentation / units.length,
        inverse_mass=problem.inverse_mass * units.mass,
        acceleration=jnp.where(free, problem.acceleration, 0) / (units.speed / units.time),
        drive=scale_drive(problem.drive, units),
        incidence=incidence,
        friction=friction,
        ends=ends,
        in_line=in_line,
    )
    return ClusterField(
        system=system,
        parts=VectorLayout(bodies, dim, pairs.used.shape[0], loses, axes),
        rules=rules,
        until=(problem.until - state.time) / units.time,
        used=pairs.used,
        frame=frame / units.speed,
        tolerance=problem.tolerance,
        ends=ends,
    )
