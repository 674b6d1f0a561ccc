"""The numbers of a scene, gathered from its bodies. NumPy stacks bodies of one structure, so that
one small program serves a few bodies or thousands.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..._coupled.modes import Flag
from ..._entry import POSITIVE, Specialised, is_valid, sanitised, static_value, traced
from ..._functions import spin_axes
from ..._impact import restitution
from ..bodies.bodies import AbstractBody, Shell, Sphere
from ..bodies.motion import AbstractMotion, Along, still
from ..bodies.scene import Scene
from .arrays import SceneArrays, SceneLayout
from .movers import Movers, Rotation


class Alike(eqx.Module):
    """Bodies of one structure as one `body` with stacked numbers, if there are several. `which`
    lists their numbers in the scene. A body with a motion is always alone.
    """

    body: AbstractBody
    which: tuple[int, ...] = eqx.field(static=True)

    def each(self, of: Callable[[Any], Any]) -> Any:
        """Return a function of each body, stacked."""
        if len(self.which) > 1:
            return jax.vmap(of)(self.body)
        return jax.tree.map(lambda x: jnp.asarray(x)[None], of(self.body))


class SceneInputs(eqx.Module):
    """The inputs of a scene's numbers, with leaves of one precision."""

    bodies: tuple[Alike, ...]
    laws: tuple[Any, ...]
    gravity: Array | None
    periodic: tuple[Array | None, ...]
    stiffness: tuple[Array, ...] | None
    exponent: Specialised
    start: Any
    frictions: tuple[Any, ...] | None

    @property
    def dtype(self) -> Any:
        """The precision of all numbers."""
        return next(x.dtype for x in jax.tree.leaves(self.bodies) if eqx.is_inexact_array(x))


def inputs_of(scene: Scene) -> SceneInputs:
    """Return the stacked bodies of a scene and its other inputs."""
    dtype = _precision(scene)
    alike: dict[Any, list[int]] = {}
    for k, body in enumerate(scene.bodies):
        moves = getattr(body, "motion", None) is not None
        alike.setdefault(k if moves else jax.tree.structure(body), []).append(k)
    inputs = SceneInputs(
        bodies=tuple(
            Alike(_together(scene.bodies, which), tuple(which)) for which in alike.values()
        ),
        laws=scene.law.values,
        gravity=scene.gravity,
        periodic=scene.periodic,
        stiffness=None if scene.stiffness is None else scene.stiffness.values,
        exponent=scene._exponent,
        start=scene._start,
        frictions=None if scene.friction is None else scene.friction.values,
    )

    def convert(leaf: Any) -> Any:
        if static_value(leaf) is not None or eqx.is_inexact_array(leaf):
            return leaf.astype(dtype) if traced(leaf) else np.asarray(leaf, dtype)
        return leaf

    return jax.tree.map(convert, inputs)


def _together(bodies: Sequence[AbstractBody], which: Sequence[int]) -> AbstractBody:
    if len(which) == 1:
        return bodies[which[0]]

    def stack(*values: Any) -> Any:
        # NumPy stacks thousands of bodies at almost no cost, unless something is traced.
        if traced(values):
            return jnp.stack(values)
        return np.stack([np.asarray(value) for value in values])

    return jax.tree.map(stack, *(bodies[k] for k in which))


def arrays_of(
    parts: SceneInputs, layout: SceneLayout, contacts: bool, soft: bool
) -> tuple[SceneArrays, Flag]:
    """Return the numbers of a scene, and whether they are valid.

    Invalid law parameters are replaced by valid ones. `contacts`: whether every pair needs a
    stiffness. `soft`: whether impacts take time, so that restitutions are not needed. Raises
    ValueError if a stiffness is needed and none is known.
    """
    dtype, dimensions = parts.dtype, layout.dimensions

    def numbers_in(body: Sphere | Shell) -> tuple[Any, ...]:
        one = jnp.ones((), dtype)
        if isinstance(body, Shell):
            return body.place, _velocity(body), -body.radius, one
        mass = body.known_mass()
        return body.place, _velocity(body), body.radius, one if mass is None else mass

    position, velocity, radius, mass = _of_curved(parts, layout, numbers_in)
    free = np.concatenate([~np.array(layout.fixed), np.zeros(layout.walls, bool)])
    heavy = jnp.concatenate([mass, jnp.ones(layout.walls, dtype)])
    normal, offset, moving = _walls_in(parts, layout)
    shaken = {layout.body[k] for k in layout.shaken}
    shaking = [
        _along(alike.body.motion, dimensions) for alike in parts.bodies if alike.which[0] in shaken
    ]
    valid, laws = _sound_laws(parts.laws, dtype)
    gravity = jnp.zeros(dimensions, dtype) if parts.gravity is None else jnp.asarray(parts.gravity)
    held = jnp.sum(gravity[None] * normal, axis=-1, keepdims=True)
    period = _row([np.ones(()) if p is None else p for p in parts.periodic], dtype)
    model = SceneArrays(
        **vars(layout),
        position=position,
        velocity=velocity,
        radius=radius,
        inverse_mass=jnp.where(free, 1 / heavy, 0),
        normal=normal,
        offset=offset,
        motion=_movers(moving, dtype),
        shaking=_movers(shaking, dtype),
        gravity=gravity,
        pull=jnp.concatenate([gravity[None], gravity[None] - held * normal]),
        period=period,
        restitution=_restitutions(laws, (False,) * len(laws) if soft else layout.constant, dtype),
        laws=laws,
        stiffness=None if parts.stiffness is None else _row(parts.stiffness, dtype),
        compliance=_compliance(parts, layout, contacts),
        exponent=parts.exponent,
        start=parts.start,
    )
    if parts.frictions is not None:
        sound, frictions = _sound_laws(parts.frictions, dtype)
        rotation, more = _rotation(parts, model, frictions)
        model, valid = dataclasses.replace(model, rotation=rotation), valid & sound & more
    return model, valid & _is_sound(model, mass)


def _restitutions(laws: Sequence[Any], known: Sequence[bool], dtype: Any) -> Array:
    """Return the e of the laws of which it is known, and 0 for others."""
    pairs = zip(laws, known, strict=True)
    return jnp.stack([jnp.asarray(restitution(law) if yes else 0, dtype) for law, yes in pairs])


def _is_sound(model: SceneArrays, mass: Array) -> Flag:
    """Return whether the numbers are finite and within their ranges."""
    radius, valid = model.radius, jnp.asarray(True)
    rising = [mass, radius[: model.visible], -radius[model.visible :]]
    finite = [model.position, model.velocity, radius, mass]
    finite += [model.gravity, model.period, model.normal, model.offset]
    for axis, around in enumerate(model.periodic):
        if around:
            valid = valid & (model.period[axis] > 4 * jnp.max(radius))
    for movers in (model.motion, model.shaking):
        if movers is not None:
            finite += jax.tree.leaves(eqx.filter(movers, eqx.is_inexact_array))
            valid = valid & jnp.all(movers.rate >= 0)
    valid = valid & jnp.all(jnp.isfinite(_flat(finite))) & jnp.all(_flat(rising) > 0)
    if model.stiffness is not None:
        valid = valid & jnp.all(POSITIVE.holds(model.stiffness))
    if model.compliance is not None:
        valid = valid & jnp.all(model.compliance >= 0)
    return valid


def _rotation(
    parts: SceneInputs, model: SceneArrays, frictions: tuple[Any, ...]
) -> tuple[Rotation, Flag]:
    """Return the numbers that only friction needs, and whether they are valid."""
    dtype, axes, count = parts.dtype, spin_axes(model.dimensions), model.spheres

    def of(body: Sphere | Shell) -> tuple[Array, Array, Array]:
        spin, inertia = body.spin, body.inertia
        return (
            jnp.zeros(axes, dtype) if spin is None else jnp.asarray(spin).reshape(axes),
            jnp.ones((), dtype) if inertia is None else jnp.asarray(inertia),
            jnp.asarray(inertia is not None),
        )

    spin, given, is_given = _of_curved(parts, model, of)
    solid = 2.5 * model.inverse_mass[:count] / jnp.square(model.radius)
    turns = jnp.where(is_given, 1 / given, solid)
    shear = None
    if model.compliance is not None:

        def shear_of(body: AbstractBody) -> Any:
            material = body.material
            return jnp.zeros((), dtype) if material is None else material.shear_compliance

        shear = _in_order(parts.bodies, model.body, [x.each(shear_of) for x in parts.bodies])
    rotation = Rotation(
        spin=spin,
        inverse_inertia=jnp.concatenate([turns, jnp.zeros(model.walls, dtype)]),
        shear_compliance=shear,
        drift=_drift(parts, model),
        laws=frictions,
    )
    return rotation, jnp.all(jnp.isfinite(spin)) & jnp.all(POSITIVE.holds(given))


def _drift(parts: SceneInputs, layout: SceneLayout) -> Movers | None:
    """Return the motions of the walls in space. A plane that vibrates by one number moves along its
    normal only.
    """
    motions: dict[int, Along | None] = {}
    for alike in parts.bodies:
        motion = alike.body.motion
        for k in alike.which:
            in_space = motion is not None and motion.dimensions is not None
            motions[k] = _along(motion, layout.dimensions) if in_space else None
    along = [motions[k] for k in layout.body[layout.spheres :]]
    if all(motion is None for motion in along):
        return None
    none = np.zeros(layout.dimensions)
    rest = still()._replace(speed=none, amplitude=none)
    return _movers([rest if motion is None else motion for motion in along], parts.dtype)


def _of_curved(parts: SceneInputs, layout: SceneLayout, of: Callable[[Any], Any]) -> Any:
    """Return a function of each sphere and shell, stacked in the order of the engine."""
    order = layout.body[: layout.spheres]
    curved = [alike for alike in parts.bodies if alike.which[0] in order]
    return _in_order(curved, order, [alike.each(of) for alike in curved])


def _flat(arrays: Sequence[Array]) -> Array:
    return jnp.concatenate([array.ravel() for array in arrays])


def _in_order(groups: Sequence[Alike], order: Sequence[int], parts: Sequence[Any]) -> Any:
    """Return the rows of groups of bodies in the `order` of the scene's bodies."""
    row_of = {k: row for row, k in enumerate(k for alike in groups for k in alike.which)}
    rows = np.array([row_of[k] for k in order], int)
    plain = np.array_equal(rows, np.arange(len(row_of)))

    def join(*columns: Array) -> Array:
        rows_by_kind = jnp.concatenate(columns)
        return rows_by_kind if plain else rows_by_kind[rows]

    return jax.tree.map(join, *parts)


def _walls_in(inputs: SceneInputs, layout: SceneLayout) -> tuple[Array, Array, list[Along | None]]:
    """Return the normals and offsets of all walls, and their motions."""
    rows: dict[tuple[int, int], tuple[Array, Array, Along | None]] = {}
    for alike in inputs.bodies:
        faces: list[tuple[int, Along | None]] = []

        def flat(body: AbstractBody, faces: list = faces) -> list[tuple[Array, Array]]:
            walls = body.walls()
            faces[:] = [(wall.face, wall.motion) for wall in walls]
            return [(wall.normal, wall.offset) for wall in walls]

        walls = alike.each(flat)
        for place, k in enumerate(alike.which):
            for (face, motion), (normal, offset) in zip(faces, walls, strict=True):
                rows[k, face] = normal[place], offset[place], motion
    names = zip(layout.body[layout.spheres :], layout.face[layout.spheres :], strict=True)
    planes = [rows[name] for name in names]
    if not planes:
        none = jnp.zeros((0,), inputs.dtype)
        return none.reshape(0, layout.dimensions), none, []
    normals, offsets, moving = zip(*planes, strict=True)
    return _row(normals, inputs.dtype), _row(offsets, inputs.dtype), list(moving)


def _velocity(body: Sphere | Shell) -> Any:
    # The velocity of an accelerated body depends on time and is computed later.
    if body.motion is not None and not body.motion.vibrates:
        return body.motion.along(None).speed
    return jnp.zeros_like(body.place) if body.velocity is None else body.velocity


def ones_unless(model: SceneArrays, valid: Flag) -> SceneArrays:
    """Return the numbers, all replaced by 1 if the scene is not valid."""
    return jax.tree.map(lambda x: jnp.where(valid, x, jnp.ones_like(x)), model)


def _precision(scene: Scene) -> Any:
    """Return the highest precision among the numbers of a scene."""
    leaves = [leaf for leaf in jax.tree.leaves(scene) if eqx.is_inexact_array(leaf)]
    strong = [leaf.dtype for leaf in leaves if not leaf.weak_type]
    return jax.dtypes.canonicalize_dtype(max(strong, key=lambda d: d.itemsize, default=float))


def _row(values: Sequence[Any], dtype: Any) -> Array:
    return jnp.stack([jnp.asarray(value, dtype) for value in values])


def _sound_laws(laws: Sequence[Any], dtype: Any) -> tuple[Flag, tuple[Any, ...]]:
    valid = jnp.asarray(True)
    for law in laws:
        valid = valid & is_valid(law)

    def convert(leaf: Any) -> Any:
        leaf = leaf if static_value(leaf) is None else jnp.asarray(leaf)
        return leaf.astype(dtype) if eqx.is_inexact_array(leaf) else leaf

    return valid, tuple(jax.tree.map(convert, sanitised(law)) for law in laws)


def _along(given: AbstractMotion | None, dimensions: int) -> Along:
    """Return the motion of an accelerated body in space."""
    assert given is not None
    motion = given.along(None)
    speed, amplitude = (jnp.broadcast_to(x, dimensions) for x in (motion.speed, motion.amplitude))
    return motion._replace(speed=speed, amplitude=amplitude)


def _movers(along: Sequence[Along | None], dtype: Any) -> Movers | None:
    if all(motion is None for motion in along):
        return None
    motions = [still() if motion is None else motion for motion in along]
    *columns, users = zip(*motions, strict=True)
    users = jax.tree.map(lambda x: x.astype(dtype) if eqx.is_inexact_array(x) else x, users)
    return Movers(*(_row(column, dtype) for column in columns), own=users)


def _compliance(inputs: SceneInputs, layout: SceneLayout, needed: bool) -> Array | None:
    if inputs.stiffness is not None:
        return None
    for alike in inputs.bodies:
        if alike.which[0] in layout.body[: layout.visible] and alike.body.material is None:
            if needed:
                raise ValueError(
                    "Argument `stiffness` of the scene must be given where a sphere has no "
                    f"material (number {alike.which[0]} of `bodies`), but is None."
                )
            return None

    def of(body: AbstractBody) -> Any:
        return jnp.zeros((), inputs.dtype) if body.material is None else body.material.compliance

    return _in_order(inputs.bodies, layout.body, [alike.each(of) for alike in inputs.bodies])
