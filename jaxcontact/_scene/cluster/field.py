"""Touching bodies as a field of coupled contacts: m_i a_i = m_i g_i + Σ F_k n_k over its pairs.

A pair k has the indentation δ, along the normal n from the second body to the first,

    δ = d - |x_first - x_second|   (spheres),        δ = d - n·(x_first - x_second)   (a plane),

the rate δ' = -n·(v_first - v_second) and the force F(δ, δ', v0) of its law. Everything is in units
of a length X, a speed V and a mass m of the cluster. Only the law receives SI quantities. A state
is one vector.
"""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..._contact import Contact
from ..._coupled.clock import ContactClock
from ..._coupled.energies import ends_of, in_contact, stored_energy
from ..._coupled.field import TIME, WORK, AbstractCoupledField, Grip, Look, LoopRules, Settled, W
from ..._coupled.modes import AT_REST, PAUSED, SLOWEST, Flags, Index, Modes, Number, Units
from ..._coupled.rows import rows_of
from ..._coupled.springs import SMALL, SpringMotion, settled_springs
from ..._functions import ratio, small_product
from ..._laws import (
    AbstractLaw,
    adhesion_below,
    energies_of,
    force_of_closed,
    pressing,
    shrunk_memory,
)
from ..bodies.bodies import side
from .friction import Rub, Spins, SpringPairs, in_plane, spring_pairs
from .problem import (
    ClusterPairs,
    ClusterProblem,
    Drive,
    PerBody,
    PerPair,
    Rubbed,
    VectorLayout,
    norm,
    scale_drive,
)

ASLEEP = PAUSED + 1
"""All bodies are at rest, however they support each other, until the time is up."""

_STILL = 100
"""The limit of speeds and of relative accelerations at rest, in step tolerances."""


class Geometry(NamedTuple):
    """The geometry of pairs: indentation, its rate, unit normals, and the turning part of δ''. With
    friction also the velocities of the centres `across` the normals, and the rates n' of those.
    """

    depth: PerPair
    rate: PerPair
    normal: Float[Array, "pairs dim"]
    swirl: PerPair
    across: Float[Array, "pairs dim"] | None = None
    turns: Float[Array, "pairs dim"] | None = None


class Pushes(NamedTuple):
    """The accelerations of the bodies, the sums of the contact forces on them, and their friction,
    None without.
    """

    acceleration: PerBody
    pushed: PerBody
    rub: Rub | None


@dataclasses.dataclass(frozen=True)
class ClusterField(AbstractCoupledField):
    """The equations of a cluster in its units, for its state as a vector, up to the time `until`.

    The velocities of the state are relative to its `frame`; `tolerance` is that of a step. `apart`
    and `start_depth` belong to the start; `apart` has the signed lengths `start`, and is arbitrary
    for planes. `incidence` is that of the pairs. `in_line`: whether the bodies are spheres and
    walls in one dimension, without shells. `friction` is None without it, and `ends` if all
    contacts end at zero indentation.
    """

    law: AbstractLaw
    contact: Contact
    units: Units
    pairs: ClusterPairs
    apart: Float[Array, "pairs dim"]
    start: PerPair
    start_depth: PerPair
    inverse_mass: Float[Array, " bodies"]
    acceleration: PerBody
    drive: Drive | None
    incidence: Float[Array, "pairs bodies"]
    friction: SpringPairs | None
    ends: PerPair | None
    in_line: bool
    parts: VectorLayout
    rules: LoopRules
    until: Number
    frame: PerBody
    tolerance: Number

    @property
    def used(self) -> Flags:
        """The pairs that are no blank ones."""
        return self.pairs.used

    def _between(self, vectors: PerBody) -> Float[Array, "pairs dim"]:
        """Return the vectors of the first bodies minus those of the second."""
        pairs = self.pairs
        both = rows_of(vectors, pairs.first) - rows_of(vectors, pairs.second)
        return jnp.where(pairs.used[:, None], both, 0)

    def geometry_of(self, y: Array) -> Geometry:
        """Return the geometry of all pairs in a state."""
        pairs, moved, velocity = self.pairs, self.parts.moved(y), self.parts.velocity(y)
        both = self._between(jnp.concatenate([moved, velocity], axis=1))
        dim = moved.shape[1]
        change, relative = both[:, :dim], both[:, dim:]
        before = self.apart
        if self.in_line:
            # Spheres outside of each other keep their order.
            normal = jnp.where(pairs.flat[:, None], pairs.normal, jnp.sign(before))
            rate = -(normal * relative)[:, 0]
            depth = self.start_depth - (normal * change)[:, 0]
            return Geometry(depth, rate, normal, jnp.zeros_like(depth))
        now = before + jnp.where(pairs.flat[:, None], 0, change)
        length = side(pairs.distance) * norm(now)
        approached = jnp.sum((2 * before + change) * change, axis=1) / (self.start + length)
        flat = jnp.sum(pairs.normal * change, axis=1)
        normal = jnp.where(pairs.flat[:, None], pairs.normal, now / length[:, None])
        rate = -jnp.sum(normal * relative, axis=1)
        across = relative + rate[:, None] * normal
        swirl = jnp.where(pairs.flat, 0, jnp.sum(jnp.square(across), axis=1) / length)
        depth = self.start_depth - jnp.where(pairs.flat, flat, approached)
        if self.friction is None:
            return Geometry(depth, rate, normal, swirl)
        turns = jnp.where(pairs.flat[:, None], 0, across / length[:, None])
        return Geometry(depth, rate, normal, swirl, across, turns)

    def geometry(self, y: Array, clock: ContactClock) -> Geometry:
        """Return the geometry of all pairs; the leaving pair has the depth of the clock."""
        at = self.geometry_of(y)
        return at._replace(depth=jnp.where(clock.leaving, self.left_of(y[W]), at.depth))

    def _at(self, depth: PerPair, rate: PerPair, modes: Modes) -> tuple[Any, ...]:
        """Return the law and its arguments in SI units."""
        units = self.units
        speed = jnp.where(modes.rising, jnp.maximum(rate, 0), modes.latched)
        speed = jnp.maximum(speed, SLOWEST)
        depth = in_contact(depth, self.ends)
        if not self.law.damped:
            rate = jnp.zeros_like(rate)
        arguments = (units.length * depth, units.speed * rate, self.contact, units.speed * speed)
        memory = modes.memory
        return self.law, *arguments, None if memory is None else units.length * memory

    def whole_force(self, depth: PerPair, rate: PerPair, modes: Modes) -> PerPair:
        force = force_of_closed(*self._at(depth, rate, modes)) / self.units.force
        return jnp.where(modes.closed & self.pairs.used, force, 0)

    def pressing(self, depth: PerPair, rate: PerPair, modes: Modes) -> PerPair:
        return pressing(*self._at(depth, rate, modes))

    def stored(self, depth: PerPair, modes: Modes) -> PerPair:
        """Return ∫ F(δ, 0) dδ of the closed pairs."""
        units, speed = self.units, jnp.maximum(modes.latched, SLOWEST)
        depth = jnp.where(modes.closed & self.pairs.used, units.length * depth, 0)
        deepest = None if modes.deepest is None else units.length * modes.deepest
        speed = units.speed * speed
        return stored_energy(self.law, self.contact, depth, speed, deepest) / units.energy

    def least(self, deepest: PerPair) -> PerPair:
        """Return the depths below which pairs that unload follow their adhesion."""
        return adhesion_below(self.law, self.units.length * deepest) / self.units.length

    def shrunk(self, depth: PerPair) -> PerPair:
        """Return the largest indentations of pairs that close again from there."""
        return shrunk_memory(self.law, self.units.length * depth) / self.units.length

    def kept(self, deepest: PerPair, modes: Modes) -> PerPair:
        """Return the energy that pairs with these largest indentations do not return."""
        units, speed = self.units, self.units.speed * jnp.maximum(modes.latched, SLOWEST)
        largest = units.length * jnp.maximum(deepest, 0)
        return energies_of(self.law, largest, self.contact, speed, largest)[1] / units.energy

    def torn(self, modes: Modes) -> PerPair:
        assert self.ends is not None
        return self.stored(self.ends, modes)

    def pushes(
        self,
        geometry: Geometry,
        force: PerPair,
        time: Number,
        modes: Modes,
        turning: tuple[Spins, PerBody] | None,
    ) -> Pushes:
        """Return the forces on the bodies. `turning` holds spins and spring forces."""
        forces, rub = force[:, None] * geometry.normal, None
        if self.friction is not None and turning is not None:
            spin, spring = turning
            assert geometry.across is not None
            along = geometry.normal, geometry.across
            slip = self.friction.slip(geometry.depth, *along, spin, time)
            reach = self.friction.reach(self.contact, geometry.depth, geometry.rate)
            spring = in_plane(spring, geometry.normal)
            rub = Rub(self.friction.force(spring, slip, force, modes, reach), slip)
            forces = forces + rub.force
        pushed = small_product(self.incidence.T, forces)
        acceleration = self.acceleration + self.inverse_mass[:, None] * pushed
        if self.drive is not None:
            swing = jnp.sin(self.drive.rate * time + self.drive.phase)
            acceleration = acceleration - swing[:, None] * self.drive.strength
            for user, body in self.drive.own:
                acceleration = acceleration.at[body].add(user.push(time), mode="drop")
        return Pushes(acceleration, pushed, rub)

    def second(self, geometry: Geometry, acceleration: PerBody) -> PerPair:
        """Return δ'' of the pairs."""
        relative = self._between(acceleration)
        return -jnp.sum(geometry.normal * relative, axis=1) - geometry.swirl

    def supplied(self, at: Geometry, velocity: PerBody, time: Number, pushes: Pushes) -> Number:
        """Return the power that weight and prescribed bodies supply."""
        free = (self.inverse_mass > 0)[:, None]
        weight = self.acceleration / jnp.where(free, self.inverse_mass[:, None], 1)
        work = jnp.sum(jnp.where(free, weight, -pushes.pushed) * velocity)
        if pushes.rub is not None and self.friction is not None:
            work = work + jnp.sum(pushes.rub.force * self.friction.drift(time, at.normal))
        return work

    def kinetic(self, velocity: PerBody) -> Number:
        """Return ½ Σ m v² of the free bodies."""
        return jnp.sum(ratio(1.0, self.inverse_mass)[:, None] * jnp.square(velocity)) / 2

    def _turning(self, y: Array) -> tuple[Spins, PerBody] | None:
        """Return spins and spring forces."""
        rubbed = self.parts.rubbed(y)
        return None if rubbed is None else rubbed[:2]

    def rate(self, y: Array, modes: Modes, clock: ContactClock) -> Array:
        """Return d/ds of a state."""
        velocity, at = self.parts.velocity(y), self.geometry(y, clock)
        turning = self._turning(y)
        force, pace, rubbed = self.force(at.depth, at.rate, modes), 2 * y[W], None
        pushes = self.pushes(at, force, y[TIME], modes, turning)
        work, lost = self.supplied(at, velocity, y[TIME], pushes), jnp.zeros_like(force)
        if self.law.damped:
            lost = self.power(force, at.depth, at.rate, modes)
        rest = [pace * work, pace, clock.rate(at.rate)]
        if pushes.rub is not None and turning is not None:
            rub, friction = pushes.rub, self.friction
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
        rub = pushes.rub
        assert self.friction is not None and rub is not None and at.turns is not None
        second = self.second(at, pushes.acceleration)
        grows = self.force_slope(modes, (at.depth, at.rate), (at.rate, second))
        spring = in_plane(spring, at.normal)
        depth, limit = (at.depth, at.rate), (force, grows)
        motion = self.friction.motion(self.contact, spring, rub.slip, depth, limit, modes)
        tilts = jnp.sum(at.turns * spring, axis=1, keepdims=True)
        return motion._replace(rate=motion.rate - at.normal * tilts)

    def look(self, y: Array, modes: Modes, clock: ContactClock) -> Look:
        """Return the quantities of one state."""
        at, turning = self.geometry(y, clock), self._turning(y)
        force = self.force(at.depth, at.rate, modes)
        pushes = self.pushes(at, force, y[TIME], modes, turning)
        second, press = self.second(at, pushes.acceleration), None
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
        parts, before, rubbed = self.parts, modes.slide, self.parts.rubbed(y)
        assert before is not None and rubbed is not None and self.friction is not None
        at = self.geometry_of(y)
        assert at.across is not None
        units, numbers, contact = self.units, self.friction.numbers, self.contact
        slip = self.friction.slip(at.depth, at.normal, at.across, rubbed.spin, y[TIME])
        limit = numbers.mu * self.force(at.depth, at.rate, modes)
        small = jnp.full_like(at.depth, SMALL)
        stiff = contact.stiffness * (units.length * small) ** contact.exponent
        hardening = units.force * self.force(small, at.rate, modes) / stiff
        slips = self.friction.slips_at_touch(slip, at.rate, hardening)
        events = touches, changes, slips
        reach, spring = self.friction.reach(contact, at.depth, at.rate), rubbed.spring
        springs, slide = settled_springs(spring, slip, limit, before, events, reach)
        changed = modes.closed & (slide != before) | touches
        rubbed = rubbed._replace(spring=springs)
        rest = [y[WORK], y[TIME], y[W]]
        y = parts.pack(parts.moved(y), parts.velocity(y), rubbed, parts.lost(y), rest)
        return Settled(y, modes._replace(slide=slide), changed, jnp.asarray(False))

    def approach(self, y: Array, clock: ContactClock) -> tuple[PerPair, PerPair]:
        at = self.geometry(y, clock)
        return at.depth, at.rate

    def lost(self, y: Array) -> PerPair:
        return self.parts.lost(y)

    def with_lost(self, y: Array, lost: PerPair) -> Array:
        moved, velocity = self.parts.moved(y), self.parts.velocity(y)
        rest = [y[k] for k in (-3, -2, -1)]
        return self.parts.pack(moved, velocity, self.parts.rubbed(y), lost, rest)

    def resting(self, y: Array, toward: Array, pace: Number, now: Look, modes: Modes) -> Index:
        """Return the kind of rest: AT_REST, ASLEEP or -1.

        AT_REST: each body in contact touches one plane, and δ' and δ'' of the pairs vanish. It can
        then slide by formula. ASLEEP: bodies support each other and all are at rest.
        """
        moving = self.parts.velocity(y) + self.frame, self.parts.velocity(toward) / pace
        turning, twist = self.parts.rubbed(y), self.parts.rubbed(toward)
        if turning is not None and twist is not None:
            turns = turning.spin, twist.spin / pace
            speeds, paces = zip(moving, turns, strict=True)
            moving = jnp.concatenate(speeds, axis=1), jnp.concatenate(paces, axis=1)
        pairs, closed = self.pairs, modes.closed & self.pairs.used
        still = jnp.abs(now.rate) + jnp.abs(now.second) < _STILL * self.tolerance
        at_rest = jnp.all(still | ~closed)
        # The weight may be tiny relative to contact accelerations; what it moves is not asleep.
        speed, pace = moving
        pull = jax.lax.stop_gradient(self.acceleration)
        weight = jnp.sqrt(jnp.max(jnp.sum(jnp.square(pull), axis=1)))
        weight = jnp.where(weight > 0, jnp.minimum(weight, 1), 1)
        stands = jnp.abs(speed) + jnp.abs(pace) / weight < _STILL * self.tolerance
        # A cluster with a moving fixed sphere is not asleep, either.
        fixed = (self.inverse_mass == 0)[:, None]
        asleep = jnp.all(jnp.where(fixed, jnp.abs(speed) < _STILL * self.tolerance, stands))
        if self.drive is not None:
            # A body on a shaking wall is never at rest.
            shakes = self.drive.shakes
            shaken = shakes[pairs.first] | shakes[pairs.second]
            at_rest = at_rest & ~jnp.any(closed & shaken)
            asleep = asleep & ~jnp.any(self.drive.moves)
        resting = jnp.where(asleep, ASLEEP, -1)
        if not (self.law.remembers or self.law.ends_apart):
            # Bodies that rest on planes are followed by formulas, which know no memory and no neck.
            bodies = jnp.arange(self.inverse_mass.shape[0])
            planes = closed[:, None] & (pairs.first[:, None] == bodies[None])
            on_planes = jnp.all(pairs.flat | ~closed) & jnp.all(jnp.sum(planes, axis=0) <= 1)
            resting = jnp.where(on_planes, AT_REST, resting)
        return jnp.where(at_rest, resting, -1)

    def energy(self, y: Array, modes: Modes) -> Number:
        """Return the energy of bodies and contacts, plus the losses."""
        velocity = self.parts.velocity(y)
        depth = self.geometry_of(y).depth
        energy = self.kinetic(velocity) + jnp.sum(self.stored(depth, modes))
        rubbed, friction = self.parts.rubbed(y), self.friction
        if rubbed is not None and friction is not None:
            energy = energy + friction.energy(rubbed.spin) + jnp.sum(rubbed.taken)
        return energy + jnp.sum(self.parts.lost(y))

    def turnover(self, y: Array, modes: Modes) -> Number:
        """Return the sum of all energies without their signs, and those of necks at their ends."""
        velocity = self.parts.velocity(y)
        stored = self.stored(self.geometry_of(y).depth, modes)
        contacts = jnp.abs(stored) + jnp.abs(self.parts.lost(y))
        if self.ends is not None:
            contacts = contacts + self.torn(modes)
        return self.kinetic(velocity) + jnp.sum(contacts)


def incidence_of(pairs: ClusterPairs, bodies: int, dtype: Any) -> Float[Array, "pairs bodies"]:
    """Return 1 at the first body of a pair, -1 at the second."""
    numbered = jnp.arange(bodies)[None]
    first, second = pairs.first[:, None] == numbered, pairs.second[:, None] == numbered
    signs = first.astype(dtype) - second.astype(dtype)
    return jnp.where(pairs.used[:, None], signs, 0)


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
    return ClusterField(
        law=law,
        contact=problem.contact,
        units=units,
        pairs=pairs,
        apart=apart,
        start=side(pairs.distance) * norm(apart),
        start_depth=state.indentation / units.length,
        inverse_mass=problem.inverse_mass * units.mass,
        acceleration=jnp.where(free, problem.acceleration, 0) / (units.speed / units.time),
        drive=scale_drive(problem.drive, units),
        incidence=incidence,
        friction=friction,
        ends=ends,
        in_line=in_line,
        parts=VectorLayout(bodies, dim, pairs.used.shape[0], loses, axes),
        rules=rules,
        until=(problem.until - state.time) / units.time,
        frame=frame / units.speed,
        tolerance=problem.tolerance,
    )
