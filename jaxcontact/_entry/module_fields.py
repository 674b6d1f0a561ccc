"""Differentiable numbers with a range, as fields of a module."""

from __future__ import annotations

import dataclasses
import functools
import inspect
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Bool

from .numbers import REAL, Range, as_leaf, as_number, as_parameter, is_plain


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


def specialised(value: ArrayLike, name: str, allowed: Range) -> Specialised:
    """Return a number in `allowed`: static if it is plain, otherwise a leaf."""
    if is_plain(value):
        as_number(value, name, allowed)
        return Specialised(float(value))
    return Specialised(None, as_parameter(value, name, allowed))


class _ExampleMeta(type(eqx.Module)):
    """Builds modules of this package from Python numbers in a third of Equinox's time: all with the
    same options have the structure of an example. Classes of users may treat numbers otherwise.
    """

    def __call__(cls: Any, *args: Any, **given: Any) -> Any:
        if cls.__module__.startswith("jaxcontact."):
            numbers, options = [], [*args, *given.values()]
            for place, allowed in _places(cls, len(args), *given):
                number, options[place] = options[place], allowed.inside
                numbers.append(number if type(number) is float and allowed.holds(number) else None)
            if None not in numbers and {bool, int, float}.issuperset(map(type, options)):
                return _structure(cls, tuple(given), *options).unflatten(map(as_leaf, numbers))
        return super().__call__(*args, **given)


@functools.lru_cache(maxsize=256)
def _places(cls: Any, count: int, *names: str) -> list[tuple[int, Range]]:
    """Return the places of the numbers among the arguments, in the order of the leaves."""
    order = [*list(inspect.signature(cls).parameters)[:count], *names]
    return [(order.index(name), one) for name, one in ranges(cls).items() if name in order]


@functools.lru_cache(maxsize=256, typed=True)
def _structure(cls: Any, names: tuple[str, ...], *values: Any) -> Any:
    count = len(values) - len(names)
    named = zip(names, values[count:], strict=True)
    return jax.tree.structure(type(eqx.Module).__call__(cls, *values[:count], **dict(named)))


if TYPE_CHECKING:
    OfNumbers = eqx.Module
else:

    class OfNumbers(eqx.Module, metaclass=_ExampleMeta):
        """A module whose numbers are fields declared with `parameter`."""


def parameter(name: str, allowed: Range = REAL, unit: str | None = None) -> Any:
    """Declare a field of an equinox module for a differentiable number with a known range.

    Without a `unit` the name's unit in `_text.units` applies.
    """
    return eqx.field(
        converter=functools.partial(as_parameter, name=name, allowed=allowed),
        metadata={"allowed": allowed, "unit": unit},
    )


def optional_parameter(name: str, allowed: Range, unit: str | None = None) -> Any:
    """Declare a field as `parameter` does, which may be None."""

    def convert(value: ArrayLike | None) -> Array | None:
        return None if value is None else as_parameter(value, name, allowed)

    return eqx.field(default=None, converter=convert, metadata={"allowed": allowed, "unit": unit})


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
