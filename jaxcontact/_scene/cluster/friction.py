"""Friction in a cluster: one tangential spring and slider a pair, turned with the normal.

A pair with a ramp has the friction -μF min(|u|/v_d, 1) u/|u| in place of a spring.

A pair has the friction f on its first body, across the normal n, and the slip velocity

    u = v1 - v2 - w - (a1 ω1 + a2 ω2) × n,        I_i ω_i' = -a_i n × f,

with the velocity w of a wall along itself. The arms a1 + a2 = d - δ add up to the distance of the
centres, so that the angular momentum is kept: a_i = R_i - δ/2, or R - δ on a plane. The spring
turns with the plane of the contact, which adds -n (n'·f) to f'.

In units of a cluster a spin counts as s = R ω, the speed of the surface.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..._coupled.contacts import ScaledContacts
from ..._coupled.modes import Flags, Number, PerContact
from ..._coupled.rows import rows_of
from ..._coupled.springs import Springs, Vectors
from ..._functions import cross, ratio, small_product, swept

Spins = Float[Array, "bodies axes"]

HALF = 2
"""The number in `Rubbing.slides` of a pair whose friction acts in two halves."""


class Rubbing(NamedTuple):
    """The state of friction in SI units: spins (M, S), the spring forces (P, D) on the first of two
    bodies, 1 for pairs that slip, 0 for others, and the energy taken since the touch. Between calls
    a pair with a friction impulse has `HALF`, and its contact impulse so far in place of a force.
    """

    spin: Spins
    spring: Vectors
    slides: PerContact
    taken: PerContact


class PairFriction(NamedTuple):
    """The numbers of friction in SI units.

    - `mu`, `ratio`: μ and the ratio κ of tangential to normal stiffness, for each pair.
    - `ramp`: the speed v_d in m/s of each pair, 0 for one with a spring; None if all have springs.
    - `radius`, `inverse_inertia`: of each body; a plane has the radius 1, and does not turn.
    - `begins`: whether a pair touches just now.
    - `drift`, `wall`: the motions of walls in space, None if all are at rest; the wall of a pair.
    """

    mu: PerContact
    ratio: PerContact
    ramp: PerContact | None
    radius: Float[Array, " bodies"]
    inverse_inertia: Float[Array, " bodies"]
    begins: Bool[Array, " pairs"]
    drift: Any
    wall: Int[Array, " pairs"]


class Rub(NamedTuple):
    """Friction at one state: the force on the first bodies, and the slip velocities."""

    force: Vectors
    slip: Vectors


class SpringPairs(NamedTuple):
    """The friction of the pairs of a cluster in its units. `lean` (P, 2) is the inverse of both
    radii, 0 for planes; `turn` (M,) is R²/I. The solve starts at `start` in s. `drifts` and
    `wall` are those of `PairFriction`.
    """

    springs: Springs
    drifts: Any
    wall: Int[Array, " pairs"]
    start: Number
    first: Int[Array, " pairs"]
    second: Int[Array, " pairs"]
    flat: Bool[Array, " pairs"]
    lean: Float[Array, "pairs 2"]
    turn: Float[Array, " bodies"]
    incidence: Float[Array, "pairs bodies"]

    def _arms(self, depth: PerContact) -> Float[Array, "pairs 2"]:
        """Return the arms relative to the radii."""
        share = jnp.where(self.flat, 1, 0.5)
        return 1 - (share * depth)[:, None] * self.lean

    def drift(self, time: Number, normal: Vectors) -> Vectors:
        """Return the velocities of walls along themselves."""
        units = self.springs.contacts.units
        if self.drifts is None:
            return jnp.zeros_like(normal)
        now = self.start + units.time * time
        velocity = rows_of(self.drifts.velocity(now), self.wall) / units.speed
        return jnp.where(self.flat[:, None], in_plane(velocity, normal), 0)

    def slip(
        self, depth: PerContact, normal: Vectors, across: Vectors, spin: Spins, time: Number
    ) -> Vectors:
        """Return slip velocities; `across` are those of the centres across the normals."""
        arms = self._arms(depth)
        swirl = arms[:, :1] * rows_of(spin, self.first) + arms[:, 1:] * rows_of(spin, self.second)
        return across - self.drift(time, normal) - swept(swirl, normal)

    def twist(self, depth: PerContact, normal: Vectors, force: Vectors) -> Spins:
        """Return the rates of the spins."""
        arms, turns = self._arms(depth), cross(normal, force)
        first, second = jnp.maximum(self.incidence, 0), jnp.maximum(-self.incidence, 0)
        sums = small_product(first.T, arms[:, :1] * turns)
        sums = sums + small_product(second.T, arms[:, 1:] * turns)
        return -self.turn[:, None] * sums

    def energy(self, spin: Spins) -> Number:
        """Return ½ Σ I ω²."""
        return jnp.sum(ratio(1.0, self.turn)[:, None] * jnp.square(spin)) / 2


def in_plane(vectors: Vectors, normal: Vectors) -> Vectors:
    """Return the parts of vectors across the normals."""
    return vectors - jnp.sum(vectors * normal, axis=1, keepdims=True) * normal


def spring_pairs(
    numbers: PairFriction,
    contacts: ScaledContacts,
    start: Number,
    pairs: tuple[Int[Array, " pairs"], Int[Array, " pairs"], Flags],
    incidence: Float[Array, "pairs bodies"],
) -> SpringPairs:
    """Return the friction of pairs, `first`, `second` and `flat`, in units of a cluster."""
    units, (first, second, flat) = contacts.units, pairs
    ramp = None if numbers.ramp is None else numbers.ramp / units.speed
    springs = Springs(contacts, numbers.mu, numbers.ratio, ramp)
    lean = units.length / numbers.radius
    both = jnp.stack([rows_of(lean, first), jnp.where(flat, 0, rows_of(lean, second))], axis=1)
    turn = units.mass * jnp.square(numbers.radius) * numbers.inverse_inertia
    walls = numbers.drift, numbers.wall
    return SpringPairs(springs, *walls, start, first, second, flat, both, turn, incidence)
