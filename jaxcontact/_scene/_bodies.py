"""What a scene is made of: spheres, and the walls they hit."""

from __future__ import annotations

import abc
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Float

from .._contact import Material
from .._parameter import POSITIVE, Range, as_parameter, rendered, require_flag, require_kind

REAL_OR_INFINITE = "numbers, without NaN"


class AbstractBody(eqx.Module):
    """A body of a scene: a name, a material, and a place.

    A subclass tells its `dimensions`, and the `walls` it makes.
    """

    name: eqx.AbstractVar[str | None]
    material: eqx.AbstractVar[Material | None]

    @property
    @abc.abstractmethod
    def dimensions(self) -> int:
        """The number of dimensions of the space it is in."""

    def walls(self) -> list[tuple[int, Array, Array]]:
        """The flat walls it consists of: face, unit normal (D,) to the free side, offset n·p."""
        return []


class Sphere(AbstractBody):
    """A sphere (a disc in two dimensions, an interval in one).

    Arguments: `radius` R > 0 in m; `position` of the centre in m, one to three numbers, whose count
    is the dimension of the scene; `velocity` in m/s, zero if not given; `mass` m > 0 in kg, which
    wins over the density of the `material` (a `Material`); `name`, for tables by pair and messages.
    With `fixed=True` the mass is infinite: a mass or a velocity beside it is an error. Numbers are
    leaves. Raises ValueError for what is out of range or not finite, and where no mass is known.
    """

    radius: Float[Array, ""]
    mass: Float[Array, ""] | None
    position: Float[Array, " D"]
    velocity: Float[Array, " D"] | None
    material: Material | None
    name: str | None = eqx.field(static=True)
    fixed: bool = eqx.field(static=True)

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
    ):
        self.name = _name(name)
        self.material = _material(material)
        self.fixed = require_flag("fixed", fixed)
        self.radius = one_number(radius, "radius", POSITIVE)
        if position is None:
            raise ValueError("Argument `position` must be one to three numbers, but is None.")
        self.position = vector(position, "position")
        self.velocity = None if velocity is None else vector(velocity, "velocity")
        if self.velocity is not None and self.velocity.shape != self.position.shape:
            raise ValueError(
                f"Argument `velocity` must have as many numbers as `position`, which has "
                f"{self.position.shape[0]}, but is {rendered(velocity)}."
            )
        self.mass = None if mass is None else one_number(mass, "mass", POSITIVE)
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
    def dimensions(self) -> int:
        return self.position.shape[0]

    def moved_to(self, position: Array, velocity: Array) -> Sphere:
        """The same sphere at another place; a fixed one is where it was."""
        if self.fixed:
            return self
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
    """A fixed plane (a line in two dimensions, a point in one), with one free side.

    Arguments: a `point` on it in m; a `normal` that points to the free side, of any length but
    zero; `material`, None for a rigid plane; `name`. Numbers are leaves. Raises ValueError for
    numbers that are not finite, dimensions that differ, or a zero normal.
    """

    point: Float[Array, " D"]
    normal: Float[Array, " D"]
    material: Material | None
    name: str | None = eqx.field(static=True)

    def __init__(
        self,
        point: ArrayLike | Sequence[ArrayLike],
        normal: ArrayLike | Sequence[ArrayLike],
        material: Material | None = None,
        name: str | None = None,
    ):
        self.name = _name(name)
        self.material = _material(material)
        self.point = vector(point, "point")
        self.normal = vector(normal, "normal")
        if self.normal.shape != self.point.shape:
            raise ValueError(
                f"Argument `normal` must have as many numbers as `point`, which has "
                f"{self.point.shape[0]}, but is {rendered(normal)}."
            )
        if not isinstance(self.normal, Tracer) and not np.any(np.asarray(self.normal)):
            raise ValueError(f"Argument `normal` must not be zero, but is {rendered(normal)}.")

    @property
    def dimensions(self) -> int:
        return self.point.shape[0]

    def walls(self) -> list[tuple[int, Array, Array]]:
        unit = self.normal / jnp.linalg.norm(self.normal)
        return [(-1, unit, jnp.sum(unit * self.point))]


class Box(AbstractBody):
    """A container with fixed walls: spheres are between `low` and `high` along every axis.

    Arguments: `low` < `high` in m, one to three numbers each; an infinite number leaves its side
    open; `material`, None for rigid walls; `name`. Face 2k is that at `low[k]`, face 2k+1 that at
    `high[k]`. Numbers are leaves. Raises ValueError for NaN, dimensions that differ, or a low that
    is not below its high.
    """

    low: Float[Array, " D"]
    high: Float[Array, " D"]
    material: Material | None
    name: str | None = eqx.field(static=True)

    def __init__(
        self,
        low: ArrayLike | Sequence[ArrayLike],
        high: ArrayLike | Sequence[ArrayLike],
        material: Material | None = None,
        name: str | None = None,
    ):
        self.name = _name(name)
        self.material = _material(material)
        self.low = vector(low, "low", finite=False)
        self.high = vector(high, "high", finite=False)
        if self.high.shape != self.low.shape:
            raise ValueError(
                f"Argument `high` must have as many numbers as `low`, which has "
                f"{self.low.shape[0]}, but is {rendered(high)}."
            )
        known = not isinstance(self.low, Tracer) and not isinstance(self.high, Tracer)
        if known and not np.all(np.asarray(self.low) < np.asarray(self.high)):
            raise ValueError(
                f"Argument `high` must be above `low` = {rendered(low)}, but is {rendered(high)}."
            )

    @property
    def dimensions(self) -> int:
        return self.low.shape[0]

    def walls(self) -> list[tuple[int, Array, Array]]:
        made = []
        for axis in range(self.dimensions):
            for side, ends in enumerate((self.low, self.high)):
                at = ends[axis]
                if not isinstance(at, Tracer) and np.isinf(np.asarray(at)):
                    continue
                sign = 1.0 - 2.0 * side
                normal = np.zeros(self.dimensions)
                normal[axis] = sign
                made.append((2 * axis + side, jnp.asarray(normal, at.dtype), sign * at))
        return made


def words(bodies: Sequence[AbstractBody], k: int) -> str:
    """A body as messages name it."""
    body = bodies[k]
    name = "" if body.name is None else f" {body.name!r}"
    return f"{type(body).__name__}{name} (number {k})"


def one_number(value: Any, name: str, allowed: Range) -> Array:
    """A scalar leaf in its range; ValueError for anything else."""
    number = as_parameter(value, name, allowed)
    if number.shape != ():
        raise ValueError(f"Argument `{name}` must be one number, but is {rendered(value)}.")
    if not isinstance(number, Tracer) and not allowed.holds(float(number)):
        raise ValueError(f"Argument `{name}` must be in {allowed}, but is {rendered(value)}.")
    return number


def vector(value: Any, name: str, *, finite: bool = True) -> Array:
    """One to three numbers as an array, finite or only not NaN; ValueError for anything else."""
    # NumPy cannot read a list that holds traced numbers.
    if isinstance(value, list | tuple) and any(isinstance(one, jax.Array) for one in value):
        parts = [as_parameter(one, name) for one in value]
        if any(part.shape != () for part in parts):
            raise ValueError(
                f"Argument `{name}` must be one to three numbers, but is {rendered(value)}."
            )
        numbers = jnp.stack([jnp.asarray(part) for part in jnp.broadcast_arrays(*parts)])
    else:
        given: Any = value
        numbers = as_parameter(given, name)
    if numbers.ndim != 1 or not 1 <= numbers.shape[0] <= 3:
        raise ValueError(
            f"Argument `{name}` must be one to three numbers, but is {rendered(value)}."
        )
    if not isinstance(numbers, Tracer):
        plain = np.asarray(numbers)
        if not np.all(np.isfinite(plain) if finite else ~np.isnan(plain)):
            allowed = "finite numbers" if finite else REAL_OR_INFINITE
            raise ValueError(f"Argument `{name}` must be {allowed}, but is {rendered(value)}.")
    return numbers


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
