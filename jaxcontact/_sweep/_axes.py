"""What a sweep runs over: axes that span a grid, aligned samples, and numbers held fixed."""

from __future__ import annotations

import dataclasses
import inspect
import math
import numbers
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

SAMPLE = "sample"
"""The name of the dimension that aligned samples share."""


@dataclass(frozen=True, eq=False)
class Input:
    """One named argument of the function: its numbers, and the dimension they vary along."""

    name: str
    values: np.ndarray
    """One-dimensional; a single number where `dim` is None."""
    dim: int | None


@dataclass(frozen=True, eq=False)
class Grid:
    """The named dimensions of a sweep, and the inputs along them."""

    dims: tuple[str, ...]
    shape: tuple[int, ...]
    inputs: tuple[Input, ...]
    static: tuple[tuple[str, Any], ...]
    """Arguments that are no arrays, passed on as they are: strings, whole numbers, objects."""

    @property
    def size(self) -> int:
        """The number of lanes."""
        return math.prod(self.shape)

    @property
    def kinds(self) -> tuple[tuple[str, int | None, np.dtype], ...]:
        """All that a compiled function needs to know of the inputs."""
        return tuple((i.name, i.dim, i.values.dtype) for i in self.inputs)


def grid_of(samples: Mapping[str, Any] | None, axes: Mapping[str, Any]) -> Grid:
    """The grid of `axes`, after the dimension of the `samples` if there are any."""
    dims: list[str] = []
    shape: list[int] = []
    inputs: list[Input] = []
    static: list[tuple[str, Any]] = []
    if samples is not None:
        columns = _samples(samples)
        clash = sorted(columns.keys() & axes.keys())
        if clash:
            raise ValueError(
                f"Argument `{clash[0]}` must be given once, but is in `samples` and an axis."
            )
        dims.append(SAMPLE)
        shape.append(len(next(iter(columns.values()))))
        inputs += [Input(name, values, 0) for name, values in columns.items()]
    for name, given in axes.items():
        if given is None or isinstance(given, str | bool | int) or _is_object(given):
            static.append((name, given))
            continue
        values = _numbers(given, name)
        if values.ndim == 0:
            inputs.append(Input(name, values, None))
            continue
        if name == SAMPLE and samples is not None:
            raise ValueError(
                f"Argument `{name}` must have another name: samples have a dimension of this name."
            )
        inputs.append(Input(name, _one_dimensional(values, name), len(dims)))
        dims.append(name)
        shape.append(len(values))
    return Grid(tuple(dims), tuple(shape), tuple(inputs), tuple(static))


def _is_object(given: Any) -> bool:
    """Whether this is no number and no array: a function, a law, a method object, any hashable."""
    if isinstance(given, numbers.Number | Sequence) or hasattr(given, "__array__"):
        return False
    return callable(given) or dataclasses.is_dataclass(given) or isinstance(given, Hashable)


def _samples(samples: Mapping[str, Any]) -> dict[str, np.ndarray]:
    if not isinstance(samples, Mapping) or not samples:
        raise ValueError(
            "Argument `samples` must map names to arrays of one length, "
            f"but is {type(samples).__name__ if samples else 'empty'}."
        )
    columns = {
        str(name): _one_dimensional(_numbers(values, str(name)), str(name))
        for name, values in samples.items()
    }
    lengths = {name: len(values) for name, values in columns.items()}
    if len(set(lengths.values())) > 1:
        shown = ", ".join(f"{name}: {length}" for name, length in lengths.items())
        raise ValueError(f"Argument `samples` must hold arrays of one length, but has {shown}.")
    return columns


def _one_dimensional(values: np.ndarray, name: str) -> np.ndarray:
    if values.ndim != 1 or values.size == 0:
        raise ValueError(
            f"Argument `{name}` must be a number or a one-dimensional array that is not empty, "
            f"but has the shape {values.shape}."
        )
    return values


def _numbers(given: Any, name: str) -> np.ndarray:
    try:
        plain = np.asarray(given)
    except (TypeError, ValueError):
        plain = np.asarray(None)
    if plain.dtype.kind not in "fiub":
        raise ValueError(
            f"Argument `{name}` must be a number or an array of real numbers, but is {given!r}."
        )
    # In the precision JAX will use, so that the axes one reads are the ones that were swept.
    return plain.astype(jax.dtypes.canonicalize_dtype(plain.dtype))


def check_call(function: Callable[..., Any], grid: Grid) -> None:
    """Raise ValueError if `function` cannot be called with the inputs as keywords."""
    if not callable(function):
        raise ValueError(f"Argument `fn` must be a function, but is {function!r}.")
    try:
        parameters = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):
        return
    given = [i.name for i in grid.inputs] + [name for name, _ in grid.static]
    takes = [p.name for p in parameters if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY)]
    if not any(p.kind == p.VAR_KEYWORD for p in parameters):
        for name in given:
            if name not in takes:
                raise ValueError(
                    f"Argument `{name}` must be an argument of `fn` that can be given by keyword, "
                    f"but those are: {', '.join(takes) or 'none'}."
                )
    needed = [
        p.name
        for p in parameters
        if p.default is p.empty and p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD)
    ]
    missing = [name for name in needed if name not in given]
    if missing:
        raise ValueError(
            f"Argument `{missing[0]}` of `fn` must be given, as an axis, a sample or a number, "
            f"but there are only: {', '.join(given) or 'none'}."
        )


def call(function: Callable[..., Any], given: Mapping[str, Any]) -> Any:
    """`function` of named arguments."""
    try:
        bound = inspect.signature(function).bind(**given)
    except (TypeError, ValueError):
        return function(**given)
    # Positional where possible: jax.grad differentiates positional arguments only.
    return function(*bound.args, **bound.kwargs)
