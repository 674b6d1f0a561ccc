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
    if not (jnp.issubdtype(array.dtype, jnp.floating) or jnp.issubdtype(array.dtype, jnp.integer)):
        raise _not_a_number(value, name)
    return array if jnp.issubdtype(array.dtype, jnp.floating) else array.astype(float)


def _from_python(value: Any, name: str, allowed: Range) -> Array:
    try:
        plain = np.asarray(value)
    except (TypeError, ValueError) as error:
        raise _not_a_number(value, name) from error
    if plain.dtype.kind not in "fiu":
        raise _not_a_number(value, name)
    scalar = plain.ndim == 0 and not isinstance(value, np.ndarray)
    if scalar and not allowed.holds(float(plain)):
        raise ValueError(f"Argument `{name}` must be in {allowed}, but is {value!r}.")
    # A Python number stays weakly typed: it follows the precision of the arrays it meets.
    return jnp.asarray(float(value) if isinstance(value, int | float) else plain)


def _not_a_number(value: Any, name: str) -> ValueError:
    return ValueError(
        f"Argument `{name}` must be a real number or an array of real numbers, but is {value!r}."
    )


class Specialised(eqx.Module):
    """A number that is static and specialises the compiled code, or else a leaf."""

    static: float | None = eqx.field(static=True)
    traced: Array | None

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
    for name, allowed in ranges(module).items():
        value = getattr(module, name)
        if value is not None:
            valid = valid & allowed.holds(value)
    return valid


def sanitised(module: Any) -> Any:
    """`module` with every out-of-range number replaced by one in the range.

    The bad lanes are flagged elsewhere; this keeps their infinities out of the arithmetic, so that
    a derivative of the good lanes never contains 0 times inf.
    """
    names = [name for name in ranges(module) if getattr(module, name) is not None]
    if not names:
        return module
    clean = [
        jnp.where(
            ranges(module)[name].holds(getattr(module, name)),
            getattr(module, name),
            jnp.asarray(ranges(module)[name].inside, getattr(module, name).dtype),
        )
        for name in names
    ]
    return eqx.tree_at(lambda m: [getattr(m, name) for name in names], module, clean)


def shown(value: Any) -> str:
    """A number as people write it; arrays in short, traced values by their type."""
    if not eqx.is_array(value) or isinstance(value, Tracer):
        return eqx.tree_pformat(value)
    if value.ndim == 0:
        return f"{value.item():.9g}"
    return np.array2string(np.asarray(value), precision=6, separator=", ", threshold=6)
