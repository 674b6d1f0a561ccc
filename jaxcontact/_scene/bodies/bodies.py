"""What a scene is made of: spheres, and the walls and shells they hit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Float
from numpy.typing import NDArray

from ..._contact import Material
from ..._parameter import POSITIVE, refuses_unknown, rendered, require_flag, require_kind
from .entry import one_number, vector
from .motion import AbstractMotion, Along, begun, checked, in_space, later


class Wall(NamedTuple):
    """A flat wall at time zero: its `face` of a box or -1, the unit `normal` (D,) to the free side,
    the `offset` n·p in m, and how it goes on along the normal; None where it stands.
    """

    face: int
    normal: Array
    offset: Array
    motion: Along | None
    vibrates: bool

    def offset_at(self, time: NDArray[np.float64]) -> NDArray[np.float64]:
        """The offset at some times in s, in m, of a wall whose numbers are known."""
        offset = np.full(time.shape, float(self.offset))
        if self.motion is None:
            return offset
        speed, amplitude, rate, phase = (float(number) for number in self.motion[:4])
        offset += speed * time + amplitude * (np.sin(rate * time + phase) - np.sin(phase))
        if self.motion.own is not None:
            places = jax.vmap(self.motion.own.place)
            offset += np.asarray(places(jnp.asarray(time)) - places(jnp.zeros(1)))
        return offset


class AbstractBody(eqx.Module):
    """A body of a scene: a name, a material, and a place.

    A subclass tells which of its fields are places, and the `walls` it makes.
    """

    name: eqx.AbstractVar[str | None]
    material: eqx.AbstractVar[Material | None]
    motion: eqx.AbstractVar[AbstractMotion | None]
    _places: eqx.AbstractClassVar[tuple[str, ...]]

    @property
    def dimensions(self) -> int:
        """The number of dimensions of the space it is in."""
        return getattr(self, self._places[0]).shape[0]

    def walls(self) -> list[Wall]:
        """The flat walls it consists of."""
        return []

    def after(self, time: Array) -> Self:
        """The same body at a later time, if its motion is prescribed."""
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

    Arguments: `radius` R > 0 in m; `position` of the centre in m, one to three numbers, whose count
    is the dimension of the scene; `velocity` in m/s, zero if not given; `mass` m > 0 in kg, which
    wins over the density of the `material` (a `Material`); `name`, for tables by pair and messages.
    With `fixed=True` the mass is infinite: a mass or a velocity beside it is an error, and it may
    have a `motion`, whoever it hits: a `Steady`, or a `Vibration` or a `Prescribed` of vectors, by
    which it is displaced from its `position`. Numbers are leaves. Raises ValueError for what is out
    of range or not finite, and where no mass is known.
    """

    radius: Float[Array, ""]
    mass: Float[Array, ""] | None
    position: Float[Array, " D"]
    velocity: Float[Array, " D"] | None
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
    ):
        self.name = _name(name)
        self.material = _material(material)
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
        self.motion = in_space(motion, self.dimensions, "fixed sphere")
        if self.motion is not None and not self.fixed:
            raise ValueError(
                "Argument `motion` must be None for a sphere without `fixed=True`, which moves as "
                f"it is hit, but is {rendered(motion)}."
            )
        if self.fixed:
            for other, given in (("mass", mass), ("velocity", velocity)):
                if given is not None:
                    raise ValueError(
                        f"Argument `{other}` must be None for a sphere with `fixed=True`, whose "
                        f"mass is infinite and which does not move, but is {rendered(given)}."
                    )
        elif mass is None and (material is None or material.density is None):
            raise ValueError(
                "Argument `mass` must be given for a sphere whose material has no density, but is "
                "None; or give `material` with a density, or `fixed=True`."
            )

    @property
    def place(self) -> Array:
        """The centre at time zero."""
        return begun(self.position, self.motion)

    def moved_to(self, position: Array, velocity: Array) -> Sphere:
        """The same sphere at another place."""
        if self.fixed:
            return eqx.tree_at(lambda body: body.position, self, position)
        return eqx.tree_at(
            lambda body: (body.position, body.velocity),
            self,
            (position, velocity),
            is_leaf=lambda leaf: leaf is None,
        )

    def inertia(self) -> Float[Array, ""] | None:
        """Its mass in kg; None where it is fixed."""
        if self.fixed:
            return None
        if self.mass is not None:
            return self.mass
        assert self.material is not None
        return self.material.sphere_mass(self.radius)


class Plane(AbstractBody):
    """A plane (a line in two dimensions, a point in one), with one free side.

    Arguments: a `point` on it in m; a `normal` that points to the free side, of any length but
    zero; `material`, None for a rigid plane; `name`; `motion`, a `Steady`, a `Vibration` or a
    `Prescribed`, None for a plane that stands. Numbers are leaves. Raises ValueError for numbers
    that are not finite, dimensions that differ, or a zero normal.
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
        self.name = _name(name)
        self.material = _material(material)
        self.point = vector(point, "point")
        self.normal = vector(normal, "normal")
        _require_as_many("normal", normal, self.normal, "point", self.point)
        if not isinstance(self.normal, Tracer) and not np.any(np.asarray(self.normal)):
            raise ValueError(f"Argument `normal` must not be zero, but is {rendered(normal)}.")
        self.motion = checked(motion, self.dimensions)

    def walls(self) -> list[Wall]:
        normal, point = _untraced(self.normal), _untraced(self.point)
        known = isinstance(normal, np.ndarray)
        unit = normal / (np if known else jnp).linalg.norm(normal)
        return [_wall(-1, unit, (unit * point).sum(), self.motion)]


class Box(AbstractBody):
    """A container: spheres are between `low` and `high` along every axis.

    Arguments: `low` < `high` in m, one to three numbers each; an infinite number leaves its side
    open; `material`, None for rigid walls; `name`; `motion` of all walls at once, a `Steady`, or
    a `Vibration` or a `Prescribed` of vectors, None for a box that stands. Face 2k is that at
    `low[k]`, face 2k+1 that at `high[k]`. Numbers are leaves. Raises ValueError for NaN, dimensions
    that differ, or a low that is not below its high.
    """

    low: Float[Array, " D"]
    high: Float[Array, " D"]
    material: Material | None
    motion: AbstractMotion | None
    name: str | None = eqx.field(static=True)
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
        self.name = _name(name)
        self.material = _material(material)
        self.low = vector(low, "low", finite=False)
        self.high = vector(high, "high", finite=False)
        _require_as_many("high", high, self.high, "low", self.low)
        known = not isinstance(self.low, Tracer) and not isinstance(self.high, Tracer)
        if known and not np.all(np.asarray(self.low) < np.asarray(self.high)):
            raise ValueError(
                f"Argument `high` must be above `low` = {rendered(low)}, but is {rendered(high)}."
            )
        self.motion = in_space(motion, self.dimensions, "box")

    def walls(self) -> list[Wall]:
        made = []
        for axis in range(self.dimensions):
            for side, ends in enumerate((_untraced(self.low), _untraced(self.high))):
                if isinstance(ends, np.ndarray) and np.isinf(ends[axis]):
                    continue
                at = ends[axis]
                sign = 1.0 - 2.0 * side
                unit = np.zeros(self.dimensions, at.dtype)
                unit[axis] = sign
                made.append(_wall(2 * axis + side, unit, sign * at, self.motion))
        return made


class Shell(AbstractBody):
    """The inside of a fixed sphere (of a circle in two dimensions, an interval in one).

    Arguments: `centre` in m, one to three numbers; `radius` R > 0 in m; `material`, None for a
    rigid shell; `name`; `motion`, a `Steady`, or a `Vibration` or a `Prescribed` of vectors, None
    for a shell that stands. Spheres are inside of it. Numbers are leaves. Raises ValueError for
    what is out of range or not finite.
    """

    centre: Float[Array, " D"]
    radius: Float[Array, ""]
    material: Material | None
    motion: AbstractMotion | None
    name: str | None = eqx.field(static=True)
    _places: ClassVar[tuple[str, ...]] = ("centre",)

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
        self.name = _name(name)
        self.material = _material(material)
        self.centre = vector(centre, "centre")
        self.radius = one_number(radius, "radius", POSITIVE)
        self.motion = in_space(motion, self.dimensions, "shell")

    @property
    def place(self) -> Array:
        """The centre at time zero."""
        return begun(self.centre, self.motion)

    def centre_at(self, time: NDArray[np.float64]) -> NDArray[np.float64]:
        """The centre at some times in s, (T, D) in m, of a shell whose numbers are known."""
        if self.motion is None:
            return np.broadcast_to(np.asarray(self.centre, float), (*time.shape, self.dimensions))
        places = jax.vmap(lambda t: begun(*later(self.centre, self.motion, t)))
        return np.asarray(places(jnp.asarray(time)), float)


def words(bodies: Sequence[AbstractBody], k: int) -> str:
    """A body as messages name it."""
    body = bodies[k]
    name = "" if body.name is None else f" {body.name!r}"
    return f"{type(body).__name__}{name} (number {k})"


def _require_as_many(name: str, given: Any, found: Array, other: str, known: Array) -> None:
    if found.shape != known.shape:
        raise ValueError(
            f"Argument `{name}` must have as many numbers as `{other}`, which has "
            f"{known.shape[0]}, but is {rendered(given)}."
        )


def _untraced(numbers: Array) -> Any:
    """Known numbers for NumPy, which compiles nothing; others as they are."""
    return numbers if isinstance(numbers, Tracer) else np.asarray(numbers)


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
            raise ValueError(
                "Argument `material` must hold one number of each kind, but is "
                f"{rendered(material)}."
            )
    return material
