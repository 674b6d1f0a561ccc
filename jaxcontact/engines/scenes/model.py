"""A scene as plain numbers, in three dimensions, as engines need it."""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import Any, NamedTuple, cast

import numpy as np
from jaxtyping import Float, Int

from ... import AbstractFriction, AbstractLaw, Contact, Material, Scene, Shell, Sphere
from ...extend import ratio_of, rendered, restitution_is_constant, traced, words


class Moving(NamedTuple):
    """A displacement V t + A (sin(ω t + φ) - sin φ) in space: V in m/s and A in m (3,)."""

    speed: Float[np.ndarray, " 3"]
    amplitude: Float[np.ndarray, " 3"]
    rate: float
    phase: float


class BodyGroup(NamedTuple):
    """Bodies with the same contacts: spheres, or walls.

    `curvature` is 1/R in 1/m, that of the smallest sphere if sizes do not matter, zero of a flat
    wall and negative of a shell. `inverse_mass` in 1/kg is that of the lightest sphere, zero of
    fixed bodies. `compliance` and `shear` in 1/Pa are those of the material, None without one.
    """

    kind: int
    curvature: float
    inverse_mass: float
    compliance: float | None
    shear: float | None
    wall: bool


class FlatWall(NamedTuple):
    """A flat wall at time zero: numbers of its body and group, a point in m, the normal (3,)."""

    body: int
    group: int
    point: Float[np.ndarray, " 3"]
    normal: Float[np.ndarray, " 3"]
    motion: Moving | None


class RoundWall(NamedTuple):
    """A shell at time zero: number of its body, group, centre (3,) and radius in m."""

    body: int
    group: int
    centre: Float[np.ndarray, " 3"]
    radius: float
    motion: Moving | None


class Touch(NamedTuple):
    """The contact of two groups: `radius` is the effective radius in m, `ratio` κ of friction.

    κ is None if a friction without a spring does not need it, and the materials do not give it.
    """

    law: AbstractLaw
    contact: Contact
    radius: float
    friction: AbstractFriction | None
    ratio: float | None


@dataclasses.dataclass(frozen=True, kw_only=True)
class SceneModel:
    """A scene in three dimensions; the unused coordinates are zero.

    Arrays have a row for each of N spheres: `position` in m, `velocity` in m/s and `spin` in rad/s
    (N, 3), `radius` in m, `mass` in kg and `inertia` in kg m² (N,), `group` and `body` by number.
    A fixed sphere is in `motions` by its row, with None if it does not move. `periods` has a length
    or None for each axis; `touches` has the contact for each pair of groups that can meet.
    """

    scene: Scene
    position: Float[np.ndarray, "N 3"]
    velocity: Float[np.ndarray, "N 3"]
    spin: Float[np.ndarray, "N 3"]
    radius: Float[np.ndarray, " N"]
    mass: Float[np.ndarray, " N"]
    inertia: Float[np.ndarray, " N"]
    group: Int[np.ndarray, " N"]
    body: Int[np.ndarray, " N"]
    motions: dict[int, Moving | None]
    gravity: Float[np.ndarray, " 3"]
    periods: tuple[float | None, float | None, float | None]
    groups: tuple[BodyGroup, ...]
    flat: tuple[FlatWall, ...]
    round: tuple[RoundWall, ...]
    touches: dict[tuple[int, int], Touch]

    @property
    def dimensions(self) -> int:
        """The number of dimensions of the scene."""
        return self.scene.dimensions

    def name(self, body: int) -> str:
        """Return the name of a body of the scene for an engine, without spaces and unique."""
        given = self.scene.bodies[body].name
        plain = "".join(c if c.isalnum() and c.isascii() else "_" for c in given or "body")
        return f"{plain}_{body}"

    def solid(self) -> bool:
        """Return whether every sphere turns like a solid one, I = 2/5 m R²."""
        return self._turns_like(0.4)

    def disc(self) -> bool:
        """Return whether every sphere turns like a disc, I = 1/2 m R²."""
        return self._turns_like(0.5)

    def _turns_like(self, factor: float) -> bool:
        free = np.isfinite(self.mass)
        usual = factor * self.mass[free] * self.radius[free] ** 2
        return bool(np.allclose(self.inertia[free], usual, rtol=1e-9))

    def extent(self) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, " 3"]]:
        """Return the corners of a box around all spheres, shells and points of walls, in m."""
        low, high = self.position - self.radius[:, None], self.position + self.radius[:, None]
        corners = [*low, *high, *(wall.point for wall in self.flat)]
        for shell in self.round:
            corners += [shell.centre - shell.radius, shell.centre + shell.radius]
        return np.min(corners, axis=0), np.max(corners, axis=0)


def in_space(values: Any) -> Float[np.ndarray, " 3"]:
    """Return one to three numbers as three, with zeros at the end; zeros for None."""
    given = np.atleast_1d(np.asarray(0.0 if values is None else values, float))
    return np.pad(given, (0, 3 - given.shape[0]))


def scene_model(scene: Scene, *, merges: bool) -> SceneModel:
    """Return a scene as plain numbers.

    With `merges`, spheres of different size are one group if neither the stiffness over √R nor the
    restitution depends on the size. Raises ValueError for traced numbers, the end of a run, a
    motion by a user's function, and a pair without stiffness.
    """
    _require_plain(scene)
    free_size = scene.stiffness is None and all(
        restitution_is_constant(law, None) for law in scene.law.values
    )
    groups = _Groups(scene, merged=merges and free_size)
    rows = [k for k, body in enumerate(scene.bodies) if isinstance(body, Sphere)]
    spheres = scene.spheres
    motions = {
        row: _moving(scene, k, spheres[row].motion, None)
        for row, k in enumerate(rows)
        if spheres[row].fixed
    }
    numbers = _numbers(spheres)
    group = np.array([*map(groups.sphere, rows, numbers["radius"], numbers["mass"])])
    flat, shells = _walls(scene, groups)
    periods: Any = (*(None if p is None else float(p) for p in scene.periodic), None, None)[:3]
    return SceneModel(
        scene=scene,
        **numbers,
        group=group,
        body=np.array(rows),
        motions=motions,
        gravity=in_space(scene.gravity),
        periods=periods,
        groups=tuple(groups.made),
        flat=tuple(flat),
        round=tuple(shells),
        touches=_touches(scene, groups.made, np.bincount(group, minlength=len(groups.made))),
    )


def _require_plain(scene: Scene) -> None:
    """Raise ValueError for traced numbers and the end of a run."""
    if traced(scene):
        raise ValueError("Argument `scene` must have concrete numbers, but is traced.")
    if scene._start is not None:
        raise ValueError(
            "Argument `scene` must start without contacts in progress or balls that rest, but is "
            "the end of a run."
        )


def _numbers(spheres: tuple[Sphere, ...]) -> dict[str, np.ndarray]:
    """Return the arrays of `SceneModel` with a row for each sphere."""
    radius, mass = np.array([float(sphere.radius) for sphere in spheres]), _masses(spheres)
    solid = zip(0.4 * mass * radius**2, (sphere.inertia for sphere in spheres), strict=True)
    return {
        "position": np.array([in_space(sphere.place) for sphere in spheres]),
        "velocity": np.array([in_space(sphere.velocity) for sphere in spheres]),
        "spin": np.array([_spin(sphere) for sphere in spheres]),
        "radius": radius,
        "mass": mass,
        "inertia": np.array([usual if own is None else float(own) for usual, own in solid]),
    }


def _masses(spheres: tuple[Sphere, ...]) -> Float[np.ndarray, " N"]:
    """Return the masses in kg, infinite of fixed spheres.

    The density of a material is read once: JAX takes microseconds for each number.
    """
    density: dict[int, float] = {}

    def of(sphere: Sphere) -> float:
        if sphere.fixed or sphere.mass is not None:
            return math.inf if sphere.mass is None else float(sphere.mass)
        number = id(sphere.material)
        if number not in density:
            # Of a sphere of the volume 1.
            unit = cast(Material, sphere.material).sphere_mass((0.75 / math.pi) ** (1 / 3))
            density[number] = float(unit)
        return 4 / 3 * math.pi * float(sphere.radius) ** 3 * density[number]

    return np.array([of(sphere) for sphere in spheres])


def _spin(sphere: Sphere) -> Float[np.ndarray, " 3"]:
    if sphere.spin is None:
        return np.zeros(3)
    spin = np.atleast_1d(np.asarray(sphere.spin, float))
    return spin if spin.shape == (3,) else np.array([0.0, 0.0, spin[0]])


class _Groups:
    """The groups of a scene, made as bodies are met."""

    def __init__(self, scene: Scene, merged: bool):
        self.made: list[BodyGroup] = []
        self._scene, self._merged = scene, merged
        self._numbers: dict[tuple, int] = {}
        self._materials = {id(body.material): body.material for body in scene.bodies}
        # JAX reads a number in microseconds, which counts for many spheres.
        self._compliances = functools.cache(self._compliances_of)

    def _compliances_of(self, material: int) -> tuple[float | None, float | None]:
        found = self._materials[material]
        if found is None:
            return None, None
        return float(found.compliance), float(found.shear_compliance)

    def sphere(self, body: int, radius: float, mass: float) -> int:
        size = () if self._merged else (radius, mass)
        return self._number(body, (math.isinf(mass), *size), 1 / radius, 1 / mass, wall=False)

    def wall(self, body: int, curvature: float) -> int:
        return self._number(body, (curvature,), curvature, 0.0, wall=True)

    def _number(self, body: int, key: tuple, curvature: float, inverse: float, wall: bool) -> int:
        kind = self._scene._kinds[body]
        material = self._compliances(id(self._scene.bodies[body].material))
        number = self._numbers.setdefault((wall, kind, material, *key), len(self.made))
        if number == len(self.made):
            self.made.append(BodyGroup(kind, curvature, inverse, *material, wall))
        else:
            old = self.made[number]
            smallest = max(old.curvature, curvature), max(old.inverse_mass, inverse)
            self.made[number] = old._replace(curvature=smallest[0], inverse_mass=smallest[1])
        return number


def _walls(scene: Scene, groups: _Groups) -> tuple[list[FlatWall], list[RoundWall]]:
    flat, shells = [], []
    for k, body in enumerate(scene.bodies):
        if isinstance(body, Shell):
            radius = float(body.radius)
            motion = _moving(scene, k, body.motion, None)
            group = groups.wall(k, -1 / radius)
            shells.append(RoundWall(k, group, in_space(body.place), radius, motion))
        for wall in body.walls():
            normal = np.asarray(wall.normal, float)
            motion = _moving(scene, k, body.motion, normal)
            point = in_space(normal * float(wall.offset))
            flat.append(FlatWall(k, groups.wall(k, 0.0), point, in_space(normal), motion))
    return flat, shells


def _moving(scene: Scene, body: int, motion: Any, normal: Any) -> Moving | None:
    """Return a prescribed motion in space; a single amplitude acts along the normal."""
    if motion is None:
        return None
    scalar = motion.dimensions is None
    along = motion.along(normal if scalar else None)
    if along.own is not None:
        raise ValueError(
            "Argument `scene` must have motions of kind `Steady` or `Vibration` for an engine, "
            f"but {words(scene.bodies, body)} moves by a function: {rendered(motion)}."
        )
    speed, amplitude = (np.asarray(x, float) * (normal if scalar else 1) for x in along[:2])
    zero = np.zeros(3)
    return Moving(
        in_space(speed) if np.ndim(speed) else zero,
        in_space(amplitude) if np.ndim(amplitude) else zero,
        float(along.rate),
        float(along.phase),
    )


def _touches(
    scene: Scene, groups: list[BodyGroup], counts: Int[np.ndarray, " G"]
) -> dict[tuple[int, int], Touch]:
    """Return the contacts of all pairs of groups that can meet."""
    found = {}
    for b, second in enumerate(groups):
        for a, first in enumerate(groups[: b + 1]):
            alone = a == b and (second.wall or counts[b] < 2)
            if not alone and first.inverse_mass + second.inverse_mass > 0:
                found[a, b] = _touch(scene, first, second)
    return found


def _touch(scene: Scene, first: BodyGroup, second: BodyGroup) -> Touch:
    def of(table: Any) -> Any:
        return None if table is None else table.values[table.table[first.kind][second.kind]]

    radius = 1 / (first.curvature + second.curvature)
    stiffness = of(scene.stiffness)
    # `simulate` takes the materials for friction only where it takes them for the stiffness.
    ratio: Any = None
    if stiffness is None:
        soft, shear = _compliances(first, second)
        stiffness, ratio = 4 / 3 * math.sqrt(radius) / soft, 4 * soft / shear
    friction = of(scene.friction)
    if friction is not None and friction.kind == "spring":
        ratio = ratio_of(friction, ratio)
    mass = 1 / (first.inverse_mass + second.inverse_mass)
    exponent = float(scene.exponent)
    contact = Contact(mass, float(stiffness), exponent)
    return Touch(of(scene.law), contact, radius, friction, None if ratio is None else float(ratio))


def _compliances(*pair: BodyGroup) -> tuple[float, float]:
    """Return the sums of the compliances and of the shear compliances of two groups, in 1/Pa."""
    if any(group.compliance is None and not group.wall for group in pair):
        raise ValueError(
            "Argument `scene` must have a `stiffness`, or a material for every sphere, as an "
            "engine follows contacts in time, but has neither."
        )
    return sum(group.compliance or 0.0 for group in pair), sum(group.shear or 0.0 for group in pair)
