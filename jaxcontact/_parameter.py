"""Numbers on entry: conversion, ranges and error messages."""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Bool


@dataclasses.dataclass(frozen=True)
class Range:
    """The interval a parameter must lie in; `inside` is some number in it."""

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
        """Whether x lies inside; NaN and the infinities never do. Works on floats and arrays."""
        above = (x > self.low) if self.low_open else (x >= self.low)
        below = (x < self.high) if self.high_open else (x <= self.high)
        return above & below & (abs(x) < math.inf)


POSITIVE = Range(low=0.0, low_open=True, inside=1.0)
NOT_NEGATIVE = Range(low=0.0, inside=0.0)
REAL = Range(inside=0.0)
RESTITUTION = Range(low=0.0, high=1.0, low_open=True, inside=0.5)
RESTITUTION_FROM_ZERO = Range(low=0.0, high=1.0, inside=0.5)


def as_parameter(value: ArrayLike, name: str, allowed: Range = REAL) -> Array:
    """Turn a number or an array into a floating-point JAX array.

    A Python or numpy scalar outside `allowed` raises ValueError, because no batch could hold a
    flag. Arrays and traced values pass: their bad lanes are flagged by `impact`.
    """
    array = value if isinstance(value, jax.Array) else _from_python(value, name, allowed)
    if jnp.issubdtype(array.dtype, jnp.floating):
        return array
    if not jnp.issubdtype(array.dtype, jnp.integer):
        raise _not_a_number(value, name)
    return array.astype(float)


def _from_python(value: Any, name: str, allowed: Range) -> Array:
    if isinstance(value, np.ma.MaskedArray):
        raise ValueError(
            f"Argument `{name}` must be an array without a mask (`filled(nan)` makes one, whose "
            f"masked lanes are flagged), but is {value!r}."
        )
    try:
        plain = np.asarray(value)
    except (TypeError, ValueError) as error:
        raise _not_a_number(value, name) from error
    # A long double would lose digits in silence: JAX has nothing wider than 8 bytes.
    if plain.dtype.kind not in "fiu" or plain.dtype.itemsize > 8:
        raise _not_a_number(value, name)
    scalar = plain.ndim == 0 and not isinstance(value, np.ndarray)
    if scalar and not allowed.holds(float(plain)):
        raise ValueError(f"Argument `{name}` must be in {allowed}, but is {value!r}.")
    # A Python number stays weakly typed: it follows the precision of the arrays it meets.
    return jnp.asarray(float(value) if isinstance(value, int | float) else plain)


def require_count(name: str, value: Any, least: int) -> None:
    """Raise ValueError for what is no whole number of at least `least`."""
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise ValueError(
            f"Argument `{name}` must be a whole number of at least {least}, but is {value!r}."
        )


def _not_a_number(value: Any, name: str) -> ValueError:
    return ValueError(
        f"Argument `{name}` must be a real number or an array of real numbers, of at most 64 bits, "
        f"but is {value!r}."
    )


class Specialised(eqx.Module):
    """A number that is static and specialises the compiled code, or else a leaf."""

    static: float | None = eqx.field(static=True)
    traced: Array | None = None

    @property
    def value(self) -> float | Array:
        """The number: a float where it is static, an array otherwise."""
        if self.static is not None:
            return self.static
        assert self.traced is not None
        return self.traced


def parameter(name: str, allowed: Range = REAL) -> Any:
    """A field of an equinox module that holds a differentiable number with a known range."""
    return eqx.field(
        converter=functools.partial(as_parameter, name=name, allowed=allowed),
        metadata={"allowed": allowed},
    )


def ranges(module: eqx.Module | type[eqx.Module]) -> dict[str, Range]:
    """The range of every field of `module` that was declared with `parameter`."""
    return {
        field.name: field.metadata["allowed"]
        for field in dataclasses.fields(module)
        if "allowed" in field.metadata
    }


def is_valid(module: eqx.Module) -> Bool[Array, "..."]:
    """Whether all declared parameters of `module` lie in their ranges, lane by lane."""
    valid = jnp.asarray(True)
    for value, allowed in _given(module).values():
        valid = valid & allowed.holds(value)
    return valid


def sanitised(module: Any) -> Any:
    """`module` with every out-of-range number replaced by one in the range.

    The bad lanes are flagged elsewhere; this keeps their infinities out of the arithmetic, so that
    a derivative of the good lanes never contains 0 times inf.
    """
    given = _given(module)
    if not given:
        return module
    clean = [
        jnp.where(allowed.holds(value), value, jnp.asarray(allowed.inside, value.dtype))
        for value, allowed in given.values()
    ]
    return eqx.tree_at(lambda m: [getattr(m, name) for name in given], module, clean)


def _given(module: eqx.Module) -> dict[str, tuple[Array, Range]]:
    """The declared parameters that are not None, with their ranges."""
    found = {name: (getattr(module, name), allowed) for name, allowed in ranges(module).items()}
    return {name: pair for name, pair in found.items() if pair[0] is not None}


def shown(value: Any) -> str:
    """A number as people write it; arrays in short, traced values by their type."""
    if not eqx.is_array(value) or isinstance(value, Tracer):
        return eqx.tree_pformat(value)
    if value.ndim == 0:
        return f"{value.item():.9g}"
    return np.array2string(np.asarray(value), precision=6, separator=", ", threshold=6)
