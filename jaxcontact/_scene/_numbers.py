"""The numbers of a scene, gathered from its bodies."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Bool

from .._impact import restitution
from .._parameter import POSITIVE, is_valid, sanitised
from ._bodies import Shell, Sphere
from ._motion import Along, still
from ._movers import Movers
from ._scene import Scene
from ._system import Layout, Numbers, curved


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
        position=_stack([body.place for body in curved(scene)], dtype),
        velocity=_stack([_velocity(body, still) for body in curved(scene)], dtype),
        radius=radius,
        inverse_mass=jnp.concatenate(
            [jnp.where(jnp.asarray(free), 1 / mass, 0), jnp.zeros(len(walls), dtype)]
        ),
        normal=_stack([wall.normal for wall in walls], dtype)
        if walls
        else none.reshape(0, dimensions),
        offset=_stack([wall.offset for wall in walls], dtype) if walls else none,
        motion=_movers([wall.motion for wall in walls], dtype),
        shaking=_movers([_along(curved(scene)[k], dimensions) for k in layout.shaken], dtype),
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
    for movers in (numbers.motion, numbers.shaking):
        if movers is not None:
            for leaf in jax.tree.leaves(eqx.filter(movers, eqx.is_inexact_array)):
                valid = valid & jnp.all(jnp.isfinite(leaf))
            valid = valid & jnp.all(movers.rate >= 0)
    if numbers.stiffness is not None:
        valid = valid & jnp.all(POSITIVE.holds(numbers.stiffness))
    if numbers.compliance is not None:
        valid = valid & jnp.all(numbers.compliance >= 0)
    for k, length in enumerate(scene.periodic):
        if length is not None:
            valid = valid & (numbers.period[k] > 4 * jnp.max(radius))
    return numbers, valid


def _velocity(body: Sphere | Shell, still: Any) -> Any:
    # That of one that is accelerated is known at each time.
    if body.motion is not None and not body.motion.vibrates:
        return body.motion.along(None).speed
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


def _along(body: Sphere | Shell, dimensions: int) -> Along:
    """The motion of one that is accelerated, in space."""
    assert body.motion is not None
    motion = body.motion.along(None)
    speed, amplitude = (jnp.broadcast_to(x, dimensions) for x in (motion.speed, motion.amplitude))
    return motion._replace(speed=speed, amplitude=amplitude)


def _movers(given: Sequence[Along | None], dtype: Any) -> Movers | None:
    if all(motion is None for motion in given):
        return None
    motions = [still() if motion is None else motion for motion in given]
    own = tuple(motion.own for motion in motions)
    return Movers(
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
