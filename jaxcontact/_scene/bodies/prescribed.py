"""Bodies that move by a user's function."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike

from ..._coupled.scalars import Number
from ..._entry import POSITIVE, as_parameter, is_plain, rendered, require_function
from .entry import one_number
from .motion import AbstractMotion, Along, UserMotion, as_numpy, shifts, still


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
            raise ValueError(
                "Argument `displacement` must be a function that returns one number or one to "
                f"three numbers of floating point, but is {rendered(displacement)}."
            )

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
