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


Drawing = tuple[np.ndarray, list[np.ndarray]]
"""A picture of a mechanism: points (P, 2), those of the gaps first, and lines (L, 2) in m."""


def circle(centre: Any, radius: Any) -> np.ndarray:
    """Return a circle as a closed line (49, 2)."""
    angle = np.linspace(0, 2 * np.pi, 49)
    return np.asarray(centre) + float(radius) * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def rectangle(centre: Any, half_sizes: Any, angle: Any = 0.0) -> np.ndarray:
    """Return a rectangle, turned by an angle in rad, as a closed line (5, 2)."""
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) * np.asarray(half_sizes)
    cos, sin = np.cos(angle), np.sin(angle)
    return np.asarray(centre) + corners @ np.array([[cos, sin], [-sin, cos]])


class SystemStart(TypedDict):
    """The start of a mechanism, as `simulate` takes it: `simulate(system, duration, **start)`."""

    position: Float[Array, " n"]
    velocity: Float[Array, " n"]
