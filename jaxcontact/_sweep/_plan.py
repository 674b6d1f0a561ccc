"""A function read for a sweep: which of its arrays to compute over which dimensions, compiled."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ._axes import Grid, call
from ._dependence import Dependence, Dims, Reading, dependences, range_checks
from ._fields import Field, fields_of
from ._program import Constant, Program, needed, program_of, run

Kinds = tuple[tuple[str, int | None, np.dtype], ...]

_REMEMBERED = 32


@dataclass(frozen=True, eq=False)
class Group:
    """Arrays over the same dimensions, computed together."""

    dims: tuple[int, ...]
    keys: tuple[str, ...]
    """What is computed: leaves and flags."""
    kinds: tuple[jax.ShapeDtypeStruct, ...]
    """One lane's shape and type, for each key."""
    inputs: tuple[int, ...]
    """The inputs this takes."""
    grid: Callable[..., list[jax.Array]]
    """Compiled, over the outer product of one-dimensional inputs."""
    lanes: Callable[..., list[jax.Array]]
    """Compiled, over aligned inputs, one lane each."""


@dataclass(frozen=True, eq=False)
class Plan:
    """All groups, those of few dimensions first, and how the arrays follow from them."""

    program: Program
    fields: tuple[Field, ...]
    leaves: tuple[Dependence, ...]
    groups: tuple[Group, ...]
    checks: tuple[int, ...]
    """The flags that say whether the input of a lane is good."""
    whole: Group
    """All leaves and checks over all dimensions, as if nothing could be skipped."""


def leaf_key(leaf: int) -> str:
    """The key of an array of the output."""
    return f"leaf {leaf}"


def flag_key(slot: int) -> str:
    """The key of a flag."""
    return f"flag {slot}"


def is_flag(key: str) -> bool:
    """Whether a key is that of a flag."""
    return key.startswith("flag")


def plan_of(function: Callable[..., Any], grid: Grid) -> Plan:
    """The plan of a function over a grid; remembered, with all that has been compiled for it."""
    # The precision decides the types inside the function, even if the axes do not change.
    key = (function, grid.kinds, grid.static, len(grid.dims), jnp.zeros(()).dtype)
    try:
        hash(key)
    except TypeError:
        # A function without a hash, a module with arrays in it for example.
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
    return _Planner(program, kinds, rank).plan(fields)


class _Planner:
    def __init__(self, program: Program, kinds: Kinds, rank: int):
        self.program, self.kinds = program, kinds
        self.all = tuple(range(rank))
        varying = [frozenset(() if dim is None else (dim,)) for _, dim, _ in kinds]
        self.reading = Reading(program, varying)

    def plan(self, fields: Sequence[Field]) -> Plan:
        count = len(self.program.outputs)
        checks = tuple(range_checks(self.reading)) if self.program.pure else ()
        keys = [*map(leaf_key, range(count)), *map(flag_key, checks)]
        whole = self._group(self.all, (), keys, (*self.program.outputs, *checks), every=True)
        if not self.program.pure:
            # What else it does, it does for every lane: nothing is skipped.
            everything = [Dependence(frozenset(self.all))] * count
            return Plan(self.program, tuple(fields), tuple(everything), (whole,), checks, whole)
        leaves = dependences(self.reading)
        together: dict[tuple[Dims, frozenset[int]], list[tuple[str, int | Constant]]] = {}
        for slot in {slot for leaf in leaves for slot in leaf.conditions} | set(checks):
            here = together.setdefault((self.reading.dims(slot), frozenset()), [])
            here.append((flag_key(slot), slot))
        for i, leaf in enumerate(leaves):
            here = together.setdefault((leaf.dims, frozenset(leaf.conditions)), [])
            here.append((leaf_key(i), self.program.outputs[i]))
        groups = [
            self._group(
                sorted(dims), conditions, [key for key, _ in parts], [out for _, out in parts]
            )
            for (dims, conditions), parts in together.items()
        ]
        # Flags first: a sweep that is interrupted then knows them.
        groups.sort(key=lambda g: (not is_flag(min(g.keys)), len(g.dims), g.dims))
        return Plan(self.program, tuple(fields), tuple(leaves), tuple(groups), checks, whole)

    def _group(
        self,
        dims: Sequence[int],
        conditions: Sequence[int] | frozenset[int],
        keys: Sequence[str],
        outputs: Sequence[int | Constant],
        *,
        every: bool = False,
    ) -> Group:
        steps, outs = self.program.steps, list(outputs)
        inputs = tuple(range(self.program.inputs))
        if self.program.pure:
            steps, outs = self.reading.specialised(conditions, outputs)
            steps, outside = needed(steps, outs)
            # Over every dimension there must be an input, even if nothing depends on it.
            inputs = inputs if every else tuple(sorted(outside))

        def one(*values: jax.Array) -> list[jax.Array]:
            return run(steps, outs, dict(zip(inputs, values, strict=True)))

        def dim(slot: int) -> int | None:
            return self.kinds[slot][1]

        grid, lanes = one, one
        for d in reversed(dims):
            grid = _over(grid, tuple(0 if dim(slot) == d else None for slot in inputs))
        if dims:
            lanes = _over(lanes, tuple(None if dim(slot) is None else 0 for slot in inputs))
        kinds = [_kind(self.program, where) for where in outputs]
        return Group(tuple(dims), tuple(keys), tuple(kinds), inputs, jax.jit(grid), jax.jit(lanes))


def _over(function: Callable[..., Any], axes: tuple[int | None, ...]) -> Callable[..., Any]:
    return jax.vmap(function, in_axes=axes)


def _kind(program: Program, where: int | Constant) -> jax.ShapeDtypeStruct:
    if isinstance(where, Constant):
        value = jnp.asarray(where.value)
        return jax.ShapeDtypeStruct(value.shape, value.dtype)
    return program.shapes[where]
