"""Prescribed motions of walls, fixed spheres and shells, unaffected by impacts; also those of a
user's function.
"""

from __future__ import annotations

import abc
import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ..._coupled.modes import Number
from ..._entry import (
    POSITIVE,
    REAL,
    as_parameter,
    is_plain,
    refusal,
    rendered,
    require_function,
    require_kind,
    traced,
)
from ..._program import quick
from .entry import one_number, vector


class UserMotion(eqx.Module):
    """A user's displacement function in units of `length` m and `tick` s.

    It is d(began + tick t)/length, or n·d/length along the `normal` of a wall. `bound` limits |d''|
    in m/s².
    """

    displacement: Callable[[Any, Any], Any] = eqx.field(static=True)
    args: Any
    began: Array
    normal: Array | None
    bound: Array
    length: Array
    tick: Array

    def place(self, time: Array) -> Array:
        """Return the displacement at one time."""
        moved = self.displacement(self.began + self.tick * time, self.args)
        if self.normal is not None and jnp.ndim(moved) > 0:
            moved = jnp.sum(self.normal * moved)
        return moved / self.length

    def velocity(self, time: Array) -> Array:
        """Return the velocity at one time."""
        return jax.jvp(self.place, (time,), (jnp.ones_like(time),))[1]

    def acceleration(self, time: Array) -> Array:
        """Return the acceleration at one time."""
        return jax.jvp(self.velocity, (time,), (jnp.ones_like(time),))[1]

    def push(self, time: Array) -> Array:
        """Return the acceleration (D,) in space at one time."""
        along = self.acceleration(time)
        return along if self.normal is None else along * self.normal

    def later(self, time: Array) -> UserMotion:
        """Return the motion with a later time zero."""
        return eqx.tree_at(lambda motion: motion.began, self, self.began + self.tick * time)

    def scaled(self, length: Array, tick: Array) -> UserMotion:
        """Return the motion in other units; it must be in m and s."""
        return eqx.tree_at(lambda motion: (motion.length, motion.tick), self, (length, tick))


class Along(NamedTuple):
    """A motion V t + A (sin(ω t + φ) - sin φ) relative to t = 0, plus a user's function `own`.

    V and A are numbers along a normal, or vectors in space.
    """

    speed: Any
    amplitude: Any
    rate: Any
    phase: Any
    own: UserMotion | None = None


shifts = quick(jax.vmap(UserMotion.place, in_axes=(None, 0)))
"""Displacements of a user's function at several times, as one program."""


def as_numpy(numbers: Array) -> Any:
    """Return concrete numbers as NumPy arrays, which need no compilation, and others unchanged."""
    return numbers if traced(numbers) else np.asarray(numbers)


def still() -> Along:
    """Return a motion at rest."""
    zero = np.zeros(())
    return Along(zero, zero, zero, zero)


class AbstractMotion(eqx.Module):
    """A prescribed motion: the displacement of a body from the place where it is given.

    A wall uses the component along its normal. Spheres and shells move in space.
    """

    @property
    @abc.abstractmethod
    def dimensions(self) -> int | None:
        """The number of space dimensions; None if any number fits."""

    @property
    @abc.abstractmethod
    def vibrates(self) -> bool:
        """True if the motion is accelerated."""

    @abc.abstractmethod
    def start(self, normal: Array | None) -> Any:
        """Return the displacement in m at time zero."""

    @abc.abstractmethod
    def along(self, normal: Array | None) -> Along:
        """Return the motion from time zero on."""

    @abc.abstractmethod
    def after(self, time: Array) -> tuple[Array | None, AbstractMotion]:
        """Return the displacement of the place after a time, and the motion from then on."""


class Steady(AbstractMotion):
    """A motion of a wall, fixed sphere or shell at constant velocity: d(t) = V t.

    Argument: `velocity` V in m/s, one number for each dimension of the scene. Raises ValueError for
    values that are not finite.
    """

    velocity: Float[Array, " D"]

    def __init__(self, velocity: ArrayLike | Sequence[ArrayLike]):
        self.velocity = vector(velocity, "velocity")

    @property
    def dimensions(self) -> int:
        return self.velocity.shape[0]

    @property
    def vibrates(self) -> bool:
        return False

    def start(self, normal: Array | None) -> Any:
        return np.zeros(() if normal is not None else self.velocity.shape, self.velocity.dtype)

    def along(self, normal: Array | None) -> Along:
        speed = as_numpy(self.velocity)
        return still()._replace(speed=speed if normal is None else (normal * speed).sum())

    def after(self, time: Array) -> tuple[Array, Steady]:
        return self.velocity * time, self


class Vibration(AbstractMotion):
    """A harmonic motion of a wall, fixed sphere or shell: displacement d(t) = A sin(2π f t + φ).

    - `amplitude`: A in m, one number for each dimension of the scene, or for a plane one number
      along its normal.
    - `frequency`: f > 0 in Hz.
    - `phase`: φ in rad.

    The displacement is relative to the place where the body is given. Numbers are leaves. Raises
    ValueError for values out of range or not finite.
    """

    amplitude: Float[Array, " D"] | Number
    frequency: Number
    phase: Number

    def __init__(
        self,
        amplitude: ArrayLike | Sequence[ArrayLike],
        frequency: ArrayLike,
        phase: ArrayLike = 0.0,
    ):
        single = is_plain(amplitude) or getattr(amplitude, "ndim", None) == 0
        read = functools.partial(one_number, allowed=REAL) if single else vector
        self.amplitude = read(amplitude, "amplitude")
        self.frequency = one_number(frequency, "frequency", POSITIVE)
        self.phase = one_number(phase, "phase", REAL)

    @property
    def dimensions(self) -> int | None:
        return self.amplitude.shape[0] if self.amplitude.ndim else None

    @property
    def vibrates(self) -> bool:
        return True

    def start(self, normal: Array | None) -> Array:
        motion = self.along(normal)
        sine = jnp.sin if traced(motion.phase) else np.sin
        return motion.amplitude * sine(motion.phase)

    def along(self, normal: Array | None) -> Along:
        amplitude, frequency, phase = map(as_numpy, (self.amplitude, self.frequency, self.phase))
        if normal is not None and amplitude.ndim:
            amplitude = (normal * amplitude).sum()
        return Along(np.zeros(()), amplitude, 2 * np.pi * frequency, phase)

    def after(self, time: Array) -> tuple[None, Vibration]:
        phase = self.phase + 2 * np.pi * self.frequency * time
        return None, eqx.tree_at(lambda motion: motion.phase, self, phase)


def require_motion(value: Any, dimensions: int) -> AbstractMotion | None:
    """Return the motion of a body in so many dimensions; raises ValueError if it does not fit."""
    if value is None:
        return None
    motion = require_kind(
        "motion", value, AbstractMotion, "a `Steady`, a `Vibration`, a `Prescribed` or None"
    )
    if motion.dimensions not in (None, dimensions):
        raise refusal("motion", f"have {dimensions} numbers, as the body has", value)
    return motion


def in_space(value: Any, dimensions: int, body: str) -> AbstractMotion | None:
    """Return the motion of a body without a normal; raises ValueError for a scalar motion."""
    motion = require_motion(value, dimensions)
    if motion is not None and motion.dimensions is None:
        raise ValueError(
            f"Argument `motion` of a {body} must have a list of numbers as its amplitude or its "
            f"displacement, but is {rendered(value)}."
        )
    return motion


def origin(place: Array, motion: AbstractMotion | None) -> Array:
    """Return the position at time zero of a body that moves in space."""
    return place + motion.start(None) if motion is not None and motion.vibrates else place


def later(
    place: Array, motion: AbstractMotion | None, time: Array
) -> tuple[Array, AbstractMotion | None]:
    """Return the place where a body is given and its motion, from a later time on."""
    if motion is None:
        return place, None
    moved, after = motion.after(time)
    return (place if moved is None else place + moved), after


@dataclasses.dataclass(frozen=True)
class _Told:
    """The function with the part of `args` that is not an array; compared by value."""

    function: Callable[[Any, Any], Any]
    rest: tuple[Any, ...]
    structure: Any

    def __call__(self, time: Array, arrays: Any) -> Any:
        rest = jax.tree.unflatten(self.structure, self.rest)
        return self.function(time, eqx.combine(arrays, rest))


class Prescribed(AbstractMotion):
    """A motion of a wall, fixed sphere or shell by a user's function: displacement d(t).

    - `displacement(t, args)`: a JAX function of the time in s with two derivatives. It returns the
      displacement in m from the place where the body is given: one number for each dimension, or
      for a plane one number along its normal.
    - `max_acceleration`: b > 0 in m/s², a bound |d''(t)| ≤ b. The search for touches relies on it.
    - `args`: further arguments of the function, such as an equinox network. Numbers in it are
      leaves; everything else must be hashable.

    The function is static: define it once, and pass changing values in `args`. The bound is checked
    at 4097 times of the run. From its first violation on, the run is flagged
    (`Ending.WALL_TOO_ABRUPT`). Raises ValueError if `displacement` is not a function or does not
    return a displacement, and for values out of range.
    """

    args: Any
    max_acceleration: Number
    _began: Number
    displacement: Callable[[Any, Any], Any] = eqx.field(static=True)

    def __init__(
        self, displacement: Callable[[Any, Any], Any], max_acceleration: ArrayLike, args: Any = None
    ):
        self.displacement = require_function("displacement", displacement)
        self.max_acceleration = one_number(max_acceleration, "max_acceleration", POSITIVE)

        def read(leaf: Any) -> Any:
            is_number: bool = is_plain(leaf) or isinstance(leaf, np.ndarray | np.generic)
            number: Any = leaf
            return as_parameter(number, "args") if is_number else leaf

        self.args = jax.tree.map(read, args)
        self._began = jnp.zeros_like(self.max_acceleration)
        try:
            shape = self._shape()
        except TypeError as error:
            # Most often the function takes other arguments.
            raise ValueError(
                "Argument `displacement` must be a function of the time and of `args`, but "
                f"{rendered(displacement)} cannot be called so: {error}"
            ) from error
        if shape is None or len(shape) > 1 or not 1 <= sum(shape or (1,)) <= 3:
            must = "be a function that returns one number or one to three numbers of floating point"
            raise refusal("displacement", must, displacement)

    def _shape(self) -> tuple[int, ...] | None:
        """Return the shape of a displacement; None unless it is a floating-point array."""
        shape = jax.eval_shape(lambda t: self.displacement(t, self.args), self._began)
        is_array = isinstance(shape, jax.ShapeDtypeStruct)
        return shape.shape if is_array and jnp.issubdtype(shape.dtype, jnp.floating) else None

    @property
    def dimensions(self) -> int | None:
        shape = self._shape()
        return shape[0] if shape else None

    @property
    def vibrates(self) -> bool:
        return True

    def _own(self, normal: Array | None) -> UserMotion:
        unit: Any = np.ones((), self._began.dtype)
        arrays, rest = eqx.partition(self.args, eqx.is_array)
        leaves, structure = jax.tree.flatten(rest)
        function = _Told(self.displacement, tuple(leaves), structure)
        return UserMotion(function, arrays, self._began, normal, self.max_acceleration, unit, unit)

    def start(self, normal: Array | None) -> Any:
        return as_numpy(shifts(self._own(normal), np.zeros(1, self._began.dtype)))[0]

    def along(self, normal: Array | None) -> Along:
        return still()._replace(own=self._own(normal))

    def after(self, time: Array) -> tuple[None, Prescribed]:
        return None, eqx.tree_at(lambda motion: motion._began, self, self._began + time)
