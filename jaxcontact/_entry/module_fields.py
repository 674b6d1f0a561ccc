"""Differentiable numbers with a range, as fields of a module."""

from __future__ import annotations

import dataclasses
import functools
import inspect
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from .numbers import REAL, Range, as_leaf, as_parameter


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


class _OfNumbers(type(eqx.Module)):
    """Builds modules of this package from Python numbers in a third of Equinox's time.

    The structure of a module follows from its class and its options. The first one with an option
    is built and checked as usual. Later ones differ from it only in their numbers.
    """

    def __call__(cls, *args: Any, **given: Any) -> Any:
        # Classes of users may check or convert numbers in other ways.
        if cls.__module__.startswith(_PACKAGE):
            names, allowed = _signature(cls)
            options = dict(zip(names, args, strict=False)) | given
            numbers = {name: options.pop(name) for name in allowed if name in options}
            complete = len(numbers) + len(options) == len(args) + len(given)
            if complete and all(
                type(number) is float and allowed[name].holds(number)
                for name, number in numbers.items()
            ):
                kinds = [(name, type(value), value) for name, value in options.items()]
                if all(kind in (bool, int, float) for _, kind, _ in kinds):
                    key = cls, *numbers, *kinds
                    if key not in _structures:
                        module = super().__call__(*args, **given)
                        if len(_structures) < _MOST_STRUCTURES:
                            _structures[key] = jax.tree.structure(module)
                        return module
                    return _structures[key].unflatten(map(as_leaf, numbers.values()))
        return super().__call__(*args, **given)


_PACKAGE = __name__.partition(".")[0] + "."
_structures: dict[tuple[Any, ...], Any] = {}
_MOST_STRUCTURES = 256


@functools.cache
def _signature(cls: Any) -> tuple[list[str], dict[str, Range]]:
    """Return the names of positional arguments, and of numbers with their ranges."""
    parameters = inspect.signature(cls).parameters.values()
    return [p.name for p in parameters if p.kind is not p.KEYWORD_ONLY], ranges(cls)


if TYPE_CHECKING:
    OfNumbers = eqx.Module
else:

    class OfNumbers(eqx.Module, metaclass=_OfNumbers):
        """A module whose numbers are fields declared with `parameter`."""


def parameter(name: str, allowed: Range = REAL, unit: str | None = None) -> Any:
    """Declare a field of an equinox module for a differentiable number with a known range.

    Without a `unit` the name's unit in `_text.units` applies.
    """
    return eqx.field(
        converter=functools.partial(as_parameter, name=name, allowed=allowed),
        metadata={"allowed": allowed, "unit": unit},
    )


def optional_parameter(allowed: Range, unit: str | None = None) -> Any:
    """Declare a field as `parameter` does, which may be None and is converted on entry."""
    return eqx.field(default=None, metadata={"allowed": allowed, "unit": unit})


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
