"""A scene as arrays of one precision: what the engine works on."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..._contact import Contact, Material
from ..._impact import restitution_at_any_speed, restitution_is_constant
from ..._laws import AbstractLaw
from ..._parameter import Specialised
from ..bodies.bodies import Shell, Sphere
from ..bodies.mixed_law import MixedLaw, one_of_each
from ..bodies.overlap import ROUNDINGS
from ..bodies.scene import Scene
from ..bodies.side import side
from ..resume import Start
from .movers import Movers
from .rows import rows_of

Lane = Float[Array, "..."]


class Layout(eqx.Module):
    """What is static of a scene: N spheres, W walls, and what kinds of things there are.

    Bodies of the engine are the spheres in order, shells as fixed spheres of negative radius (of
    the N the first `visible` are none), then the walls: `body` and `face` say which body
    of the scene each of them is. `laws` and `stiffnesses` are tables by kind, () where one law or
    stiffness serves all; `constant` says of which laws e is the same at all speeds. Of the walls:
    which are `moving`, and which of these are accelerated (`vibrating`). Of the fixed spheres, by
    their numbers: which are `driven`, and which of these are accelerated (`shaken`).
    """

    spheres: int = eqx.field(static=True)
    visible: int = eqx.field(static=True)
    walls: int = eqx.field(static=True)
    dimensions: int = eqx.field(static=True)
    body: tuple[int, ...] = eqx.field(static=True)
    face: tuple[int, ...] = eqx.field(static=True)
    fixed: tuple[bool, ...] = eqx.field(static=True)
    kinds: tuple[int, ...] = eqx.field(static=True)
    laws: tuple[tuple[int, ...], ...] = eqx.field(static=True)
    stiffnesses: tuple[tuple[int, ...], ...] = eqx.field(static=True)
    constant: tuple[bool, ...] = eqx.field(static=True)
    gravity: bool = eqx.field(static=True)
    periodic: tuple[bool, ...] = eqx.field(static=True)
    moving: tuple[bool, ...] = eqx.field(static=True)
    vibrating: tuple[bool, ...] = eqx.field(static=True)
    driven: tuple[int, ...] = eqx.field(static=True)
    shaken: tuple[int, ...] = eqx.field(static=True)

    @property
    def settles(self) -> bool:
        """Whether a sphere that bounces out of time may come to rest on a wall."""
        return self.walls > 0 and self.gravity and any(self.constant)

    def chosen(self, table: tuple[tuple[int, ...], ...], i: Array, j: Array) -> Array:
        """The entry of a table for bodies i and j."""
        kinds, entries = jnp.asarray(self.kinds), jnp.asarray(table).ravel()
        return rows_of(entries, rows_of(kinds, i) * len(table) + rows_of(kinds, j))

    def shaken_row(self, who: Int[Array, "..."]) -> Int[Array, "..."]:
        """Which of those that are `shaken` some spheres are; how many there are for all others."""
        rows = np.full(self.spheres, len(self.shaken))
        rows[list(self.shaken)] = np.arange(len(self.shaken))
        return rows_of(jnp.asarray(rows), who)


class Walls(NamedTuple):
    """Where walls are at some time: `offset` in m, and their `velocity` along the normal in m/s."""

    offset: Lane
    velocity: Lane


class Numbers(eqx.Module):
    """The numbers of a scene that its motion depends on, all of one precision.

    Of the B = N + W bodies: `inverse_mass` (0 where fixed), `curvature` 1/R (0 of walls) and
    `compliance` (Hertz), None where not needed. `restitution` by law where it is constant, else 0.
    `offset` of walls at time zero; their `motion`, None where all of them stand; the `shaking` of
    fixed spheres that are accelerated, None where none is. `pull`: the acceleration of what is in
    flight, and of what rests on each wall. `start`: what rests or is in contact at
    time zero, None where nothing is.
    """

    position: Float[Array, "N D"]
    velocity: Float[Array, "N D"]
    radius: Float[Array, " N"]
    inverse_mass: Float[Array, " B"]
    normal: Float[Array, "W D"]
    offset: Float[Array, " W"]
    motion: Movers | None
    shaking: Movers | None
    gravity: Float[Array, " D"]
    pull: Float[Array, "W+1 D"]
    period: Float[Array, " D"]
    restitution: Float[Array, " L"]
    laws: tuple[Any, ...]
    stiffness: Float[Array, " S"] | None
    compliance: Float[Array, " B"] | None
    exponent: Specialised
    start: Start | None

    @property
    def dtype(self) -> Any:
        """The precision of all numbers."""
        return self.position.dtype

    def walls_at(self, time: Lane, which: Int[Array, ""] | None = None) -> Walls:
        """The walls at a time, or one of them."""
        offset = self.offset if which is None else rows_of(self.offset, which)
        if self.motion is None:
            return Walls(offset, jnp.zeros_like(offset))
        shift, velocity = self.motion.shift(time), self.motion.velocity(time)
        if which is not None:
            shift, velocity = rows_of((shift, velocity), which)
        return Walls(offset + shift, velocity)

    def shaken_at(
        self, layout: Layout, time: Float[Array, ""]
    ) -> tuple[Float[Array, "K D"], Float[Array, "K D"]]:
        """Where the fixed spheres that are accelerated are at a time, and how fast."""
        assert self.shaking is not None
        start = self.position[np.array(layout.shaken)]
        return start + self.shaking.shift(time), self.shaking.velocity(time)

    def bent_at(
        self, layout: Layout, who: Int[Array, ""], now: Float[Array, ""], time: Float[Array, ""]
    ) -> tuple[Float[Array, " D"], Float[Array, " D"]]:
        """By how much a sphere departs until `time` later from going on at the velocity that it
        has `now`, and its velocity; zeros for one that is not `shaken`.
        """
        assert self.shaking is not None
        row = layout.shaken_row(who)
        high, fast = self.shaking.swing(now, time)
        velocity = self.shaking.velocity(now)
        bent, turned = high - velocity * time, fast - velocity
        bent, turned = (jnp.concatenate([x, jnp.zeros_like(x[:1])]) for x in (bent, turned))
        return rows_of((bent, turned), row)


def layout_of(scene: Scene) -> Layout:
    """The static part of a scene."""
    spheres = [k for k, body in enumerate(scene.bodies) if isinstance(body, Sphere)]
    shells = [k for k, body in enumerate(scene.bodies) if isinstance(body, Shell)]
    visible, spheres = len(spheres), spheres + shells
    walls = [(k, wall) for k, body in enumerate(scene.bodies) for wall in body.walls()]
    order = [*spheres, *(k for k, _ in walls)]
    motions = [body.motion for body in curved(scene)]
    table = scene.stiffness
    return Layout(
        spheres=len(spheres),
        visible=visible,
        walls=len(walls),
        dimensions=scene.dimensions,
        body=tuple(order),
        face=(*(-1 for _ in spheres), *(wall.face for _, wall in walls)),
        fixed=(*(sphere.fixed for sphere in scene.spheres), *(True for _ in shells)),
        kinds=tuple(scene._kinds[k] for k in order),
        laws=() if scene.law.alike else scene.law.table,
        stiffnesses=() if table is None or table.alike else table.table,
        constant=tuple(_is_constant(law) for law in scene.law.values),
        gravity=scene.gravity is not None,
        periodic=tuple(length is not None for length in scene.periodic),
        moving=tuple(wall.motion is not None for _, wall in walls),
        vibrating=tuple(wall.vibrates for _, wall in walls),
        driven=tuple(k for k, motion in enumerate(motions) if motion is not None),
        shaken=tuple(k for k, m in enumerate(motions) if m is not None and m.vibrates),
    )


def curved(scene: Scene) -> list[Sphere | Shell]:
    """Spheres and shells, as the engine numbers them."""
    shells = [body for body in scene.bodies if isinstance(body, Shell)]
    return [*scene.spheres, *shells]


def _is_constant(law: AbstractLaw) -> bool:
    leaves, structure = jax.tree.flatten(law)
    kinds = tuple((jnp.shape(leaf), jnp.result_type(leaf)) for leaf in leaves)
    return _is_constant_by_kind(structure, kinds)


@functools.lru_cache(maxsize=256)
def _is_constant_by_kind(structure: Any, kinds: tuple[Any, ...]) -> bool:
    """Traced once a kind of law: its numbers do not matter."""
    leaves = [jax.ShapeDtypeStruct(*kind) for kind in kinds]
    law = jax.tree.unflatten(structure, leaves)
    return restitution_is_constant(law, None)


def contact_of(layout: Layout, numbers: Numbers, i: Array, j: Array) -> Contact | None:
    """The contact of bodies i and j; None where no stiffness is known."""
    inverse = rows_of(numbers.inverse_mass, i) + rows_of(numbers.inverse_mass, j)
    # Two fixed bodies never meet; any mass will do.
    mass = 1 / jnp.where(inverse > 0, inverse, 1)
    if numbers.stiffness is not None:
        stiffness = numbers.stiffness[0]
        if layout.stiffnesses:
            stiffness = rows_of(numbers.stiffness, layout.chosen(layout.stiffnesses, i, j))
        return Contact(mass, stiffness, numbers.exponent.value)
    if numbers.compliance is None:
        return None
    one = jnp.ones((), numbers.dtype)
    curvature = jnp.concatenate([1 / numbers.radius, jnp.zeros(layout.walls, numbers.dtype)])
    # A rigid plane under a sphere with the radius and the compliance of the pair.
    (soft, bent), (softer, more) = (rows_of((numbers.compliance, curvature), k) for k in (i, j))
    pair = Material(one / (soft + softer), 0 * one)
    return Contact.sphere_plane(one / (bent + more), pair, mass=mass)


def known_contact_of(layout: Layout, numbers: Numbers, i: Array, j: Array) -> Contact:
    """The contact of bodies i and j in a scene of which every stiffness is known."""
    contact = contact_of(layout, numbers, i, j)
    assert contact is not None
    return contact


def laws_of(
    layout: Layout, numbers: Numbers, i: Array, j: Array
) -> tuple[Sequence[AbstractLaw], Int[Array, ""]]:
    """A law of every kind there is, and which of them is that of bodies i and j."""
    if len(numbers.laws) == 1:
        return numbers.laws, jnp.asarray(0)
    return one_of_each(numbers.laws, layout.chosen(layout.laws, i, j))


def law_of(layout: Layout, numbers: Numbers, i: Array, j: Array) -> AbstractLaw:
    """The law of bodies i and j, by its force."""
    laws, kind = laws_of(layout, numbers, i, j)
    return laws[0] if len(laws) == 1 else MixedLaw(tuple(laws), kind.astype(numbers.dtype))


def least_speed(numbers: Numbers) -> Float[Array, ""]:
    """A rounding of the speeds of a scene in m/s, as they are at the start or weight makes them."""
    radius = jnp.max(jnp.abs(numbers.radius))
    pull = jnp.sqrt(jnp.sum(jnp.square(numbers.gravity))) * radius
    square = jnp.max(jnp.square(numbers.velocity)) + pull
    small = jnp.finfo(numbers.dtype)
    return jax.lax.stop_gradient(small.eps * jnp.sqrt(square + float(small.tiny) ** 0.5))


def restitution_of(
    layout: Layout, numbers: Numbers, i: Array, j: Array, closing: Lane
) -> Float[Array, ""]:
    """The e that the law of bodies i and j delivers at a closing speed."""
    which = layout.chosen(layout.laws, i, j) if layout.laws else None
    if all(layout.constant):
        return numbers.restitution[0] if which is None else rows_of(numbers.restitution, which)
    contact = known_contact_of(layout, numbers, i, j)
    speed = jnp.maximum(closing, least_speed(numbers))

    def of(k: int) -> Callable[[Lane], Lane]:
        if layout.constant[k]:
            return lambda speed: numbers.restitution[k]
        return lambda speed: restitution_at_any_speed(numbers.laws[k], contact, speed)

    if which is None:
        return of(0)(speed)
    return jax.lax.switch(which, [of(k) for k in range(len(numbers.laws))], speed)


def first_overlap(layout: Layout, numbers: Numbers) -> Float[Array, ""]:
    """The deepest overlap of two bodies beyond rounding, in m; 0 where there is none, or where
    contacts go on from a run.
    """
    if numbers.start is not None:
        return jnp.zeros((), numbers.dtype)
    rounding = ROUNDINGS * jnp.finfo(numbers.dtype).eps
    scale = jnp.max(jnp.abs(numbers.position)) + 2 * jnp.max(numbers.radius)
    moves = numbers.inverse_mass[: layout.spheres] > 0

    def row(i: Int[Array, ""]) -> Array:
        apart = nearest_image(layout, numbers, numbers.position[i][None] - numbers.position)[0]
        distance = numbers.radius[i] + numbers.radius
        gap = side(distance) * jnp.sqrt(jnp.sum(jnp.square(apart), axis=-1)) - distance
        counts = (jnp.arange(layout.spheres) != i) & (moves | moves[i])
        deep = jnp.max(jnp.where(counts, -gap, -jnp.inf))
        for w in range(layout.walls):
            height = jnp.sum(numbers.position[i] * numbers.normal[w]) - numbers.offset[w]
            deep = jnp.maximum(deep, jnp.where(moves[i], numbers.radius[i] - height, -jnp.inf))
        return deep

    deepest = jnp.max(jax.lax.map(row, jnp.arange(layout.spheres)))
    return jnp.where(deepest > rounding * scale, deepest, 0)


def nearest_image(
    layout: Layout, numbers: Numbers, apart: Float[Array, "N D"]
) -> tuple[Float[Array, "N D"], Float[Array, "N D"]]:
    """Distances to the nearest image along periodic axes, and how many periods were taken off."""
    if not any(layout.periodic):
        return apart, jnp.zeros_like(apart)
    axes = jnp.asarray(layout.periodic)[None]
    shift = jnp.where(axes, jnp.round(apart / numbers.period[None]), 0)
    return apart - shift * numbers.period[None], shift
