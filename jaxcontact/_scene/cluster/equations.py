"""Touching bodies as one system of equations: m_i a_i = m_i g_i + Σ F_k n_k over its pairs.

A pair k has the indentation δ, along the normal n from the second body to the first,

    δ = d - |x_first - x_second|   (spheres),        δ = d - n·(x_first - x_second)   (a plane),

the rate δ' = -n·(v_first - v_second) and the force F(δ, δ', v0) of its law. Everything is in units
of a length X, a speed V and a mass m of the cluster. Only the law receives SI quantities. A last
test finds whether the bodies have come to rest.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..._contact import Contact
from ..._coupled.energies import in_contact, stored_energy
from ..._coupled.modes import AT_REST, PAUSED, SLOWEST, Flag, Index, Modes, Number, Units
from ..._coupled.rows import rows_of
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
from ..bodies.motion import UserMotion
from .friction import Rub, Rubbing, Spins, SpringPairs, in_plane

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


def incidence_of(pairs: ClusterPairs, bodies: int, dtype: Any) -> Float[Array, "pairs bodies"]:
    """Return 1 at the first body of a pair, -1 at the second."""
    numbered = jnp.arange(bodies)[None]
    first, second = pairs.first[:, None] == numbered, pairs.second[:, None] == numbered
    signs = first.astype(dtype) - second.astype(dtype)
    return jnp.where(pairs.used[:, None], signs, 0)


class Touching(eqx.Module):
    """The equations of a cluster in its units. `apart` and `depth` belong to its start; `apart` has
    the signed lengths `start`, and is arbitrary for planes. `incidence` is that of its pairs.
    `in_line`: whether the bodies are spheres and walls in one dimension, without shells. `friction`
    is None without it, and `ends` if all contacts end at zero indentation.
    """

    law: AbstractLaw
    contact: Contact
    units: Units
    pairs: ClusterPairs
    apart: Float[Array, "pairs dim"]
    start: PerPair
    depth: PerPair
    inverse_mass: Float[Array, " bodies"]
    acceleration: PerBody
    drive: Drive | None
    incidence: Float[Array, "pairs bodies"]
    friction: SpringPairs | None
    ends: PerPair | None
    in_line: bool = eqx.field(static=True)

    def _between(self, vectors: PerBody) -> Float[Array, "pairs dim"]:
        """Return the vectors of the first bodies minus those of the second."""
        return small_product(self.incidence, vectors)

    def geometry(self, moved: PerBody, velocity: PerBody) -> Geometry:
        """Return the geometry of all pairs after the bodies have `moved` from the start."""
        pairs = self.pairs
        both = self._between(jnp.concatenate([moved, velocity], axis=1))
        dim = moved.shape[1]
        change, relative = both[:, :dim], both[:, dim:]
        before = self.apart
        if self.in_line:
            # Spheres outside of each other keep their order.
            normal = jnp.where(pairs.flat[:, None], pairs.normal, jnp.sign(before))
            rate = -(normal * relative)[:, 0]
            depth = self.depth - (normal * change)[:, 0]
            return Geometry(depth, rate, normal, jnp.zeros_like(depth))
        now = before + jnp.where(pairs.flat[:, None], 0, change)
        length = side(pairs.distance) * norm(now)
        approached = jnp.sum((2 * before + change) * change, axis=1) / (self.start + length)
        flat = jnp.sum(pairs.normal * change, axis=1)
        normal = jnp.where(pairs.flat[:, None], pairs.normal, now / length[:, None])
        rate = -jnp.sum(normal * relative, axis=1)
        across = relative + rate[:, None] * normal
        swirl = jnp.where(pairs.flat, 0, jnp.sum(jnp.square(across), axis=1) / length)
        depth = self.depth - jnp.where(pairs.flat, flat, approached)
        if self.friction is None:
            return Geometry(depth, rate, normal, swirl)
        turns = jnp.where(pairs.flat[:, None], 0, across / length[:, None])
        return Geometry(depth, rate, normal, swirl, across, turns)

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
        """Return the forces of the closed pairs as if none had vanished."""
        force = force_of_closed(*self._at(depth, rate, modes)) / self.units.force
        return jnp.where(modes.closed & self.pairs.used, force, 0)

    def pressing(self, depth: PerPair, rate: PerPair, modes: Modes) -> PerPair:
        """Return the numbers that fall through zero with forces, see `AbstractCoupledField`."""
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

    def on_planes(self, closed: Bool[Array, " pairs"]) -> Flag:
        """Return whether each body in contact touches one plane and nothing else."""
        bodies = jnp.arange(self.inverse_mass.shape[0])
        closed = closed & self.pairs.used
        planes = closed[:, None] & (self.pairs.first[:, None] == bodies[None])
        return jnp.all(self.pairs.flat | ~closed) & jnp.all(jnp.sum(planes, axis=0) <= 1)

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


def norm(vectors: Float[Array, "pairs dim"]) -> PerPair:
    return jnp.sqrt(jnp.sum(jnp.square(vectors), axis=1))


ASLEEP = PAUSED + 1
"""All bodies are at rest, however they support each other, until the time is up."""

_STILL = 100
"""The limit of speeds and of relative accelerations at rest, in step tolerances."""


def rest_of(
    system: Touching,
    closed: Bool[Array, " pairs"],
    along: tuple[PerPair, PerPair],
    moving: tuple[PerBody, PerBody],
    tolerance: Number,
) -> Index:
    """Return the kind of rest: AT_REST, ASLEEP or -1.

    AT_REST: each body in contact touches one plane, and δ' and δ'' of the pairs, `along`, vanish.
    It can then slide by formula. ASLEEP: bodies support each other and all are at rest. `moving`
    holds the velocities and accelerations of the bodies, in units of the cluster.
    """
    rate, second = along
    still = jnp.abs(rate) + jnp.abs(second) < _STILL * tolerance
    at_rest = jnp.all(still | ~(closed & system.pairs.used))
    # The weight may be tiny relative to contact accelerations. A body moved by it is not asleep.
    speed, pace = moving
    pull = jax.lax.stop_gradient(system.acceleration)
    weight = jnp.sqrt(jnp.max(jnp.sum(jnp.square(pull), axis=1)))
    weight = jnp.where(weight > 0, jnp.minimum(weight, 1), 1)
    stands = jnp.abs(speed) + jnp.abs(pace) / weight < _STILL * tolerance
    # A cluster with a moving fixed sphere is not asleep, either.
    fixed = (system.inverse_mass == 0)[:, None]
    asleep = jnp.all(jnp.where(fixed, jnp.abs(speed) < _STILL * tolerance, stands))
    if system.drive is not None:
        # A body on a shaking wall is never at rest.
        shakes, pairs = system.drive.shakes, system.pairs
        shaken = shakes[pairs.first] | shakes[pairs.second]
        at_rest = at_rest & ~jnp.any(closed & pairs.used & shaken)
        asleep = asleep & ~jnp.any(system.drive.moves)
    resting = jnp.where(asleep, ASLEEP, -1)
    if not (system.law.remembers or system.law.ends_apart):
        # Bodies that rest on planes are followed by formulas, which know no memory and no neck.
        resting = jnp.where(system.on_planes(closed), AT_REST, resting)
    return jnp.where(at_rest, resting, -1)
