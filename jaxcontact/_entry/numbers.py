"""Numbers and arrays on entry: conversion, ranges and error messages."""

from __future__ import annotations

import dataclasses
import itertools
import math
from typing import Any, TypeGuard

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, ArrayLike

from .choices import refusal, rendered


@dataclasses.dataclass(frozen=True)
class Range:
    """The interval a parameter must lie in; `inside` is an arbitrary number in it."""

    low: float = -math.inf
    high: float = math.inf
    low_open: bool = False
    high_open: bool = False
    inside: float = 0.5

    def __str__(self) -> str:
        low_bracket = "(" if self.low_open or math.isinf(self.low) else "["
        high_bracket = ")" if self.high_open or math.isinf(self.high) else "]"
        return f"{low_bracket}{self.low:g}, {self.high:g}{high_bracket}"

    def holds(self, x: Any) -> Any:
        """Return whether x, a float or an array, lies inside; False for NaN and the infinities."""
        above = (x > self.low) if self.low_open else (x >= self.low)
        below = (x < self.high) if self.high_open else (x <= self.high)
        return above & below & (abs(x) < math.inf)


POSITIVE = Range(low=0.0, low_open=True, inside=1.0)
NOT_NEGATIVE = Range(low=0.0, inside=0.0)
REAL = Range(inside=0.0)
RESTITUTION = Range(low=0.0, high=1.0, low_open=True, inside=0.5)
RESTITUTION_FROM_ZERO = Range(low=0.0, high=1.0, inside=0.5)
FRACTION = Range(low=0.0, high=1.0, low_open=True, high_open=True, inside=0.5)


_MOST_BITS = 63


def as_parameter(value: ArrayLike, name: str, allowed: Range = REAL) -> Array:
    """Convert a number or an array to a floating-point JAX array.

    A Python or numpy scalar outside `allowed` raises ValueError, because no batch could hold a
    flag. Arrays and traced values pass; `impact` flags their bad lanes.
    """
    if type(value) is float and allowed.holds(value):
        return as_leaf(value)
    array = value if isinstance(value, jax.Array) else _from_python(value, name, allowed)
    if not _is_real(array.dtype):
        raise _not_a_number(value, name)
    return array if jnp.issubdtype(array.dtype, jnp.floating) else array.astype(float)


def as_parameters(tree: Any, name: str) -> Any:
    """Convert the plain numbers of a tree to arrays."""
    return jax.tree.map(lambda leaf: as_parameter(leaf, name) if is_plain(leaf) else leaf, tree)


# A Python number stays weakly typed and takes the precision of the arrays it is combined with. The
# compiled identity creates an array in a third of the time of `jnp.asarray`.
as_leaf = jax.jit(lambda number: number, inline=True)


def as_number(value: ArrayLike, name: str, allowed: Range = REAL) -> float | Array:
    """Convert as `as_parameter` does, but keep a Python float for compiled code to convert."""
    if type(value) is float and allowed.holds(value):
        return value
    return as_parameter(value, name, allowed)


def _from_python(value: Any, name: str, allowed: Range) -> Array:
    plain = real_array(value, name)
    scalar = plain.ndim == 0 and not isinstance(value, np.ndarray)
    if scalar and not allowed.holds(float(plain)):
        raise refusal(name, f"be in {allowed}", value)
    if isinstance(value, int | float):
        return as_leaf(float(value))
    # Without double precision JAX would wrap large integers around.
    whole = jnp.issubdtype(plain.dtype, jnp.integer)
    return as_own(plain.astype(float) if whole else plain)


def as_own(value: Any) -> Array:
    """Return a JAX array that shares no memory with `value`; `asarray` would compile a copy."""
    return jax.device_put(np.array(value))


def as_numbers(value: Any, name: str) -> np.ndarray:
    """Convert real numbers to a NumPy array of double precision; ValueError for anything else."""
    return real_array(value, name).astype(float)


def real_array(value: Any, name: str) -> np.ndarray:
    """Convert real numbers to a NumPy array of their own type; ValueError for anything else."""
    if isinstance(value, np.ma.MaskedArray):
        raise ValueError(
            f"Argument `{name}` must be an array without a mask (`filled(nan)` makes one, whose "
            f"masked lanes are flagged), but is {rendered(value)}."
        )
    # NumPy would read the characters of a `bytearray` as numbers.
    plain = None if isinstance(value, bytearray) else as_array(value)
    if plain is None or not _is_real(plain.dtype):
        raise _not_a_number(value, name)
    return plain


def as_array(value: Any, dtype: Any = None) -> np.ndarray | None:
    """Convert a value to a NumPy array; None if NumPy cannot convert it."""
    try:
        return np.asarray(value, dtype)
    except Exception:  # a foreign object runs its own conversion here, which may raise anything
        return None


def flag_array(value: Any) -> np.ndarray | None:
    """Convert an array of flags to NumPy; None for anything else."""
    plain = None if isinstance(value, np.ma.MaskedArray) else as_array(value)
    return plain if plain is not None and plain.dtype == bool and plain.ndim > 0 else None


def as_weights(value: Any) -> Any:
    """Convert flags (True keeps a point) to ones and zeros; return other weights unchanged."""
    flags = flag_array(value)
    return value if flags is None else flags.astype(float)


def _is_real(dtype: Any) -> bool:
    """Return whether numbers of this type are real and fit into JAX with all their digits."""
    real = jnp.issubdtype(dtype, jnp.floating) or jnp.issubdtype(dtype, jnp.integer)
    # NumPy counts durations as integers and has long doubles of 16 bytes.
    return real and dtype.kind != "m" and dtype.itemsize <= 8


def _not_a_number(value: Any, name: str) -> ValueError:
    return refusal(name, "be a real number or an array of real numbers, of at most 64 bits", value)


def static_value(number: Any) -> float | None:
    """Return a number that is known while tracing and specialises code; None for an array."""
    return number if isinstance(number, float) else None


def is_plain(value: Any) -> TypeGuard[int | float | np.integer | np.floating]:
    """Return whether a number is a Python or NumPy scalar, which may specialise compiled code."""
    return isinstance(value, int | float | np.integer | np.floating)


def concrete(value: Any) -> int | float | None:
    """Convert a Python, NumPy or JAX scalar to a Python number; None otherwise, also if traced."""
    if isinstance(value, np.ndarray | np.generic | jax.Array):
        foreign = isinstance(value, Tracer | np.ma.MaskedArray) or value.ndim > 0
        value = None if foreign or not _is_real(value.dtype) else value.item()
    return value if isinstance(value, int | float) and not isinstance(value, bool) else None


def require_number(name: str, value: Any, allowed: Range = REAL, otherwise: str = "") -> float:
    """Convert a scalar in `allowed` to a float; ValueError, with what else may be, for others."""
    try:
        number = float(math.nan if (known := concrete(value)) is None else known)
    except OverflowError:
        number = math.nan
    if not allowed.holds(number):
        raise refusal(name, f"be a number in {allowed}{otherwise}", value)
    return number


def require_count(name: str, value: Any, least: int) -> int:
    """Convert a scalar to an integer of at least `least`; ValueError for anything else."""
    number = concrete(value)
    whole = isinstance(number, int) and number >= least
    if not isinstance(number, int) or not whole or number.bit_length() > _MOST_BITS:
        size = f" and at most {_MOST_BITS} bits" if whole else ""
        raise refusal(name, f"be a whole number of at least {least}{size}", value)
    return number


def require_broadcast(**given: Any) -> tuple[int, ...]:
    """Return the shape to which all numbers in the arguments broadcast; ValueError without one."""
    if not any(map(np.ndim, jax.tree.leaves(list(given.values())))):
        return ()
    shapes = {name: [np.shape(leaf) for leaf in jax.tree.leaves(v)] for name, v in given.items()}
    try:
        return np.broadcast_shapes(*itertools.chain(*shapes.values()))
    except ValueError as error:
        parts = {name: ", ".join(map(str, one)) for name, one in shapes.items() if any(one)}
        raise ValueError(
            f"Argument{'s' * (len(parts) > 1)} {' and '.join(f'`{name}`' for name in parts)} must "
            "have shapes that broadcast, but have "
            f"{'; '.join(f'{shown} in `{name}`' for name, shown in parts.items())}."
        ) from error
