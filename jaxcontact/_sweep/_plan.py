"""A function prepared for a sweep: traced, analysed and compiled."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ._axes import Grid, call
from ._fields import Field, fields_of
from ._skip import Array, Dependence, Program, Work, analysis_of, is_flag, program_of, run

Kinds = tuple[tuple[str, int | None, np.dtype], ...]

_REMEMBERED = 32


@dataclass(frozen=True, eq=False)
class Group:
    """Arrays that one compiled function computes together."""

    dims: tuple[int, ...]
    """Those of all its arrays."""
    arrays: tuple[Array, ...]
    inputs: tuple[int, ...]
    """The inputs this takes."""
    grid: Callable[..., list[jax.Array]]
    """Compiled, over the outer product of one-dimensional inputs; each array over its own part."""
    lanes: Callable[..., list[jax.Array]]
    """Compiled, over aligned inputs, one lane each."""

    @property
    def flags(self) -> bool:
        """Whether these are flags, to be computed before anything else."""
        return is_flag(self.arrays[0].key)

    @property
    def apart(self) -> bool:
        """Whether no array varies along all dimensions: then there is no product to be cut."""
        return all(array.dims != self.dims for array in self.arrays)


@dataclass(frozen=True, eq=False)
class Plan:
    """All groups, those of few dimensions first, and how the arrays follow from them."""

    program: Program
    fields: tuple[Field, ...]
    leaves: tuple[Dependence, ...]
    groups: tuple[Group, ...]
    checks: tuple[int, ...]
    """The flags that say whether the input of a lane is valid."""
    whole: Group
    """All leaves and checks over all dimensions, with nothing skipped."""


def plan_of(function: Callable[..., Any], grid: Grid) -> Plan:
    """The plan of a function over a grid; remembered, with all that has been compiled for it."""
    # The precision decides the types inside the function, even if the axes do not change.
    key = (function, grid.kinds, grid.static, len(grid.dims), jnp.zeros(()).dtype)
    try:
        hash(key)
    except TypeError:
        # A function, or an argument passed on, without a hash: a module with arrays, for example.
        return _plan.__wrapped__(*key)
    return _plan(*key)


@functools.lru_cache(_REMEMBERED)
def _plan(
    function: Callable[..., Any],
    kinds: Kinds,
    static: tuple[tuple[str, Any], ...],
    rank: int,
    precision: np.dtype,
) -> Plan:
    names = [name for name, _, _ in kinds]
    fields: list[Field] = []

    def flat(*values: jax.Array) -> list[jax.Array]:
        given = dict(zip(names, values, strict=True)) | dict(static)
        found, arrays = fields_of(call(function, given))
        fields[:] = found
        return [jnp.asarray(array) for array in arrays]

    program = program_of(flat, [jax.ShapeDtypeStruct((), dtype) for _, _, dtype in kinds])
    along = [dim for _, dim, _ in kinds]
    found = analysis_of(program, along, rank)
    whole = _compiled(found.whole, along)
    groups = tuple(whole if work is found.whole else _compiled(work, along) for work in found.works)
    return Plan(program, tuple(fields), found.leaves, groups, found.checks, whole)


def _compiled(work: Work, along: list[int | None]) -> Group:
    """The group of `work`; `along` holds the dimension of each input."""

    def one(*values: jax.Array) -> list[jax.Array]:
        return run(work.steps, work.outputs, dict(zip(work.inputs, values, strict=True)))

    mine = [along[slot] for slot in work.inputs]
    grid, lanes = one, one
    for d in reversed(work.dims):
        grid = jax.vmap(
            grid,
            in_axes=tuple(0 if other == d else None for other in mine),
            out_axes=[0 if d in array.dims else None for array in work.arrays],
        )
    if work.dims:
        lanes = jax.vmap(lanes, in_axes=tuple(None if d is None else 0 for d in mine))
    return Group(work.dims, work.arrays, work.inputs, jax.jit(grid), jax.jit(lanes))
