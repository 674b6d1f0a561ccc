"""Checks of numbers and vectors given for bodies and motions."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..._entry import REAL, Range, as_parameter, is_list, refusal, traced

_stacked = jax.jit(lambda *parts: jnp.stack(parts))
"""One small program instead of one for each number."""

REAL_OR_INFINITE = "numbers, without NaN"


def one_number(value: Any, name: str, allowed: Range) -> Array:
    """Return a scalar leaf within its range; raises ValueError for anything else."""
    number = as_parameter(value, name, allowed)
    if number.shape != ():
        raise refusal(name, "be one number", value)
    if not traced(number) and not allowed.holds(float(number)):
        raise refusal(name, f"be in {allowed}", value)
    return number


def vector(value: Any, name: str, *, finite: bool = True) -> Array:
    """Return one to three numbers as an array; raises ValueError for anything else. The numbers
    must be finite, or only not NaN if `finite` is False.
    """
    numbers = _numbers_in(value, name)
    allowed = None
    if numbers is None or numbers.ndim != 1 or not 1 <= numbers.shape[0] <= 3:
        allowed = "one to three numbers"
    elif traced(numbers):
        return numbers
    elif finite and not np.all(np.isfinite(np.asarray(numbers))):
        allowed = "finite numbers"
    elif np.any(np.isnan(np.asarray(numbers))):
        allowed = REAL_OR_INFINITE
    if numbers is None or allowed is not None:
        raise refusal(name, f"be {allowed}", value)
    return numbers


def _numbers_in(value: Any, name: str) -> Array | None:
    """Return an array, also from a list of traced numbers, which NumPy cannot read; None if one of
    these is an array.
    """
    if not is_list(value) or not any(isinstance(part, jax.Array) for part in value):
        return as_parameter(value, name)  # pyright: ignore[reportArgumentType]
    parts = [as_parameter(part, name) for part in value]
    return None if any(part.shape != () for part in parts) else _stacked(*parts)


def spin_in(value: Any, dimensions: int) -> Array:
    """Return the spin of a sphere: () in two dimensions, (3,) in three; raises ValueError for
    anything else.
    """
    if dimensions == 1:
        raise refusal("spin", "be None for a sphere in one dimension, which cannot turn", value)
    if dimensions == 2:
        return one_number(value, "spin", REAL)
    spin = vector(value, "spin")
    if spin.shape != (3,):
        raise refusal("spin", "be three numbers in three dimensions", value)
    return spin
