"""A function prepared for a sweep: traced, analysed and compiled."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..skip.program import Program, program_of
from ..skip.work import Analysis, Analyst
from ..table import OutputField
from .axes import SweepGrid, call
from .signature import ProgramKey, key_of

VALUE = "value"
"""Name of the only field of an output without names."""

_REMEMBERED = 32
_NUMBER = jax.Array | np.ndarray | np.generic | float | int | bool


@dataclass(frozen=True, eq=False)
class Plan(Analysis):
    """The computation of a sweep, and the fields that result from it."""

    key: ProgramKey
    fields: tuple[OutputField, ...]


@dataclass(frozen=True)
class _Request:
    """A program over axes of some kinds; equal requests have the same analysis."""

    key: ProgramKey
    names: tuple[str, ...]
    kinds: tuple[tuple[int | None, np.dtype], ...]
    rank: int
    precision: np.dtype
    program: Program = dataclasses.field(compare=False)


def plan_of(function: Callable[..., Any], grid: SweepGrid) -> Plan:
    """Trace a function over a grid; the analysis and the compiled functions of a program that was
    met before are used again.
    """
    fields: list[OutputField] = []
    names: list[str] = []

    def flat(*values: jax.Array) -> list[jax.Array]:
        numbers = {i.name: value for i, value in zip(grid.inputs, values, strict=True)}
        fields[:], arrays = fields_of(call(function, numbers | dict(grid.static)))
        names[:] = arrays
        return [jnp.asarray(array) for array in arrays.values()]

    kinds = tuple((i.dim, i.values.dtype) for i in grid.inputs)
    program = program_of(flat, [jax.ShapeDtypeStruct((), dtype) for _, dtype in kinds])
    key, precision = key_of(program), jax.dtypes.canonicalize_dtype(float)
    request = _Request(key, tuple(names), kinds, len(grid.dims), precision, program)
    analysis = _analysis(request) if key.whole else _analysis.__wrapped__(request)
    return Plan(**vars(analysis), key=key, fields=tuple(fields))


@functools.lru_cache(_REMEMBERED)
def _analysis(request: _Request) -> Analysis:
    along = [dim for dim, _ in request.kinds]
    return Analyst(request.program, along, request.rank).analysis(request.names)


def fields_of(output: Any) -> tuple[list[OutputField], dict[str, Any]]:
    """Return the fields of one lane's output, and its arrays by name.

    Fields without arrays (None, static values) are kept unchanged.
    """
    fields: list[OutputField] = []
    arrays: dict[str, Any] = {}
    for name, value in _named_fields(output):
        paths, structure = jax.tree_util.tree_flatten_with_path(value)
        leaves = {name + jax.tree_util.keystr(path): leaf for path, leaf in paths}
        if leaves and all(isinstance(leaf, _NUMBER) for leaf in leaves.values()):
            fields.append(OutputField(name, tuple(leaves), structure))
            arrays |= leaves
        else:
            fields.append(OutputField(name, constant=value))
    return fields, arrays


def _named_fields(output: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(output, Mapping):
        yield from ((str(name), value) for name, value in output.items())
    elif isinstance(output, tuple) and hasattr(output, "_asdict"):
        yield from output._asdict().items()  # pyright: ignore[reportAttributeAccessIssue]
    elif dataclasses.is_dataclass(output) and not isinstance(output, type):
        for field in dataclasses.fields(output):
            yield field.name, getattr(output, field.name)
    else:
        yield VALUE, output
