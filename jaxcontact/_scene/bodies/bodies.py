"""The bodies of a scene: spheres, planes, boxes and shells."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float
from numpy.typing import NDArray

from ..._contact import Material
from ..._coupled.modes import Number
from ..._entry import (
    POSITIVE,
    refusal,
    refuses_unknown,
    rendered,
    require_flag,
    require_kind,
    traced,
)
from .entry import one_number, spin_in, vector
from .motion import AbstractMotion, Along, as_numpy, in_space, later, origin, require_motion, shifts


def side(distance: Float[Array, "..."]) -> Float[Array, "..."]:
    """Return 1 for two spheres, -1 for a sphere in a shell, from the `distance` R1 + R2."""
    return jnp.sign(distance)


class Wall(NamedTuple):
    """A flat wall at time zero.

    `face` is its number in a box, or -1. The unit `normal` (D,) points to the free side, and
    `offset` is n·p in m. `motion` is its motion along the normal, None for a wall at rest.
    """

    face: int
    normal: Array
    offset: Array
    motion: Along | None
    vibrates: bool

    def offset_at(self, time: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the offset in m at given times in s; needs concrete numbers."""
        offset = np.full(time.shape, float(self.offset))
        if self.motion is None:
            return offset
        speed, amplitude, rate, phase = (float(number) for number in self.motion[:4])
        offset += speed * time + amplitude * (np.sin(rate * time + phase) - np.sin(phase))
        if self.motion.own is not None:
            places = np.asarray(shifts(self.motion.own, np.concatenate([[0.0], time])))
            offset += places[1:] - places[0]
        return offset


class AbstractBody(eqx.Module):
    """A body of a scene: a name, a material, and a place.

    A subclass names the fields that are places, and returns its flat `walls`. Impacts move bodies
    that are not `fixed`.
    """

    name: eqx.AbstractVar[str | None]
    material: eqx.AbstractVar[Material | None]
    motion: eqx.AbstractVar[AbstractMotion | None]
    _places: eqx.AbstractClassVar[tuple[str, ...]]
    fixed = True

    @property
    def dimensions(self) -> int:
        """The number of space dimensions."""
        return getattr(self, self._places[0]).shape[0]

    @property
    def place(self) -> Array:
        """The first of its places, at time zero."""
        return origin(getattr(self, self._places[0]), self.motion)

    def walls(self) -> list[Wall]:
        """Return the flat walls of the body."""
        return []

    def after(self, time: Array) -> Self:
        """Return the same body at a later time, moved by its prescribed motion."""
        if self.motion is None:
            return self
        moved, motion = self.motion.after(time)

        def parts(body: Self) -> list[Any]:
            return [*(getattr(body, name) for name in self._places), body.motion]

        *places, _ = parts(self)
        places = [place if moved is None else place + moved for place in places]
        return eqx.tree_at(parts, self, [*places, motion])


class Sphere(AbstractBody):
    """A sphere (a disc in two dimensions, an interval in one).

    - `radius`: R > 0 in m.
    - `mass`: m > 0 in kg. It overrides the density of the `material`.
    - `position`: of the centre in m, one to three numbers. Their count is the dimension of the
      scene.
    - `velocity`: in m/s, zero by default.
    - `material`, `name`: a `Material`, and a name for tables by pair and messages.
    - `fixed`: if True the mass is infinite. A mass or a velocity is then an error.
    - `motion`: of a fixed sphere, unaffected by impacts. A `Steady`, or a `Vibration` or
      `Prescribed` of vectors, which displaces it from its `position`.
    - `spin`: ω in rad/s, only in a scene with friction: a number in two dimensions, positive from
      the first axis to the second, and a vector in three. Zero by default.
    - `inertia`: the moment of inertia I > 0 about the centre in kg m², for friction. By default
      that of a solid sphere, 2/5 m R², in two dimensions as well; a disc has ½ m R².

    Numbers are leaves. Raises ValueError for values out of range or not finite, and if no mass is
    known.
    """

    radius: Number
    mass: Number | None
    position: Float[Array, " D"]
    velocity: Float[Array, " D"] | None
    spin: Float[Array, "..."] | None
    inertia: Number | None
    material: Material | None
    motion: AbstractMotion | None
    name: str | None = eqx.field(static=True)
    fixed: bool = eqx.field(static=True)
    _places: ClassVar[tuple[str, ...]] = ("position",)

    @refuses_unknown
    def __init__(
        self,
        radius: ArrayLike,
        mass: ArrayLike | None = None,
        position: ArrayLike | Sequence[ArrayLike] | None = None,
        velocity: ArrayLike | Sequence[ArrayLike] | None = None,
        material: Material | None = None,
        name: str | None = None,
        *,
        fixed: bool = False,
        motion: AbstractMotion | None = None,
        spin: ArrayLike | Sequence[ArrayLike] | None = None,
        inertia: ArrayLike | None = None,
    ):
        self.name, self.material = _name(name), _material(material)
        self.fixed = require_flag("fixed", fixed)
        self.radius = one_number(radius, "radius", POSITIVE)
        if position is None:
            raise ValueError("Argument `position` must be one to three numbers, but is None.")
        self.position = vector(position, "position")
        self.velocity = None
        if velocity is not None:
            self.velocity = vector(velocity, "velocity")
            _require_as_many("velocity", velocity, self.velocity, "position", self.position)
        self.mass = None if mass is None else one_number(mass, "mass", POSITIVE)
        self.spin = None if spin is None else spin_in(spin, self.dimensions)
        self.inertia = None if inertia is None else one_number(inertia, "inertia", POSITIVE)
        self.motion = in_space(motion, self.dimensions, "fixed sphere")
        if not self.fixed:
            self._require_mass()
        given = {"mass": mass, "velocity": velocity, "spin": spin, "inertia": inertia}
        for other, value in given.items() if self.fixed else ():
            if value is not None:
                raise ValueError(
                    f"Argument `{other}` must be None for a sphere with `fixed=True`, whose mass "
                    f"is infinite and which does not move or turn, but is {rendered(value)}."
                )

    def _require_mass(self) -> None:
        if self.motion is not None:
            must = "be None for a sphere without `fixed=True`, which moves as it is hit"
            raise refusal("motion", must, self.motion)
        if self.mass is None and (self.material is None or self.material.density is None):
            raise ValueError(
                "Argument `mass` must be given for a sphere whose material has no density, but is "
                "None; or give `material` with a density, or `fixed=True`."
            )

    def moved_to(self, position: Array, velocity: Array, spin: Array | None = None) -> Sphere:
        """Return the same sphere at another place, with another velocity and spin unless it is
        fixed.
        """
        if self.fixed:
            return eqx.tree_at(lambda body: body.position, self, position)
        return eqx.tree_at(
            lambda body: (body.position, body.velocity, body.spin),
            self,
            (position, velocity, spin),
            is_leaf=lambda leaf: leaf is None,
        )

    def known_mass(self) -> Number | None:
        """Return the mass in kg; None for a fixed sphere."""
        if self.fixed:
            return None
        if self.mass is not None:
            return self.mass
        assert self.material is not None
        return self.material.sphere_mass(self.radius)


class Plane(AbstractBody):
    """A plane (a line in two dimensions, a point in one) with one free side.

    - `point`: a point on it, in m.
    - `normal`: points to the free side, of any non-zero length.
    - `material`, `name`: None for a rigid plane, and a name for tables by pair and messages.
    - `motion`: a `Steady`, a `Vibration` or a `Prescribed`; None for a plane at rest.

    Numbers are leaves. Raises ValueError for numbers that are not finite, different dimensions, or
    a zero normal.
    """

    point: Float[Array, " D"]
    normal: Float[Array, " D"]
    material: Material | None
    motion: AbstractMotion | None
    name: str | None = eqx.field(static=True)
    _places: ClassVar[tuple[str, ...]] = ("point",)

    @refuses_unknown
    def __init__(
        self,
        point: ArrayLike | Sequence[ArrayLike],
        normal: ArrayLike | Sequence[ArrayLike],
        material: Material | None = None,
        name: str | None = None,
        *,
        motion: AbstractMotion | None = None,
    ):
        self.name, self.material = _name(name), _material(material)
        self.point = vector(point, "point")
        self.normal = vector(normal, "normal")
        _require_as_many("normal", normal, self.normal, "point", self.point)
        if not traced(self.normal) and not np.any(np.asarray(self.normal)):
            raise refusal("normal", "not be zero", normal)
        self.motion = require_motion(motion, self.dimensions)

    def walls(self) -> list[Wall]:
        normal, point = as_numpy(self.normal), as_numpy(self.point)
        concrete = isinstance(normal, np.ndarray)
        unit = normal / (np if concrete else jnp).linalg.norm(normal)
        return [_wall(-1, unit, (unit * point).sum(), self.motion)]


class Box(AbstractBody):
    """A container: spheres are between `low` and `high` along every axis.

    - `low` < `high`: in m, one to three numbers each. An infinite number leaves that side open.
    - `material`, `name`: None for rigid walls, and a name for tables by pair and messages.
    - `motion`: of all walls together. A `Steady`, or a `Vibration` or `Prescribed` of vectors; None
      for a box at rest.

    Face 2k is at `low[k]`, face 2k+1 at `high[k]`. Numbers are leaves. Raises ValueError for NaN,
    different dimensions, or a `low` that is not below its `high`.
    """

    low: Float[Array, " D"]
    high: Float[Array, " D"]
    material: Material | None
    motion: AbstractMotion | None
    name: str | None = eqx.field(static=True)
    _open: tuple[int, ...] = eqx.field(static=True)
    _places: ClassVar[tuple[str, ...]] = ("low", "high")

    @refuses_unknown
    def __init__(
        self,
        low: ArrayLike | Sequence[ArrayLike],
        high: ArrayLike | Sequence[ArrayLike],
        material: Material | None = None,
        name: str | None = None,
        *,
        motion: AbstractMotion | None = None,
    ):
        self.name, self.material = _name(name), _material(material)
        with jax.ensure_compile_time_eval():  # constants show which sides are open, in a trace too
            self.low = vector(low, "low", finite=False)
            self.high = vector(high, "high", finite=False)
        _require_as_many("high", high, self.high, "low", self.low)
        ends = self.low, self.high
        if not traced(ends) and not np.all(np.less(*ends)):
            raise refusal("high", f"be above `low` = {rendered(low)}", high)
        known = [np.zeros(self.dimensions) if traced(x) else np.asarray(x) for x in ends]
        self._open = tuple(np.flatnonzero(np.isinf(np.stack(known, 1))).tolist())
        self.motion = in_space(motion, self.dimensions, "box")

    def walls(self) -> list[Wall]:
        ends = as_numpy(self.low), as_numpy(self.high)
        units = np.eye(self.dimensions, dtype=self.low.dtype)
        return [
            _wall(2 * axis + side, sign * units[axis], sign * ends[side][axis], self.motion)
            for axis in range(self.dimensions)
            for side, sign in enumerate((1.0, -1.0))
            if 2 * axis + side not in self._open
        ]


class Shell(AbstractBody):
    """The inside of a fixed sphere (of a circle in two dimensions, an interval in one).

    - `centre`: in m, one to three numbers.
    - `radius`: R > 0 in m.
    - `material`, `name`: None for a rigid shell, and a name for tables by pair and messages.
    - `motion`: a `Steady`, or a `Vibration` or `Prescribed` of vectors; None for a shell at rest.

    Spheres are inside it. Numbers are leaves. Raises ValueError for values out of range or not
    finite.
    """

    centre: Float[Array, " D"]
    radius: Number
    material: Material | None
    motion: AbstractMotion | None
    name: str | None = eqx.field(static=True)
    _places: ClassVar[tuple[str, ...]] = ("centre",)
    velocity = spin = inertia = None

    @refuses_unknown
    def __init__(
        self,
        centre: ArrayLike | Sequence[ArrayLike],
        radius: ArrayLike,
        material: Material | None = None,
        name: str | None = None,
        *,
        motion: AbstractMotion | None = None,
    ):
        self.name, self.material = _name(name), _material(material)
        self.centre = vector(centre, "centre")
        self.radius = one_number(radius, "radius", POSITIVE)
        self.motion = in_space(motion, self.dimensions, "shell")

    def centre_at(self, time: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the centre (T, D) in m at given times in s; needs concrete numbers."""
        if self.motion is None:
            return np.broadcast_to(np.asarray(self.centre, float), (*time.shape, self.dimensions))
        places = jax.vmap(lambda t: origin(*later(self.centre, self.motion, t)))
        return np.asarray(places(jnp.asarray(time)), float)


def spheres_of(bodies: Sequence[AbstractBody]) -> list[tuple[int, Sphere]]:
    """Return the spheres among bodies, each with its number."""
    return [(k, body) for k, body in enumerate(bodies) if isinstance(body, Sphere)]


def shells_of(bodies: Sequence[AbstractBody]) -> list[tuple[int, Shell]]:
    """Return the shells among bodies, each with its number."""
    return [(k, body) for k, body in enumerate(bodies) if isinstance(body, Shell)]


def walls_of(bodies: Sequence[AbstractBody]) -> list[tuple[int, Wall]]:
    """Return the flat walls of bodies, each with the number of its body."""
    return [(k, wall) for k, body in enumerate(bodies) for wall in body.walls()]


def words(bodies: Sequence[AbstractBody], k: int) -> str:
    """Return a body's description for messages."""
    body = bodies[k]
    name = "" if body.name is None else f" {body.name!r}"
    return f"{type(body).__name__}{name} (number {k})"


def names_of(bodies: Sequence[AbstractBody]) -> tuple[str, ...]:
    """Return a name for each body: its own, or its kind and number."""
    return tuple(
        body.name if body.name is not None else f"{type(body).__name__.lower()} {k}"
        for k, body in enumerate(bodies)
    )


def _require_as_many(name: str, value: Any, numbers: Array, other: str, like: Array) -> None:
    if numbers.shape != like.shape:
        raise refusal(name, f"have as many numbers as `{other}`, which has {like.shape[0]}", value)


def _wall(face: int, normal: Any, offset: Array, motion: AbstractMotion | None) -> Wall:
    if motion is None:
        return Wall(face, normal, offset, None, False)
    return Wall(face, normal, offset + motion.start(normal), motion.along(normal), motion.vibrates)


def _name(value: Any) -> str | None:
    return None if value is None else require_kind("name", value, str, "text or None")


def _material(value: Any) -> Material | None:
    if value is None:
        return None
    material = require_kind("material", value, Material, "a `Material` or None")
    for leaf in jax.tree.leaves(material):
        if leaf.shape != ():
            raise refusal("material", "hold one number of each kind", material)
    return material
