"""A scene as arrays of one precision, for the engine, and spheres in flight: on parabolas, or in
prescribed motion.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..._contact import Contact
from ..._coupled.modes import Index, Number
from ..._coupled.rows import rows_of
from ..._entry import Specialised
from ..._impact import restitution_at_any_speed, restitution_is_constant
from ..._laws import AbstractLaw
from ..bodies.bodies import Shell, Sphere, Wall, shells_of, side, spheres_of, walls_of
from ..bodies.mixed_law import MixedLaw, one_of_each
from ..bodies.overlap import ROUNDINGS
from ..bodies.scene import Scene
from ..resume import Start
from .movers import Movers, Rotation, Turning

Lane = Float[Array, "..."]


class SceneLayout(eqx.Module):
    """The static part of a scene: N spheres, W walls, and their kinds.

    The engine numbers the spheres first, in order, then shells as fixed spheres of negative radius,
    then the walls. N includes the shells; the first `visible` are true spheres. `body` and `face`
    give the body of the scene and the face of a box for each number.

    `law_table` and `stiffnesses` are tables by kind, or () if one law or stiffness serves all.
    `constant` marks laws whose restitution is independent of speed. `moving` marks walls in motion,
    and `vibrating` those that are accelerated. `driven` lists the fixed spheres in motion, and
    `shaken` those that are accelerated. `frictions` is the table of friction laws by kind, () if
    one serves all, and None without friction. `remembers`: whether a force depends on the largest
    indentation of its contact.
    """

    spheres: int = eqx.field(static=True)
    visible: int = eqx.field(static=True)
    walls: int = eqx.field(static=True)
    dimensions: int = eqx.field(static=True)
    body: tuple[int, ...] = eqx.field(static=True)
    face: tuple[int, ...] = eqx.field(static=True)
    fixed: tuple[bool, ...] = eqx.field(static=True)
    kinds: tuple[int, ...] = eqx.field(static=True)
    law_table: tuple[tuple[int, ...], ...] = eqx.field(static=True)
    stiffnesses: tuple[tuple[int, ...], ...] = eqx.field(static=True)
    constant: tuple[bool, ...] = eqx.field(static=True)
    has_gravity: bool = eqx.field(static=True)
    periodic: tuple[bool, ...] = eqx.field(static=True)
    moving: tuple[bool, ...] = eqx.field(static=True)
    vibrating: tuple[bool, ...] = eqx.field(static=True)
    driven: tuple[int, ...] = eqx.field(static=True)
    shaken: tuple[int, ...] = eqx.field(static=True)
    frictions: tuple[tuple[int, ...], ...] | None = eqx.field(static=True)
    remembers: bool = eqx.field(static=True)

    @property
    def settles(self) -> bool:
        """True if a ball may come to rest on a wall after instantaneous impacts."""
        return self.walls > 0 and self.has_gravity and any(self.constant)

    def chosen(self, table: tuple[tuple[int, ...], ...], i: Array, j: Array) -> Array:
        """Return the entry of a table for bodies i and j."""
        kinds, entries = jnp.asarray(self.kinds), jnp.asarray(table).ravel()
        return rows_of(entries, rows_of(kinds, i) * len(table) + rows_of(kinds, j))

    def shaken_row(self, who: Int[Array, "..."]) -> Int[Array, "..."]:
        """Return the index of spheres among the `shaken`; the number of these for all others."""
        rows = np.full(self.spheres, len(self.shaken))
        rows[list(self.shaken)] = np.arange(len(self.shaken))
        return rows_of(jnp.asarray(rows), who)


class Walls(NamedTuple):
    """The walls at one time: `offset` in m, and `velocity` along the normal in m/s."""

    offset: Lane
    velocity: Lane


class SceneArrays(SceneLayout):
    """A scene with the numbers that determine its motion, all of one precision.

    For B = N + W bodies: `inverse_mass` is 0 for fixed ones, and `compliance` is that of Hertz's
    contact, None if not needed. `restitution` has a number for each law: its constant e, else 0.
    `offset` is that of the walls at time zero. `motion` is that of the walls, None if all are at
    rest. `shaking` is the motion of accelerated fixed spheres, None if there are none. `pull` is
    the acceleration in flight, followed by that of a sphere at rest on each wall. `start` holds
    rest and contacts at time zero, None if there are none. `rotation` is None without friction.
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
    rotation: Rotation | None = None

    @property
    def dtype(self) -> Any:
        """The precision of all numbers."""
        return self.position.dtype

    def walls_at(self, time: Lane, which: Index | None = None) -> Walls:
        """Return the walls at a time, or one of them."""
        offset = self.offset if which is None else rows_of(self.offset, which)
        if self.motion is None:
            return Walls(offset, jnp.zeros_like(offset))
        shift, velocity = self.motion.shift(time), self.motion.velocity(time)
        if which is not None:
            shift, velocity = rows_of((shift, velocity), which)
        return Walls(offset + shift, velocity)

    def shaken_at(self, time: Number) -> tuple[Float[Array, "K D"], Float[Array, "K D"]]:
        """Return the positions and velocities of the accelerated fixed spheres at a time."""
        assert self.shaking is not None
        start = self.position[np.array(self.shaken)]
        return start + self.shaking.shift(time), self.shaking.velocity(time)

    def bent_at(
        self, who: Index, now: Number, time: Number
    ) -> tuple[Float[Array, " D"], Float[Array, " D"]]:
        """Return a sphere's deviation from uniform motion between `now` and `time` later. The
        second value is the change of its velocity. Both are zero unless the sphere is `shaken`.
        """
        assert self.shaking is not None
        row = self.shaken_row(who)
        high, fast = self.shaking.swing(now, time)
        velocity = self.shaking.velocity(now)
        bent, turned = high - velocity * time, fast - velocity
        bent, turned = (jnp.concatenate([x, jnp.zeros_like(x[:1])]) for x in (bent, turned))
        return rows_of((bent, turned), row)


def layout_of(scene: Scene) -> SceneLayout:
    """Return the static part of a scene."""
    numbered = [*spheres_of(scene.bodies), *shells_of(scene.bodies)]
    walls = walls_of(scene.bodies)
    order = [k for k, _ in (*numbered, *walls)]
    return SceneLayout(
        spheres=len(numbered),
        visible=len(scene.spheres),
        walls=len(walls),
        dimensions=scene.dimensions,
        body=tuple(order),
        face=(*(-1,) * len(numbered), *(wall.face for _, wall in walls)),
        fixed=tuple(body.fixed for _, body in numbered),
        kinds=tuple(scene._kinds[k] for k in order),
        law_table=scene.law.by_kind,
        stiffnesses=() if scene.stiffness is None else scene.stiffness.by_kind,
        constant=tuple(map(_is_constant, scene.law.values)),
        has_gravity=scene.gravity is not None,
        periodic=tuple(length is not None for length in scene.periodic),
        frictions=None if scene.friction is None else scene.friction.by_kind,
        remembers=any(law.remembers for law in scene.law.values),
        **_in_motion(walls, curved(scene)),
    )


def _in_motion(
    walls: Sequence[tuple[int, Wall]], bodies: Sequence[Sphere | Shell]
) -> dict[str, tuple]:
    """Return the part of a layout that says which walls, spheres and shells move."""
    motions = [(k, body.motion) for k, body in enumerate(bodies) if body.motion is not None]
    return {
        "moving": tuple(wall.motion is not None for _, wall in walls),
        "vibrating": tuple(wall.vibrates for _, wall in walls),
        "driven": tuple(k for k, _ in motions),
        "shaken": tuple(k for k, motion in motions if motion.vibrates),
    }


def curved(scene: Scene) -> list[Sphere | Shell]:
    """Return spheres and shells in the order of the engine."""
    return [body for _, body in (*spheres_of(scene.bodies), *shells_of(scene.bodies))]


def _is_constant(law: AbstractLaw) -> bool:
    leaves, structure = jax.tree.flatten(law)
    kinds = tuple((jnp.shape(leaf), jnp.result_type(leaf)) for leaf in leaves)
    return _is_constant_by_kind(structure, kinds)


@functools.lru_cache(maxsize=256)
def _is_constant_by_kind(structure: Any, kinds: tuple[Any, ...]) -> bool:
    """Return whether e is constant; traced once for each kind of law."""
    leaves = [jax.ShapeDtypeStruct(*kind) for kind in kinds]
    law = jax.tree.unflatten(structure, leaves)
    return restitution_is_constant(law, None)


def contact_of(model: SceneArrays, i: Array, j: Array) -> Contact | None:
    """Return the contact of bodies i and j; None if no stiffness is known."""
    inverse = rows_of(model.inverse_mass, i) + rows_of(model.inverse_mass, j)
    # Two fixed bodies never meet, so any mass serves.
    mass = 1 / jnp.where(inverse > 0, inverse, 1)
    if model.stiffness is not None:
        stiffness = model.stiffness[0]
        if model.stiffnesses:
            stiffness = rows_of(model.stiffness, model.chosen(model.stiffnesses, i, j))
        return Contact(mass, stiffness, model.exponent.value)
    if model.compliance is None:
        return None
    curvature = jnp.concatenate([1 / model.radius, jnp.zeros(model.walls, model.dtype)])
    # Hertz's stiffness, from the curvature and the compliance of the pair.
    (soft, bent), (softer, more) = (rows_of((model.compliance, curvature), k) for k in (i, j))
    return Contact(mass, 4 / 3 / (jnp.sqrt(bent + more) * (soft + softer)))


def known_contact_of(model: SceneArrays, i: Array, j: Array) -> Contact:
    """Return the contact of bodies i and j in a scene with known stiffness."""
    contact = contact_of(model, i, j)
    assert contact is not None
    return contact


def laws_of(model: SceneArrays, i: Array, j: Array) -> tuple[Sequence[AbstractLaw], Index]:
    """Return a law of every kind, and the kind of the law of bodies i and j."""
    if len(model.laws) == 1:
        return model.laws, jnp.asarray(0)
    return one_of_each(model.laws, model.chosen(model.law_table, i, j))


def law_of(model: SceneArrays, i: Array, j: Array) -> AbstractLaw:
    """Return the law of bodies i and j, selected through its force."""
    laws, kind = laws_of(model, i, j)
    return laws[0] if len(laws) == 1 else MixedLaw(tuple(laws), kind.astype(model.dtype))


def least_speed(model: SceneArrays) -> Number:
    """Return one rounding error of the scene's speeds in m/s, from the start and from weight."""
    radius = jnp.max(jnp.abs(model.radius))
    pull = jnp.sqrt(jnp.sum(jnp.square(model.gravity))) * radius
    square = jnp.max(jnp.square(model.velocity)) + pull
    small = jnp.finfo(model.dtype)
    return jax.lax.stop_gradient(small.eps * jnp.sqrt(square + math.sqrt(small.tiny)))


def restitution_of(model: SceneArrays, i: Array, j: Array, closing: Lane) -> Number:
    """Return the restitution e of bodies i and j at a closing speed."""
    which = model.chosen(model.law_table, i, j) if model.law_table else None
    if all(model.constant):
        return model.restitution[0] if which is None else rows_of(model.restitution, which)
    contact = known_contact_of(model, i, j)
    speed = jnp.maximum(closing, least_speed(model))

    def of(k: int) -> Callable[[Lane], Lane]:
        if model.constant[k]:
            return lambda speed: model.restitution[k]
        return lambda speed: restitution_at_any_speed(model.laws[k], contact, speed)

    if which is None:
        return of(0)(speed)
    return jax.lax.switch(which, [of(k) for k in range(len(model.laws))], speed)


def first_overlap(model: SceneArrays) -> Number:
    """Return the deepest overlap of two bodies beyond rounding, in m; 0 if there is none. It is
    also 0 if the scene continues a run.
    """
    if model.start is not None:
        return jnp.zeros((), model.dtype)
    rounding = ROUNDINGS * jnp.finfo(model.dtype).eps
    scale = jnp.max(jnp.abs(model.position)) + 2 * jnp.max(model.radius)
    moves = model.inverse_mass[: model.spheres] > 0

    def row(i: Index) -> Array:
        apart = nearest_image(model, model.position[i][None] - model.position)[0]
        distance = model.radius[i] + model.radius
        gap = side(distance) * jnp.sqrt(jnp.sum(jnp.square(apart), axis=-1)) - distance
        counts = (jnp.arange(model.spheres) != i) & (moves | moves[i])
        deep = jnp.max(jnp.where(counts, -gap, -jnp.inf))
        for w in range(model.walls):
            height = jnp.sum(model.position[i] * model.normal[w]) - model.offset[w]
            deep = jnp.maximum(deep, jnp.where(moves[i], model.radius[i] - height, -jnp.inf))
        return deep

    deepest = jnp.max(jax.lax.map(row, jnp.arange(model.spheres)))
    return jnp.where(deepest > rounding * scale, deepest, 0)


def nearest_image(
    model: SceneArrays, apart: Float[Array, "N D"]
) -> tuple[Float[Array, "N D"], Float[Array, "N D"]]:
    """Return distances to the nearest periodic image, and the number of periods subtracted."""
    if not any(model.periodic):
        return apart, jnp.zeros_like(apart)
    axes = jnp.asarray(model.periodic)[None]
    shift = jnp.where(axes, jnp.round(apart / model.period[None]), 0)
    return apart - shift * model.period[None], shift


class Flying(NamedTuple):
    """Bodies in flight, each at its own `time` (M,): `position` and `velocity` (M, D). In an impact
    with a wall, the second row repeats the first. `turning` is None without friction.
    """

    position: Lane
    velocity: Lane
    time: Lane
    turning: Turning | None = None


def where_each(counts: Bool[Array, " M"], first: Flying, second: Flying) -> Flying:
    """Return `first` for each body that `counts`, else `second`."""
    return jax.tree.map(
        lambda a, b: jnp.where(counts.reshape(-1, *(1,) * (a.ndim - 1)), a, b), first, second
    )


def accelerations(
    model: SceneArrays, who: Int[Array, " M"], support: Int[Array, " M"]
) -> Float[Array, "M D"]:
    """Return gravity of the free spheres, less the normal part for those that rest on walls."""
    if not model.has_gravity:
        return jnp.zeros((who.shape[0], model.dimensions), model.dtype)
    pull = rows_of(model.pull, support + 1)
    if any(model.fixed):
        pull = jnp.where((rows_of(model.inverse_mass, who) > 0)[:, None], pull, 0)
    return pull


def at_once(
    model: SceneArrays, who: Int[Array, " M"], flying: Flying, support: Int[Array, " M"], time: Lane
) -> tuple[Flying, Float[Array, "M D"]]:
    """Return spheres in flight at one time, and their accelerations by gravity, and by friction on
    the walls on which they rest. Accelerated fixed spheres are placed by their motion, regardless
    of `flying`.
    """
    pull, turning = accelerations(model, who, support), flying.turning
    passed = (time - flying.time)[:, None]
    if turning is not None:
        pull = pull + turning.drag
        turning = turning._replace(spin=turning.spin + turning.twist * passed)
    velocity = flying.velocity + pull * passed
    position = flying.position + (flying.velocity + velocity) / 2 * passed
    if model.shaken:
        place, rate = model.shaken_at(time)
        place, rate = (jnp.concatenate([x, jnp.zeros_like(x[:1])]) for x in (place, rate))
        row = model.shaken_row(who)
        shakes = (row < len(model.shaken))[:, None]
        position = jnp.where(shakes, place[row], position)
        velocity = jnp.where(shakes, rate[row], velocity)
    return Flying(position, velocity, jnp.broadcast_to(time, flying.time.shape), turning), pull
