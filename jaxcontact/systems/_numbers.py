"""Parameters of ready-made mechanisms on entry."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array

from .._entry import POSITIVE, REAL, Range, as_parameter, rendered


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
        raise ValueError(f"Argument `{name}` must be {many}, but is {rendered(value)}.")
    return numbers


def vector(*numbers: Any) -> Array:
    """Return numbers as one array."""
    return jnp.stack([jnp.asarray(x) for x in numbers])
