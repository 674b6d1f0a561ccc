"""A scene as arrays of one precision: what the engine works on."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Bool, Float, Int

from .._contact import Contact, Material
from .._impact import restitution, restitution_is_constant
from .._laws import VELOCITY_THRESHOLD, AbstractLaw
from .._parameter import POSITIVE, Specialised, is_valid, sanitised
from ._bodies import Shell, Sphere, Wall
from ._mixed_law import MixedLaw, one_of_each
from ._motion import still
from ._overlap import ROUNDINGS
from ._scene import Scene
from ._side import side
from ._start import Start
from ._wall_motion import WallMotion

Lane = Float[Array, "..."]


class Layout(eqx.Module):
    """What is static of a scene: N spheres, W walls, and what kinds of things there are.

    Bodies of the engine are the spheres in order, shells as fixed spheres of negative radius (of
    the N the first `visible` are none), then the walls: `body` and `face` say which body
    of the scene each of them is. `laws` and `stiffnesses` are tables by kind, () where one law or
    stiffness serves all; `constant` says of which laws e is the same at all speeds. Of the walls:
    which are `moving`, and which of these are accelerated (`vibrating`). `driven`: whether any of
    the fixed spheres moves.
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
    driven: bool = eqx.field(static=True)

    def chosen(self, table: tuple[tuple[int, ...], ...], i: Array, j: Array) -> Array:
        """The entry of a table for bodies i and j."""
        kinds = jnp.asarray(self.kinds)
        return jnp.asarray(table)[kinds[i], kinds[j]]


class Walls(NamedTuple):
    """Where walls are at some time: `offset` in m, and their `velocity` along the normal in m/s."""

    offset: Lane
    velocity: Lane


class Numbers(eqx.Module):
    """The numbers of a scene that its motion depends on, all of one precision.

    Of the B = N + W bodies: `inverse_mass` (0 where fixed), `curvature` 1/R (0 of walls) and
    `compliance` (Hertz), None where not needed. `restitution` by law where it is constant, else 0.
    `offset` of walls at time zero; their `motion`, None where all of them stand. `start`: what
    rests or is in contact at time zero, None where nothing is.
    """

    position: Float[Array, "N D"]
    velocity: Float[Array, "N D"]
    radius: Float[Array, " N"]
    inverse_mass: Float[Array, " B"]
    normal: Float[Array, "W D"]
    offset: Float[Array, " W"]
    motion: WallMotion | None
    gravity: Float[Array, " D"]
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
        offset = self.offset if which is None else self.offset[which]
        if self.motion is None:
            return Walls(offset, jnp.zeros_like(offset))
        shift, velocity = self.motion.shift(time), self.motion.velocity(time)
        if which is not None:
            shift, velocity = shift[which], velocity[which]
        return Walls(offset + shift, velocity)


def layout_of(scene: Scene) -> Layout:
    """The static part of a scene."""
    spheres = [k for k, body in enumerate(scene.bodies) if isinstance(body, Sphere)]
    shells = [k for k, body in enumerate(scene.bodies) if isinstance(body, Shell)]
    visible, spheres = len(spheres), spheres + shells
    walls = [(k, wall) for k, body in enumerate(scene.bodies) for wall in body.walls()]
    order = [*spheres, *(k for k, _ in walls)]
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
        driven=any(isinstance(b, Sphere | Shell) and b.motion is not None for b in scene.bodies),
    )


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


def numbers_of(scene: Scene, layout: Layout, *, contacts: bool) -> tuple[Numbers, Bool[Array, ""]]:
    """The numbers of a scene, and whether they are valid; benign ones replace invalid ones.

    `contacts`: whether a stiffness is needed for every pair. Raises ValueError where one is and
    none is known.
    """
    dtype = _precision(scene)
    spheres, dimensions = scene.spheres, scene.dimensions
    shells = [body for body in scene.bodies if isinstance(body, Shell)]
    walls = [wall for body in scene.bodies for wall in body.walls()]
    still = np.zeros(dimensions)
    radius = _stack([*(s.radius for s in spheres), *(-s.radius for s in shells)], dtype)
    inverse = [*(None if s.fixed else s.inertia() for s in spheres), *(None for _ in shells)]
    mass = _stack([np.ones(()) if m is None else m for m in inverse], dtype)
    free = np.array([m is not None for m in inverse])
    none = jnp.zeros((0,), dtype)
    gravity = jnp.zeros(dimensions, dtype) if scene.gravity is None else scene.gravity
    valid_laws, laws = _sound_laws(scene.law.values, dtype)
    constant = [
        jnp.asarray(restitution(law), dtype) if alike else jnp.zeros((), dtype)
        for law, alike in zip(laws, layout.constant, strict=True)
    ]
    numbers = Numbers(
        position=_stack([*(s.position for s in spheres), *(s.centre for s in shells)], dtype),
        velocity=_stack(
            [
                *(_velocity(body, still) for body in (*spheres, *shells)),
            ],
            dtype,
        ),
        radius=radius,
        inverse_mass=jnp.concatenate(
            [jnp.where(jnp.asarray(free), 1 / mass, 0), jnp.zeros(len(walls), dtype)]
        ),
        normal=_stack([wall.normal for wall in walls], dtype)
        if walls
        else none.reshape(0, dimensions),
        offset=_stack([wall.offset for wall in walls], dtype) if walls else none,
        motion=_motion(walls, dtype),
        gravity=jnp.asarray(gravity, dtype),
        period=_stack([np.ones(()) if p is None else p for p in scene.periodic], dtype),
        restitution=jnp.stack(constant),
        laws=laws,
        stiffness=None if scene.stiffness is None else _stack(scene.stiffness.values, dtype),
        compliance=_compliance(scene, layout, dtype, contacts),
        exponent=jax.tree.map(lambda x: jnp.asarray(x, dtype), scene._exponent),
        start=jax.tree.map(
            lambda x: x.astype(dtype) if eqx.is_inexact_array(x) else x, scene._start
        ),
    )
    valid = valid_laws & jnp.all(mass > 0) & jnp.all(radius[: len(spheres)] > 0)
    valid = valid & jnp.all(radius[len(spheres) :] < 0)
    for leaf in (numbers.position, numbers.velocity, radius, mass, numbers.gravity, numbers.period):
        valid = valid & jnp.all(jnp.isfinite(leaf))
    valid = valid & jnp.all(jnp.isfinite(numbers.normal)) & jnp.all(jnp.isfinite(numbers.offset))
    if numbers.motion is not None:
        for leaf in jax.tree.leaves(eqx.filter(numbers.motion, eqx.is_inexact_array)):
            valid = valid & jnp.all(jnp.isfinite(leaf))
        valid = valid & jnp.all(numbers.motion.rate >= 0)
    if numbers.stiffness is not None:
        valid = valid & jnp.all(POSITIVE.holds(numbers.stiffness))
    if numbers.compliance is not None:
        valid = valid & jnp.all(numbers.compliance >= 0)
    for k, length in enumerate(scene.periodic):
        if length is not None:
            valid = valid & (numbers.period[k] > 4 * jnp.max(radius))
    return numbers, valid


def _velocity(body: Sphere | Shell, still: Any) -> Any:
    if body.motion is not None:
        return body.motion.velocity
    own = body.velocity if isinstance(body, Sphere) else None
    return still if own is None else own


def replaced(numbers: Numbers, valid: Bool[Array, ""]) -> Numbers:
    """The numbers, each replaced by 1 in a scene that is not valid."""
    return jax.tree.map(lambda x: jnp.where(valid, x, jnp.ones_like(x)), numbers)


def _precision(scene: Scene) -> Any:
    """The highest precision among the numbers of a scene."""
    leaves = [leaf for leaf in jax.tree.leaves(scene) if eqx.is_inexact_array(leaf)]
    strong = [leaf.dtype for leaf in leaves if not leaf.weak_type]
    return jax.dtypes.canonicalize_dtype(max(strong, key=lambda d: d.itemsize, default=float))


def _stack(values: Sequence[Any], dtype: Any) -> Array:
    # Thousands of bodies are stacked by NumPy, in no time, unless something is traced.
    if any(isinstance(value, Tracer) for value in values):
        return jnp.stack([jnp.asarray(value, dtype) for value in values])
    return jnp.asarray(np.stack([np.asarray(value) for value in values]), dtype)


def _sound_laws(laws: Sequence[Any], dtype: Any) -> tuple[Bool[Array, ""], tuple[Any, ...]]:
    valid = jnp.asarray(True)
    for law in laws:
        valid = valid & is_valid(law)

    def convert(leaf: Any) -> Any:
        leaf = jnp.asarray(leaf) if isinstance(leaf, float) else leaf
        return leaf.astype(dtype) if eqx.is_inexact_array(leaf) else leaf

    return valid, tuple(jax.tree.map(convert, sanitised(law)) for law in laws)


def _motion(walls: Sequence[Wall], dtype: Any) -> WallMotion | None:
    if all(wall.motion is None for wall in walls):
        return None
    motions = [still() if wall.motion is None else wall.motion for wall in walls]
    own = tuple(motion.own for motion in motions)
    return WallMotion(
        speed=_stack([motion.speed for motion in motions], dtype),
        amplitude=_stack([motion.amplitude for motion in motions], dtype),
        rate=_stack([motion.rate for motion in motions], dtype),
        phase=_stack([motion.phase for motion in motions], dtype),
        own=jax.tree.map(lambda x: x.astype(dtype) if eqx.is_inexact_array(x) else x, own),
    )


def _compliance(scene: Scene, layout: Layout, dtype: Any, needed: bool) -> Array | None:
    if scene.stiffness is not None:
        return None
    materials = [scene.bodies[k].material for k in layout.body]
    for k in range(layout.visible):
        if materials[k] is None:
            if needed:
                raise ValueError(
                    "Argument `stiffness` of the scene must be given where a sphere has no "
                    f"material (number {layout.body[k]} of `bodies`), but is None."
                )
            return None
    made = {id(m): np.zeros(()) if m is None else m.compliance for m in materials}
    return _stack([made[id(m)] for m in materials], dtype)


def contact_of(layout: Layout, numbers: Numbers, i: Array, j: Array) -> Contact | None:
    """The contact of bodies i and j; None where no stiffness is known."""
    inverse = numbers.inverse_mass[i] + numbers.inverse_mass[j]
    # Two fixed bodies never meet; any mass will do.
    mass = 1 / jnp.where(inverse > 0, inverse, 1)
    if numbers.stiffness is not None:
        which = layout.chosen(layout.stiffnesses, i, j) if layout.stiffnesses else 0
        return Contact(mass, numbers.stiffness[which], numbers.exponent.value)
    if numbers.compliance is None:
        return None
    one = jnp.ones((), numbers.dtype)
    curvature = jnp.concatenate([1 / numbers.radius, jnp.zeros(layout.walls, numbers.dtype)])
    # A rigid plane under a sphere with the radius and the compliance of the pair.
    modulus = one / (numbers.compliance[i] + numbers.compliance[j])
    pair = Material(modulus, 0 * one)
    return Contact.sphere_plane(one / (curvature[i] + curvature[j]), pair, mass=mass)


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


def restitution_of(
    layout: Layout, numbers: Numbers, i: Array, j: Array, closing: Lane
) -> Float[Array, ""]:
    """The e that the law of bodies i and j delivers at a closing speed."""
    which = layout.chosen(layout.laws, i, j) if layout.laws else jnp.asarray(0)
    if all(layout.constant):
        return numbers.restitution[which]
    contact = contact_of(layout, numbers, i, j)
    speed = jnp.maximum(closing, VELOCITY_THRESHOLD)

    def of(k: int) -> Callable[[Lane], Lane]:
        if layout.constant[k]:
            return lambda speed: numbers.restitution[k]
        return lambda speed: restitution(numbers.laws[k], contact, speed)

    if len(numbers.laws) == 1:
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
