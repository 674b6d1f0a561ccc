"""Checks of numbers and vectors given for bodies and motions."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array

from ..._entry import REAL, Range, as_parameter, rendered

_stacked = jax.jit(lambda *parts: jnp.stack(parts))
"""One small program instead of one for each number."""

REAL_OR_INFINITE = "numbers, without NaN"


def one_number(value: Any, name: str, allowed: Range) -> Array:
    """Return a scalar leaf within its range; raises ValueError for anything else."""
    number = as_parameter(value, name, allowed)
    if number.shape != ():
        raise ValueError(f"Argument `{name}` must be one number, but is {rendered(value)}.")
    if not isinstance(number, Tracer) and not allowed.holds(float(number)):
        raise ValueError(f"Argument `{name}` must be in {allowed}, but is {rendered(value)}.")
    return number


def vector(value: Any, name: str, *, finite: bool = True) -> Array:
    """Return one to three numbers as an array; raises ValueError for anything else. The numbers
    must be finite, or only not NaN if `finite` is False.
    """
    # NumPy cannot read a list of traced numbers.
    if isinstance(value, list | tuple) and any(isinstance(part, jax.Array) for part in value):
        parts = [as_parameter(part, name) for part in value]
        if any(part.shape != () for part in parts):
            raise ValueError(
                f"Argument `{name}` must be one to three numbers, but is {rendered(value)}."
            )
        numbers = _stacked(*parts)
    else:
        entry: Any = value
        numbers = as_parameter(entry, name)
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


def spin_in(value: Any, dimensions: int) -> Array:
    """Return the spin of a sphere: () in two dimensions, (3,) in three; raises ValueError for
    anything else.
    """
    if dimensions == 1:
        raise ValueError(
            "Argument `spin` must be None for a sphere in one dimension, which cannot turn, but "
            f"is {rendered(value)}."
        )
    if dimensions == 2:
        return one_number(value, "spin", REAL)
    spin = vector(value, "spin")
    if spin.shape != (3,):
        raise ValueError(
            f"Argument `spin` must be three numbers in three dimensions, but is {rendered(value)}."
        )
    return spin
