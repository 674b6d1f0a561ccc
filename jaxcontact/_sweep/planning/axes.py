"""The inputs of a sweep: axes that span a grid, aligned samples, and fixed numbers."""

from __future__ import annotations

import dataclasses
import inspect
import math
import numbers
import operator
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import jax
import numpy as np

from ..._entry import flag_array, real_array, refusal, require_function

SAMPLE = "sample"
"""Name of the dimension of aligned samples."""


@dataclass(frozen=True, eq=False)
class Input:
    """One named argument of the function: its numbers, and the dimension they vary along."""

    name: str
    values: np.ndarray
    """One-dimensional, or a single number if `dim` is None."""
    dim: int | None


@dataclass(frozen=True, eq=False)
class SweepGrid:
    """The named dimensions of a sweep, and the inputs along them."""

    dims: tuple[str, ...]
    shape: tuple[int, ...]
    inputs: tuple[Input, ...]
    static: tuple[tuple[str, Any], ...]
    """Arguments passed on unchanged because they are not arrays: strings, integers, objects."""

    @property
    def size(self) -> int:
        """The number of lanes."""
        return math.prod(self.shape)

    def part(self, place: Sequence[slice]) -> SweepGrid:
        """Return the grid at some indices of each dimension."""
        inputs = tuple(
            i if i.dim is None else replace(i, values=i.values[place[i.dim]]) for i in self.inputs
        )
        return replace(self, shape=tuple(s.stop - s.start for s in place), inputs=inputs)

    def take(self, dim: int, index: int) -> SweepGrid:
        """Return the grid at one index of a dimension, without that dimension."""

        def move(axis: Input) -> Input:
            if axis.dim is None or axis.dim < dim:
                return axis
            if axis.dim == dim:
                return replace(axis, values=axis.values[index], dim=None)
            return replace(axis, dim=axis.dim - 1)

        dims = self.dims[:dim] + self.dims[dim + 1 :]
        shape = self.shape[:dim] + self.shape[dim + 1 :]
        return SweepGrid(dims, shape, tuple(map(move, self.inputs)), self.static)

    def restrict_to(self, function: Callable[..., Any]) -> SweepGrid:
        """Return the grid with those arguments that `function` takes."""
        takes = _takes(function)
        inputs = tuple(i for i in self.inputs if takes is None or i.name in takes)
        static = tuple(s for s in self.static if takes is None or s[0] in takes)
        return replace(self, inputs=inputs, static=static)


def grid_of(samples: Mapping[str, Any] | None, axes: Mapping[str, Any]) -> SweepGrid:
    """Return the grid of `axes`, after the dimension of the `samples` if there are any."""
    lengths: dict[str, int] = {}
    inputs: list[Input] = []
    static: list[tuple[str, Any]] = []
    if samples is not None:
        columns = _samples(samples)
        clash = sorted(columns.keys() & axes.keys())
        if clash:
            raise ValueError(
                f"Argument `{clash[0]}` must be given once, but is in `samples` and an axis."
            )
        lengths[SAMPLE] = len(next(iter(columns.values())))
        inputs += [Input(name, values, 0) for name, values in columns.items()]
    for name, value in axes.items():
        if isinstance(value, str | bool | int | None) or _is_object(value):
            static.append((name, value))
            continue
        values = _numbers(value, name)
        if values.ndim == 0:
            inputs.append(Input(name, values, None))
            continue
        if name == SAMPLE and samples is not None:
            raise ValueError(
                f"Argument `{name}` must have another name: samples have a dimension of this name."
            )
        inputs.append(Input(name, _one_dimensional(values, name), len(lengths)))
        lengths[name] = len(values)
    return SweepGrid(tuple(lengths), tuple(lengths.values()), tuple(inputs), tuple(static))


def _is_object(value: Any) -> bool:
    """Return whether an argument is a function, a law or another object, not a number or array."""
    if isinstance(value, numbers.Number | Sequence) or hasattr(value, "__array__"):
        return False
    return callable(value) or dataclasses.is_dataclass(value) or isinstance(value, Hashable)


def _samples(samples: Mapping[str, Any]) -> dict[str, np.ndarray]:
    if not isinstance(samples, Mapping) or len(samples) == 0:
        raise refusal("samples", "be a dict of arrays of one length, with at least one", samples)
    columns = {str(name): _numbers(values, str(name)) for name, values in samples.items()}
    if any(column.ndim == 0 for column in columns.values()):
        raise refusal("samples", "be a dict of one-dimensional arrays", samples)
    columns = {name: _one_dimensional(column, name) for name, column in columns.items()}
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


def _numbers(value: Any, name: str) -> np.ndarray:
    plain = flags if (flags := flag_array(value)) is not None else real_array(value, name)
    # In JAX's precision, so that the reported axes are the swept ones.
    return plain.astype(jax.dtypes.canonicalize_dtype(plain.dtype))


def _parameters(function: Callable[..., Any]) -> list[inspect.Parameter]:
    """Return the parameters of a function; without a signature any keyword is allowed."""
    try:
        return list(inspect.signature(function).parameters.values())
    except (TypeError, ValueError):
        return [inspect.Parameter("any", inspect.Parameter.VAR_KEYWORD)]


def _takes(function: Callable[..., Any]) -> list[str] | None:
    """Return the keywords that a function takes, or None if it takes any."""
    parameters = _parameters(function)
    if any(p.kind == p.VAR_KEYWORD for p in parameters):
        return None
    return [p.name for p in parameters if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY)]


def check_call(function: Callable[..., Any], grid: SweepGrid) -> None:
    """Raise ValueError if `function` cannot be called with the inputs as keywords."""
    require_function("fn", function)
    names = [*map(operator.attrgetter("name"), grid.inputs), *dict(grid.static)]
    takes = _takes(function)
    for name in names:
        if takes is not None and name not in takes:
            raise ValueError(
                f"Argument `{name}` must be an argument of `fn` that can be given by keyword, "
                f"but those are: {', '.join(takes) or 'none'}."
            )
    for p in _parameters(function):
        optional = p.default is not p.empty or p.kind in (p.VAR_POSITIONAL, p.VAR_KEYWORD)
        if not optional and p.name not in names:
            raise ValueError(
                f"Argument `{p.name}` of `fn` must be given, as an axis, a sample or a number, "
                f"but there are only: {', '.join(names) or 'none'}."
            )


def call(function: Callable[..., Any], arguments: Mapping[str, Any]) -> Any:
    """Call `function` with named arguments."""
    try:
        bound = inspect.signature(function).bind(**arguments)
    except (TypeError, ValueError):
        return function(**arguments)
    # Positional where possible: jax.grad differentiates positional arguments only.
    return function(*bound.args, **bound.kwargs)
