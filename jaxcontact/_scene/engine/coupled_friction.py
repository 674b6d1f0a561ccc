"""Friction of the bodies in a coupled solve: its numbers, its start, and what follows from its end.

A regularised law acts there by its ramp, every other one by its μ and one spring.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..._coupled.rows import rows_of
from ..._coupled.scalars import Number
from ..._functions import spin_axes
from ..arrays.arrays import Numbers, SceneLayout
from ..arrays.flight import Flying
from ..cluster.equations import ClusterPairs, ClusterState
from ..cluster.friction import PairFriction, Rubbing
from ..pair_impact.friction import (
    SlipSpeeds,
    arms_of,
    coefficient_of,
    ramps_of,
    spring_ratio_of,
    wall_drift,
)
from ..pair_impact.rolling import footing, slips
from .cluster_slots import Slots, bodies_of, slot_pairs

Flags = Bool[Array, " P"]


def pair_friction(
    layout: SceneLayout,
    numbers: Numbers,
    seats: Slots,
    pairs: tuple[Int[Array, " P"], Int[Array, " P"]],
    begins: Flags,
) -> PairFriction | None:
    """Return the friction of the `pairs` of bodies, of which some touch just now; None without."""
    if numbers.rotation is None:
        return None
    one, other = pairs
    members = seats.who.shape[0]
    who = jnp.minimum(seats.who, layout.spheres - 1)
    flat = jnp.ones(layout.walls, numbers.dtype)
    turns = rows_of(numbers.rotation.inverse_inertia, who)
    turns = jnp.where(seats.present, turns, 0)
    wall = jnp.maximum(jnp.asarray(slot_pairs(layout, members)[1]) - members, 0)
    return PairFriction(
        mu=jax.vmap(lambda i, j: coefficient_of(layout, numbers, i, j))(one, other),
        ratio=jax.vmap(lambda i, j: spring_ratio_of(layout, numbers, i, j))(one, other),
        ramp=ramps_of(layout, numbers, one, other),
        radius=jnp.concatenate([rows_of(numbers.radius, who), flat]),
        inverse_inertia=jnp.concatenate([turns, jnp.zeros_like(flat)]),
        begins=begins,
        drift=numbers.rotation.drift if layout.walls else None,
        wall=wall,
    )


def fresh_rubbing(
    layout: SceneLayout,
    numbers: Numbers,
    seats: Slots,
    there: Flying,
    support: Int[Array, " M"],
    rests: Flags,
) -> Rubbing | None:
    """Return spins, and the friction of spheres that rest on walls; other pairs have none yet."""
    members, dtype = seats.who.shape[0], numbers.dtype
    first, _ = slot_pairs(layout, members)
    blank = blank_rubbing(layout, members + layout.walls, first.shape[0], dtype)
    if there.turning is None or blank is None:
        return None
    who = jnp.minimum(seats.who, layout.spheres - 1)
    still = jnp.zeros((layout.walls, spin_axes(layout.dimensions)), dtype)
    spin = jnp.concatenate([there.turning.spin, still])
    if not layout.walls:
        return blank._replace(spin=spin)
    inverse = rows_of(numbers.inverse_mass, who)
    force = there.turning.drag / jnp.where(inverse > 0, inverse, 1)[:, None]
    moves = slips(footing(layout, numbers, who, jnp.maximum(support, 0), there))
    spring = jnp.where(rests[:, None], rows_of(force, first), 0)
    slides = rests & rows_of(moves, first)
    return blank._replace(spin=spin, spring=spring, slides=slides.astype(dtype))


def joined_rubbing(
    fresh: Rubbing | None, before: Rubbing | None, came: Bool[Array, "slots 1"], new: Flags
) -> Rubbing | None:
    """Return the state of friction: `fresh` for bodies that `came` and `new` pairs."""
    if fresh is None or before is None:
        return None
    return Rubbing(
        jnp.where(came, fresh.spin, before.spin),
        jnp.where(new[:, None], fresh.spring, before.spring),
        jnp.where(new, fresh.slides, before.slides),
        jnp.where(new, fresh.taken, before.taken),
    )


def blank_rubbing(layout: SceneLayout, slots: int, pairs: int, dtype: Any) -> Rubbing | None:
    """Return no friction; None in a scene without."""
    if layout.frictions is None:
        return None
    spin = jnp.zeros((slots, spin_axes(layout.dimensions)), dtype)
    spring = jnp.zeros((pairs, layout.dimensions), dtype)
    each = jnp.zeros(pairs, dtype)
    return Rubbing(spin, spring, each, each)


def spin_energy_lost(
    layout: SceneLayout, numbers: Numbers, seats: Slots, began: ClusterState, end: ClusterState
) -> Number:
    """Return the energy of rotation that the members lose in a call, in J."""
    assert began.rubbing is not None and end.rubbing is not None and numbers.rotation is not None
    who, members = jnp.minimum(seats.who, layout.spheres - 1), seats.who.shape[0]
    turns = rows_of(numbers.rotation.inverse_inertia, who)
    counts = seats.present & (turns > 0)
    inertia = jnp.where(counts, 1 / jnp.where(counts, turns, 1), 0)
    spins = began.rubbing.spin[:members], end.rubbing.spin[:members]
    before, after = (jnp.sum(jnp.square(spin), axis=1) for spin in spins)
    return jnp.sum(inertia * (before - after)) / 2


def slip_velocities(
    layout: SceneLayout,
    numbers: Numbers,
    seats: Slots,
    pairs: ClusterPairs,
    state: ClusterState,
) -> Float[Array, "P D"]:
    """Return the slip velocities of the contact points of all pairs, at the distance of touch."""
    assert state.rubbing is not None
    members, spin = seats.who.shape[0], state.rubbing.spin
    one, other = bodies_of(layout, members, seats.who)
    first, second = slot_pairs(layout, members)
    apart = pairs.between(state.position)
    curved = (pairs.used & ~pairs.flat)[:, None]
    safe = jnp.where(curved, apart, 1)
    length = jnp.sqrt(jnp.sum(jnp.square(safe), axis=1, keepdims=True))
    outwards = jnp.where(pairs.distance < 0, -1, 1)[:, None]
    normal = jnp.where(pairs.flat[:, None], pairs.normal, outwards * safe / length)
    relative = state.velocity[first] - state.velocity[second]

    def of(i: Array, j: Array, n: Array, v: Array, spins: Array, wall: Array, flat: Array) -> Array:
        drift = wall_drift(numbers, wall, state.time, n)
        return arms_of(layout, numbers, i, j).slip(n, v - jnp.where(flat, drift, 0), spins)

    wall = jnp.maximum(jnp.asarray(second) - members, 0)
    spins = jnp.stack([spin[first], spin[second]], axis=1)
    return jax.vmap(of)(one, other, normal, relative, spins, wall, pairs.flat)


def speeds_of(before: Float[Array, "... D"], after: Float[Array, "... D"]) -> SlipSpeeds:
    """Return slip speeds before and after contacts; `after` is negative after a reversal."""
    one, other = (jnp.sum(jnp.square(x), axis=-1) for x in (before, after))
    sizes = [jnp.where(x > 0, jnp.sqrt(jnp.where(x > 0, x, 1)), 0) for x in (one, other)]
    reverses = jnp.sum(before * after, axis=-1) < 0
    return SlipSpeeds(sizes[0], jnp.where(reverses, -sizes[1], sizes[1]))
