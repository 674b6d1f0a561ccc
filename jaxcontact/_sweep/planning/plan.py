"""A function prepared for a sweep: traced, analysed and compiled."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Hashable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..skip import Analysis, analysis_of, program_of
from ..table import OutputField
from .axes import SweepGrid, call
from .key import NoKey, key_of

VALUE = "value"
"""Name of the only field of an output without names."""

_REMEMBERED = 32
_NUMBER = jax.Array | np.ndarray | np.generic | float | int | bool


@dataclass(frozen=True, eq=False)
class Plan(Analysis):
    """The computation of a sweep, and the fields that result from it."""

    fields: tuple[OutputField, ...]


@dataclass(frozen=True)
class _Request:
    """A function over axes of some kinds; requests with equal keys have the same plan."""

    key: Hashable
    kinds: tuple[tuple[str, int | None, np.dtype], ...]
    rank: int
    function: Callable[..., Any] = dataclasses.field(compare=False)
    static: tuple[tuple[str, Any], ...] = dataclasses.field(compare=False)


def plan_of(function: Callable[..., Any], grid: SweepGrid) -> Plan:
    """Return the plan of a function over a grid, cached with all of its compiled functions."""
    try:
        # JAX's settings affect the trace too: precision, kind of random numbers.
        key = key_of(function, grid.static), *map(repr, jax.config.values.items())
    except NoKey:
        key = None
    request = _Request(key, grid.kinds, len(grid.dims), function, grid.static)
    return _plan(request) if key else _plan.__wrapped__(request)


@functools.lru_cache(_REMEMBERED)
def _plan(request: _Request) -> Plan:
    names, along, dtypes = zip(*request.kinds, strict=True) if request.kinds else ((), (), ())
    fields: list[OutputField] = []
    names_found: list[str] = []

    def flat(*values: jax.Array) -> list[jax.Array]:
        arguments = dict(zip(names, values, strict=True)) | dict(request.static)
        fields[:], arrays = fields_of(call(request.function, arguments))
        names_found[:] = arrays
        return [jnp.asarray(array) for array in arrays.values()]

    program = program_of(flat, [jax.ShapeDtypeStruct((), dtype) for dtype in dtypes])
    analysis = analysis_of(program, names_found, along, request.rank)
    return Plan(**vars(analysis), fields=tuple(fields))


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
