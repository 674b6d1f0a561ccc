"""Parameters of ready-made mechanisms on entry, and where they start."""

from __future__ import annotations

from typing import Any, TypedDict

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._entry import POSITIVE, REAL, Range, as_parameter, refusal
from .._program import traced


def positive(name: str, value: Any, shape: tuple[int, ...] = ()) -> Array:
    """Return numbers above 0 of a shape; raise ValueError for any others."""
    return _of_shape(name, value, shape, POSITIVE)


def real(name: str, value: Any, shape: tuple[int, ...] = ()) -> Array:
    """Return numbers of a shape; raise ValueError for any others."""
    return _of_shape(name, value, shape, REAL)


def _of_shape(name: str, value: Any, shape: tuple[int, ...], allowed: Range) -> Array:
    numbers = as_parameter(value, name, allowed)
    if numbers.shape != shape:
        many = "one number" if shape == () else f"{shape[0]} numbers"
        raise refusal(name, f"be {many}", value)
    return numbers


def start(position: Any, velocity: Any) -> SystemStart:
    """Return a start from two lists of numbers, or arrays."""
    return SystemStart(position=_column(position), velocity=_column(velocity))


def _column(numbers: Any) -> Array:
    """Return numbers as an array. Concrete ones use NumPy, which needs no compilation."""
    if traced(numbers):
        return vector(*numbers)
    # One by one, since NumPy makes no array of a list with numbers of bfloat16.
    return jax.device_put(np.stack([np.asarray(x) for x in numbers]))


def diagonal(*numbers: Array) -> Array:
    """Return a diagonal matrix."""
    n, zero = len(numbers), jnp.zeros_like(numbers[0])
    entries = [numbers[k] if k == j else zero for k in range(n) for j in range(n)]
    return jnp.stack(entries).reshape(n, n)


def vector(*numbers: Any) -> Array:
    """Return numbers as one array."""
    return jnp.stack([jnp.asarray(x) for x in numbers])


class SystemStart(TypedDict):
    """The start of a mechanism, as `simulate` takes it: `simulate(system, duration, **start)`."""

    position: Float[Array, " n"]
    velocity: Float[Array, " n"]
