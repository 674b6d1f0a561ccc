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
"""Characters: what is longer is shown by its beginning, its type and its shape."""

_MOST_BITS = 63

_NOT_MODELLED = {
    r"frict|^mu(_|$)|tangen|rolling": "there is no friction (yet), forces act along the normal",
    r"spin|rotat|angular|omega|orient|torque|inertia": "bodies do not rotate (yet)",
    r"drag|^air|wind|magnus|viscosity|fluid": "flights are in vacuum here (`calibrate` and "
    "`fit_bounces` have `drag`)",
    r"adhes|cohes|surface_energy|sticki": "bodies do not stick together (yet)",
    r"^e$|restitution|damping": "it belongs to a law, such as `ExactRestitution(e=0.8)`",
}
"""Why an argument of such a name does not exist."""


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
FRACTION = Range(low=0.0, high=1.0, low_open=True, high_open=True, inside=0.5)


def as_parameter(value: ArrayLike, name: str, allowed: Range = REAL) -> Array:
    """Turn a number or an array into a floating-point JAX array.

    A Python or numpy scalar outside `allowed` raises ValueError, because no batch could hold a
    flag. Arrays and traced values pass: their bad lanes are flagged by `impact`.
    """
    if type(value) is float and allowed.holds(value):
        return _weakly_typed(value)
    array = value if isinstance(value, jax.Array) else _from_python(value, name, allowed)
    if not _is_real(array.dtype):
        raise _not_a_number(value, name)
    return array if jnp.issubdtype(array.dtype, jnp.floating) else array.astype(float)


# A Python number stays weakly typed: it follows the precision of the arrays it meets. Compiled, the
# identity makes an array in a third of the time that `jnp.asarray` takes.
_weakly_typed = jax.jit(lambda number: number, inline=True)


def as_number(value: ArrayLike, name: str, allowed: Range = REAL) -> float | Array:
    """As `as_parameter`, but a Python number stays a float, for a compiled function to convert."""
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
    # Without double precision JAX would wrap large whole numbers around.
    whole = jnp.issubdtype(plain.dtype, jnp.integer)
    # Unlike `asarray` this compiles nothing, for no shape.
    return jax.device_put(plain.astype(float) if whole else plain)


def as_numbers(value: Any, name: str) -> np.ndarray:
    """Turn real numbers into a NumPy array of double precision; ValueError for anything else."""
    return real_array(value, name).astype(float)


def real_array(value: Any, name: str) -> np.ndarray:
    """Turn real numbers into a NumPy array of their own type; ValueError for anything else."""
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
    """What NumPy makes of a value; None for what it cannot convert."""
    try:
        return np.asarray(value, dtype)
    except Exception:  # a foreign object converts itself here, by code that may raise anything
        return None


def flag_array(value: Any) -> np.ndarray | None:
    """An array of flags, which are no numbers, as a NumPy array; None for anything else."""
    plain = None if isinstance(value, np.ma.MaskedArray) else as_array(value)
    return plain if plain is not None and plain.dtype == bool and plain.ndim > 0 else None


def as_weights(value: Any) -> Any:
    """Flags, which keep a point or leave it out, as ones and zeros; other weights as they are."""
    flags = flag_array(value)
    return value if flags is None else flags.astype(float)


def _is_real(dtype: Any) -> bool:
    """Whether numbers of this type are real, and JAX can hold all their digits."""
    real = jnp.issubdtype(dtype, jnp.floating) or jnp.issubdtype(dtype, jnp.integer)
    # NumPy counts durations among the integers, and has long doubles of 16 bytes.
    return real and dtype.kind != "m" and dtype.itemsize <= 8


def _not_a_number(value: Any, name: str) -> ValueError:
    return ValueError(
        f"Argument `{name}` must be a real number or an array of real numbers, of at most 64 bits, "
        f"but is {rendered(value)}."
    )


def is_plain(value: Any) -> TypeGuard[int | float | np.integer | np.floating]:
    """Whether a number is a Python or NumPy scalar, which specialises code where that pays."""
    return isinstance(value, int | float | np.integer | np.floating)


def concrete(value: Any) -> int | float | None:
    """A Python, NumPy or JAX scalar as a Python number; None for all else, traced values too."""
    if isinstance(value, np.ndarray | np.generic | jax.Array):
        foreign = isinstance(value, Tracer | np.ma.MaskedArray) or value.ndim > 0
        value = None if foreign or not _is_real(value.dtype) else value.item()
    return value if isinstance(value, int | float) and not isinstance(value, bool) else None


def require_number(name: str, value: Any, allowed: Range = REAL) -> float:
    """The one number in `allowed` that a scalar is, as a float; ValueError for anything else."""
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
    """The whole number of at least `least` that a scalar is; ValueError for anything else."""
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
    """A Python, NumPy or JAX flag as True or False; None for anything else."""
    if isinstance(value, np.ndarray | np.generic | jax.Array):
        plain = not isinstance(value, Tracer | np.ma.MaskedArray) and value.ndim == 0
        value = value.item() if plain and value.dtype == bool else None
    return value if isinstance(value, bool) else None


def require_flag(name: str, value: Any) -> bool:
    """True or False; ValueError for anything else."""
    flag = as_flag(value)
    if flag is None:
        raise ValueError(f"Argument `{name}` must be True or False, but is {rendered(value)}.")
    return flag


def require_choice(name: str, value: Any, choices: Iterable[str]) -> str:
    """One of a few names; ValueError, which lists them, for anything else."""
    known = tuple(choices)
    if not isinstance(value, str) or value not in known:
        raise ValueError(
            f"Argument `{name}` must be one of {', '.join(map(repr, known))}, "
            f"but is {rendered(value)}.{did_you_mean(value, known)}"
        )
    return value


def nearest(given: Any, known: Iterable[str]) -> str | None:
    """The one of the known names that is most like a misspelt one; None where none is."""
    if not isinstance(given, str):
        return None
    folded = {name.casefold(): name for name in known}
    found = difflib.get_close_matches(given.casefold(), folded, n=1)
    return folded[found[0]] if found else None


def did_you_mean(given: Any, known: Iterable[str]) -> str:
    """A sentence for the end of a message, with a blank before it; nothing where it would guess."""
    near = nearest(given, known)
    return f" Did you mean {near!r}?" if near else ""


def not_modelled(name: str) -> str | None:
    """Why nothing has an argument of this name, in words; None for a name that says nothing."""
    found = (why for pattern, why in _NOT_MODELLED.items() if re.search(pattern, name.casefold()))
    return next(found, None)


def refuses_unknown(function: Callable[Given, Returned]) -> Callable[Given, Returned]:
    """Let a function say why it has no argument of some name; its signature stays.

    The function then raises TypeError, as Python does.
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
    """An object of a class, `allowed` in words; ValueError for anything else."""
    if not isinstance(value, kind):
        raise ValueError(f"Argument `{name}` must be {allowed}, but is {rendered(value)}.")
    return value


def require_function(name: str, value: Any) -> Callable[..., Any]:
    """Something that can be called; ValueError for anything else."""
    if not callable(value):
        raise ValueError(f"Argument `{name}` must be a function, but is {rendered(value)}.")
    return value


def require_path(name: str, value: Any) -> pathlib.Path:
    """The path of a file; ValueError for what is no text and no `os.PathLike`."""
    text = os.fspath(value) if isinstance(value, str | os.PathLike) else None
    if not isinstance(text, str) or not text or "\0" in text:
        raise ValueError(f"Argument `{name}` must be the path of a file, but is {rendered(value)}.")
    return pathlib.Path(text)


def require_broadcast(**given: Any) -> tuple[int, ...]:
    """The shape to which all numbers in some arguments broadcast; ValueError if there is none."""
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
    """A value as a message shows it, the beginning of what is long."""
    kind = type(value).__name__
    try:
        text = repr(value)
    except Exception:  # a foreign repr may raise anything, that of 10**4300 does
        return f"an object of type `{kind}`"
    if len(text) <= _LONG:
        return text
    shape = getattr(value, "shape", None)
    more = f" and shape {shape}" if isinstance(shape, tuple) else ""
    return f"{text[:_BEGINNING]}... (of type `{kind}`{more})"


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


@functools.lru_cache(maxsize=64)
def specialised(number: float) -> Specialised:
    """A static number; equal ones are one object, which takes less time than to build it anew."""
    return Specialised(number)


def parameter(name: str, allowed: Range = REAL, unit: str | None = None) -> Any:
    """A field of an equinox module that holds a differentiable number with a known range.

    The unit is that of `_units` for this name if none is given.
    """
    return eqx.field(
        converter=functools.partial(as_parameter, name=name, allowed=allowed),
        metadata={"allowed": allowed, "unit": unit},
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
