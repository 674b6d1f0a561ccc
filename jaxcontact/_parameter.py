"""Numbers on entry: conversion, ranges and error messages."""

from __future__ import annotations

import dataclasses
import difflib
import functools
import inspect
import math
import os
import pathlib
import re
from collections.abc import Callable, Iterable
from typing import Any, ParamSpec, TypeGuard, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Bool

Kind = TypeVar("Kind")
Given = ParamSpec("Given")
Returned = TypeVar("Returned")

_LONG, _BEGINNING = 300, 100
"""Characters: longer values are shown by their beginning, type and shape."""

_MOST_BITS = 63

_NOT_MODELLED = {
    r"frict|^mu(_|$)|tangen|rolling": "there is no friction (yet), forces act along the normal",
    r"spin|rotat|angular|omega|orient|torque|inertia": "bodies do not rotate (yet)",
    r"drag|^air|wind|magnus|viscosity|fluid": "flights are in vacuum here (`calibrate` and "
    "`fit_bounces` have `drag`)",
    r"adhes|cohes|surface_energy|sticki": "bodies do not stick together (yet)",
    r"^e$|restitution|damping": "it belongs to a law, such as `ExactRestitution(e=0.8)`",
}
"""The reason why an argument of such a name does not exist."""


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


def as_parameter(value: ArrayLike, name: str, allowed: Range = REAL) -> Array:
    """Convert a number or an array to a floating-point JAX array.

    A Python or numpy scalar outside `allowed` raises ValueError, because no batch could hold a
    flag. Arrays and traced values pass; `impact` flags their bad lanes.
    """
    if type(value) is float and allowed.holds(value):
        return _weakly_typed(value)
    array = value if isinstance(value, jax.Array) else _from_python(value, name, allowed)
    if not _is_real(array.dtype):
        raise _not_a_number(value, name)
    return array if jnp.issubdtype(array.dtype, jnp.floating) else array.astype(float)


# A Python number stays weakly typed and takes the precision of the arrays it is combined with. The
# compiled identity creates an array in a third of the time of `jnp.asarray`.
_weakly_typed = jax.jit(lambda number: number, inline=True)


def as_number(value: ArrayLike, name: str, allowed: Range = REAL) -> float | Array:
    """Convert as `as_parameter` does, but keep a Python float for compiled code to convert."""
    if type(value) is float and allowed.holds(value):
        return value
    return as_parameter(value, name, allowed)


def _from_python(value: Any, name: str, allowed: Range) -> Array:
    plain = real_array(value, name)
    scalar = plain.ndim == 0 and not isinstance(value, np.ndarray)
    if scalar and not allowed.holds(float(plain)):
        raise ValueError(f"Argument `{name}` must be in {allowed}, but is {rendered(value)}.")
    if isinstance(value, int | float):
        return _weakly_typed(float(value))
    # Without double precision JAX would wrap large integers around.
    whole = jnp.issubdtype(plain.dtype, jnp.integer)
    # Unlike `asarray` this compiles nothing, for any shape.
    return jax.device_put(plain.astype(float) if whole else plain)


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
    return ValueError(
        f"Argument `{name}` must be a real number or an array of real numbers, of at most 64 bits, "
        f"but is {rendered(value)}."
    )


def is_plain(value: Any) -> TypeGuard[int | float | np.integer | np.floating]:
    """Return whether a number is a Python or NumPy scalar, which may specialise compiled code."""
    return isinstance(value, int | float | np.integer | np.floating)


def concrete(value: Any) -> int | float | None:
    """Convert a Python, NumPy or JAX scalar to a Python number; None otherwise, also if traced."""
    if isinstance(value, np.ndarray | np.generic | jax.Array):
        foreign = isinstance(value, Tracer | np.ma.MaskedArray) or value.ndim > 0
        value = None if foreign or not _is_real(value.dtype) else value.item()
    return value if isinstance(value, int | float) and not isinstance(value, bool) else None


def require_number(name: str, value: Any, allowed: Range = REAL) -> float:
    """Convert a scalar in `allowed` to a float; ValueError for anything else."""
    try:
        number = float(math.nan if (known := concrete(value)) is None else known)
    except OverflowError:
        number = math.nan
    if not allowed.holds(number):
        raise ValueError(
            f"Argument `{name}` must be a number in {allowed}, but is {rendered(value)}."
        )
    return number


def require_count(name: str, value: Any, least: int) -> int:
    """Convert a scalar to an integer of at least `least`; ValueError for anything else."""
    number = concrete(value)
    whole = isinstance(number, int) and number >= least
    if not isinstance(number, int) or not whole or number.bit_length() > _MOST_BITS:
        size = f" and at most {_MOST_BITS} bits" if whole else ""
        raise ValueError(
            f"Argument `{name}` must be a whole number of at least {least}{size}, "
            f"but is {rendered(value)}."
        )
    return number


def as_flag(value: Any) -> bool | None:
    """Convert a Python, NumPy or JAX flag to True or False; None for anything else."""
    if isinstance(value, np.ndarray | np.generic | jax.Array):
        plain = not isinstance(value, Tracer | np.ma.MaskedArray) and value.ndim == 0
        value = value.item() if plain and value.dtype == bool else None
    return value if isinstance(value, bool) else None


def require_flag(name: str, value: Any) -> bool:
    """Convert a flag to True or False; ValueError for anything else."""
    flag = as_flag(value)
    if flag is None:
        raise ValueError(f"Argument `{name}` must be True or False, but is {rendered(value)}.")
    return flag


def require_choice(name: str, value: Any, choices: Iterable[str]) -> str:
    """Return `value` if it is one of a few names; otherwise ValueError lists them."""
    known = tuple(choices)
    if not isinstance(value, str) or value not in known:
        raise ValueError(
            f"Argument `{name}` must be one of {', '.join(map(repr, known))}, "
            f"but is {rendered(value)}.{did_you_mean(value, known)}"
        )
    return value


def nearest(given: Any, known: Iterable[str]) -> str | None:
    """Return the known name that is most similar to a misspelt one; None without a close match."""
    if not isinstance(given, str):
        return None
    folded = {name.casefold(): name for name in known}
    found = difflib.get_close_matches(given.casefold(), folded, n=1)
    return folded[found[0]] if found else None


def did_you_mean(given: Any, known: Iterable[str]) -> str:
    """Return a suggestion for the end of a message, with a leading blank; "" without a match."""
    near = nearest(given, known)
    return f" Did you mean {near!r}?" if near else ""


def not_modelled(name: str) -> str | None:
    """Return the reason why an argument of this name does not exist; None for other names."""
    found = (why for pattern, why in _NOT_MODELLED.items() if re.search(pattern, name.casefold()))
    return next(found, None)


def refuses_unknown(function: Callable[Given, Returned]) -> Callable[Given, Returned]:
    """Make a function explain in a TypeError why it lacks an argument; its signature stays.

    Python raises TypeError for an unknown argument too.
    """
    known = [name for name in inspect.signature(function).parameters if name != "self"]
    owner = function.__qualname__.removesuffix(".__init__")

    @functools.wraps(function)
    def called(*args: Given.args, **given: Given.kwargs) -> Returned:
        for name in given:
            if name not in known:
                why = not_modelled(name)
                hint = f": {why}." if why else f".{did_you_mean(name, known)}"
                raise TypeError(f"`{owner}` has no argument `{name}`{hint}")
        return function(*args, **given)

    return called


def require_kind(name: str, value: Any, kind: type[Kind], allowed: str) -> Kind:
    """Return `value` if it is an instance of `kind`; ValueError names `allowed` otherwise."""
    if not isinstance(value, kind):
        raise ValueError(f"Argument `{name}` must be {allowed}, but is {rendered(value)}.")
    return value


def require_function(name: str, value: Any) -> Callable[..., Any]:
    """Return `value` if it is callable; ValueError for anything else."""
    if not callable(value):
        raise ValueError(f"Argument `{name}` must be a function, but is {rendered(value)}.")
    return value


def require_path(name: str, value: Any) -> pathlib.Path:
    """Return the path of a file; ValueError for anything but text or an `os.PathLike`."""
    text = os.fspath(value) if isinstance(value, str | os.PathLike) else None
    if not isinstance(text, str) or not text or "\0" in text:
        raise ValueError(f"Argument `{name}` must be the path of a file, but is {rendered(value)}.")
    return pathlib.Path(text)


def require_broadcast(**given: Any) -> tuple[int, ...]:
    """Return the shape to which all numbers in the arguments broadcast; ValueError without one."""
    if all(np.ndim(leaf) == 0 for leaf in jax.tree.leaves(list(given.values()))):
        return ()
    shapes = {name: [np.shape(leaf) for leaf in jax.tree.leaves(v)] for name, v in given.items()}
    try:
        return np.broadcast_shapes(*(shape for one in shapes.values() for shape in one))
    except ValueError as error:
        parts = {name: ", ".join(map(str, one)) for name, one in shapes.items() if any(one)}
        raise ValueError(
            f"Argument{'s' * (len(parts) > 1)} {' and '.join(f'`{name}`' for name in parts)} must "
            "have shapes that broadcast, but have "
            f"{'; '.join(f'{shown} in `{name}`' for name, shown in parts.items())}."
        ) from error


def rendered(value: Any) -> str:
    """Return a value as a message shows it; long ones are cut after their beginning."""
    kind = type(value).__name__
    try:
        text = repr(value)
    except Exception:  # a foreign repr may raise anything, as that of 10**4300 does
        return f"an object of type `{kind}`"
    if len(text) <= _LONG:
        return text
    shape = getattr(value, "shape", None)
    more = f" and shape {shape}" if isinstance(shape, tuple) else ""
    return f"{text[:_BEGINNING]}... (of type `{kind}`{more})"


class Specialised(eqx.Module):
    """A number that is either static, which specialises the compiled code, or a leaf."""

    static: float | None = eqx.field(static=True)
    traced: Array | None = None

    @property
    def value(self) -> float | Array:
        """The number: a float if static, an array otherwise."""
        if self.static is not None:
            return self.static
        assert self.traced is not None
        return self.traced


@functools.lru_cache(maxsize=64)
def specialised(number: float) -> Specialised:
    """Return a static number from a cache, which is faster than creating it again."""
    return Specialised(number)


def parameter(name: str, allowed: Range = REAL, unit: str | None = None) -> Any:
    """Declare a field of an equinox module for a differentiable number with a known range.

    Without a `unit` the name's unit in `_text.units` applies.
    """
    return eqx.field(
        converter=functools.partial(as_parameter, name=name, allowed=allowed),
        metadata={"allowed": allowed, "unit": unit},
    )


def ranges(module: eqx.Module | type[eqx.Module]) -> dict[str, Range]:
    """Return the range of every field of `module` that was declared with `parameter`."""
    return {
        field.name: field.metadata["allowed"]
        for field in dataclasses.fields(module)
        if "allowed" in field.metadata
    }


def is_valid(module: eqx.Module) -> Bool[Array, "..."]:
    """Return whether all declared parameters of `module` lie in their ranges, lane by lane."""
    valid = jnp.asarray(True)
    for value, allowed in _given(module).values():
        valid = valid & allowed.holds(value)
    return valid


def sanitised(module: Any) -> Any:
    """Return `module` with every out-of-range number replaced by one in the range.

    The bad lanes are flagged elsewhere. The replacement keeps their infinities out of the
    arithmetic, so a derivative of the good lanes never contains 0 times inf.
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
    """Return the declared parameters that are not None, with their ranges."""
    found = {name: (getattr(module, name), allowed) for name, allowed in ranges(module).items()}
    return {name: pair for name, pair in found.items() if pair[0] is not None}


def shown(value: Any) -> str:
    """Return a number in readable form; arrays shortened, traced values by their type."""
    if not eqx.is_array(value) or isinstance(value, Tracer):
        return eqx.tree_pformat(value)
    if value.ndim == 0:
        return f"{value.item():.9g}"
    return np.array2string(np.asarray(value), precision=6, separator=", ", threshold=6)
