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

from ..._coupled.clock import ContactClock
from ..._coupled.contacts import ScaledContacts
from ..._coupled.energies import ends_of, loses
from ..._coupled.field import TIME, AbstractCoupledField, Grip, Look, LoopRules, Settled, W
from ..._coupled.modes import AT_REST, PAUSED, Flags, Index, Modes, Number, Units, layout_of
from ..._coupled.rows import rows_of
from ..._coupled.springs import SpringMotion
from ..._functions import ratio, small_product
from ..bodies.bodies import side
from .friction import Rub, SpringPairs, in_plane, spring_pairs
from .problem import (
    ClusterPairs,
    ClusterProblem,
    Drive,
    PerBody,
    PerPair,
    Rubbed,
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
    walls in one dimension, without shells. `friction` is None without it.
    """

    pairs: ClusterPairs
    apart: Float[Array, "pairs dim"]
    start: PerPair
    start_depth: PerPair
    inverse_mass: Float[Array, " bodies"]
    acceleration: PerBody
    drive: Drive | None
    incidence: Float[Array, "pairs bodies"]
    friction: SpringPairs | None
    in_line: bool
    frame: PerBody
    tolerance: Number

    def rubbed(self, y: Array) -> Rubbed | None:
        """Return the part of a state that friction adds."""
        if self.friction is None:
            return None
        return Rubbed(*(self.parts.part(y, name) for name in Rubbed._fields))

    def bodies(self, y: Array) -> tuple[PerBody, PerBody]:
        """Return the motion of the bodies since the start, and their velocities."""
        return self.parts.part(y, "moved"), self.parts.part(y, "velocity")

    def _between(self, vectors: PerBody) -> Float[Array, "pairs dim"]:
        """Return the vectors of the first bodies minus those of the second."""
        pairs = self.pairs
        both = rows_of(vectors, pairs.first) - rows_of(vectors, pairs.second)
        return jnp.where(pairs.used[:, None], both, 0)

    def geometry_of(self, y: Array) -> Geometry:
        """Return the geometry of all pairs in a state."""
        pairs, (moved, velocity) = self.pairs, self.bodies(y)
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
        return at._replace(depth=self.by_clock(at.depth, y, clock))

    def indentations(self, y: Array) -> tuple[PerPair, PerPair]:
        return self.geometry_of(y)[:2]

    def pushes(
        self,
        geometry: Geometry,
        force: PerPair,
        time: Number,
        modes: Modes,
        rubbed: Rubbed | None,
    ) -> Pushes:
        """Return the forces on the bodies."""
        forces, rub = force[:, None] * geometry.normal, None
        if self.friction is not None and rubbed is not None:
            assert geometry.across is not None
            along = geometry.normal, geometry.across
            slip = self.friction.slip(geometry.depth, *along, rubbed.spin, time)
            spring, at = in_plane(rubbed.spring, geometry.normal), geometry[:2]
            rub = Rub(self.friction.springs.friction(spring, slip, force, at, modes), slip)
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

    def energy_and_depths(self, y: Array) -> tuple[Number, PerPair]:
        energy, rubbed = self.kinetic(self.bodies(y)[1]), self.rubbed(y)
        if rubbed is not None and self.friction is not None:
            energy = energy + self.friction.energy(rubbed.spin) + jnp.sum(rubbed.taken)
        return energy, self.geometry_of(y).depth

    def rate(self, y: Array, modes: Modes, clock: ContactClock) -> Array:
        """Return d/ds of a state."""
        velocity, at = self.bodies(y)[1], self.geometry(y, clock)
        rubbed, pace, rubs = self.rubbed(y), 2 * y[W], {}
        force = self.contacts.force(at.depth, at.rate, modes)
        pushes = self.pushes(at, force, y[TIME], modes, rubbed)
        work = self.supplied(at, velocity, y[TIME], pushes)
        lost = self.contacts.power(force, at.depth, at.rate, modes)
        if pushes.rub is not None and rubbed is not None and self.friction is not None:
            rub = pushes.rub
            twist = self.friction.twist(at.depth, at.normal, rub.force)
            springs = self._spring_motion(at, rubbed.spring, pushes, force, modes).rate
            taken = -jnp.sum(rub.force * rub.slip, axis=1)
            rubs = Rubbed(pace * twist, pace * springs, pace * taken)._asdict()
        return self.parts.pack(
            [pace * work, pace, clock.rate(at.rate)],
            moved=pace * velocity,
            velocity=pace * pushes.acceleration,
            lost=pace * lost,
            **rubs,
        )

    def _spring_motion(
        self, at: Geometry, spring: PerBody, pushes: Pushes, force: PerPair, modes: Modes
    ) -> SpringMotion:
        """Return the motion of springs, which turn with their planes."""
        rub = pushes.rub
        assert self.friction is not None and rub is not None and at.turns is not None
        along = at.depth, at.rate, self.second(at, pushes.acceleration)
        spring = in_plane(spring, at.normal)
        motion = self.friction.springs.motion(spring, rub.slip, force, along, modes)
        tilts = jnp.sum(at.turns * spring, axis=1, keepdims=True)
        return motion._replace(rate=motion.rate - at.normal * tilts)

    def look(self, y: Array, modes: Modes, clock: ContactClock) -> Look:
        """Return the quantities of one state."""
        at, rubbed = self.geometry(y, clock), self.rubbed(y)
        force = self.contacts.force(at.depth, at.rate, modes)
        pushes = self.pushes(at, force, y[TIME], modes, rubbed)
        second, press = self.second(at, pushes.acceleration), None
        if self.law.fades:
            press = self.contacts.pressing(at.depth, at.rate, modes)
        look = Look(at.depth, at.rate, second, force, press=press)
        if rubbed is None:
            return look
        hold = self._spring_motion(at, rubbed.spring, pushes, force, modes).hold
        return look._replace(grip=Grip(hold, -jnp.ones_like(hold), hold))

    def settled(
        self, y: Array, modes: Modes, touches: Flags, changes: Flags, friction: PerPair
    ) -> Settled:
        del friction
        at, rubbed = self.geometry_of(y), self.rubbed(y)
        assert rubbed is not None and self.friction is not None and at.across is not None
        slip = self.friction.slip(at.depth, at.normal, at.across, rubbed.spin, y[TIME])
        events = modes, touches, changes
        spring, modes = self.friction.springs.settled(rubbed.spring, slip, at[:2], *events)
        return Settled(self.parts.with_part(y, "spring", spring), modes, jnp.asarray(False))

    def resting(self, y: Array, toward: Array, pace: Number, now: Look, modes: Modes) -> Index:
        """Return the kind of rest: AT_REST, ASLEEP or -1.

        AT_REST: each body in contact touches one plane, and δ' and δ'' of the pairs vanish. It can
        then slide by formula. ASLEEP: bodies support each other and all are at rest.
        """
        moving = self.bodies(y)[1] + self.frame, self.bodies(toward)[1] / pace
        turning, twist = self.rubbed(y), self.rubbed(toward)
        if turning is not None and twist is not None:
            turns = turning.spin, twist.spin / pace
            speeds, paces = zip(moving, turns, strict=True)
            moving = jnp.concatenate(speeds, axis=1), jnp.concatenate(paces, axis=1)
        pairs, closed = self.pairs, modes.closed
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
    state, pairs = problem.state, problem.pairs
    free = (problem.inverse_mass > 0)[:, None]
    incidence = incidence_of(pairs, state.position.shape[0], state.position.dtype)
    ends = ends_of(problem.law, problem.contact, units.length, pairs.used.shape[0])
    contacts = ScaledContacts(problem.law, problem.contact, units, ends)
    # Planes and unused pairs get a length that is safe to divide by.
    curved = (pairs.used & ~pairs.flat)[:, None]
    apart = jnp.where(curved, pairs.between(state.position) / units.length, 1)
    friction, rubbing = None, {}
    if problem.friction is not None and state.rubbing is not None:
        who = pairs.first, pairs.second, pairs.flat
        friction = spring_pairs(problem.friction, contacts, state.time, who, incidence)
        rubbing = {name: getattr(state.rubbing, name) for name in Rubbed._fields}
    lost = state.lost if loses(problem.law) else None
    return ClusterField(
        contacts=contacts,
        parts=layout_of(moved=state.position, velocity=state.velocity, **rubbing, lost=lost),
        rules=rules,
        until=(problem.until - state.time) / units.time,
        pairs=pairs,
        apart=apart,
        start=side(pairs.distance) * norm(apart),
        start_depth=state.indentation / units.length,
        inverse_mass=problem.inverse_mass * units.mass,
        acceleration=jnp.where(free, problem.acceleration, 0) / (units.speed / units.time),
        drive=scale_drive(problem.drive, units),
        incidence=incidence,
        friction=friction,
        in_line=in_line,
        frame=frame / units.speed,
        tolerance=problem.tolerance,
    )
