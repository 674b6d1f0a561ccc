"""A function read for a sweep: which of its arrays to compute over which dimensions, compiled."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ._axes import Grid, call
from ._dependence import Dependence, Dims, Reading, dependences, range_checks
from ._fields import Field, fields_of
from ._program import Constant, Program, Shared, Step, needed, program_of, run

Kinds = tuple[tuple[str, int | None, np.dtype], ...]

_REMEMBERED = 32


@dataclass(frozen=True, eq=False)
class Array:
    """One array to compute: a leaf of the output, or a flag."""

    key: str
    dims: tuple[int, ...]
    """The dimensions it varies along, in ascending order."""
    kind: jax.ShapeDtypeStruct
    """One lane's shape and type."""


@dataclass(frozen=True, eq=False)
class Group:
    """Arrays that are computed together, by one compiled function."""

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


@dataclass(frozen=True, eq=False)
class _Part:
    """An array, and what it is made of."""

    array: Array
    steps: frozenset[int]
    out: int | Constant


class _Planner:
    def __init__(self, program: Program, kinds: Kinds, rank: int):
        self.program, self.kinds = program, kinds
        self.all = tuple(range(rank))
        varying = [frozenset(() if dim is None else (dim,)) for _, dim, _ in kinds]
        self.reading = Reading(program, varying)
        self.shared = Shared(program.inputs)

    def plan(self, fields: Sequence[Field]) -> Plan:
        checks = tuple(range_checks(self.reading)) if self.program.pure else ()
        outputs = self.program.outputs
        plain = [
            Array(key, self.all, self._kind(where))
            for key, where in [
                *((leaf_key(i), where) for i, where in enumerate(outputs)),
                *((flag_key(slot), slot) for slot in checks),
            ]
        ]
        inputs = tuple(range(self.program.inputs))
        whole = self._group(plain, self.program.steps, [*outputs, *checks], inputs)
        if not self.program.pure:
            # What else it does, it does for every lane: nothing is skipped.
            leaves = [Dependence(frozenset(self.all))] * len(outputs)
            groups = [whole]
        else:
            leaves = dependences(self.reading)
            flags = {slot for leaf in leaves for slot in leaf.conditions} | set(checks)
            # Flags first: a sweep that is interrupted then knows them.
            groups = [*self._flags(sorted(flags)), *self._leaves(leaves)]
        return Plan(self.program, tuple(fields), tuple(leaves), tuple(groups), checks, whole)

    def _flags(self, flags: Sequence[int]) -> Iterator[Group]:
        """Flags of one dimension together, others with those of the same dimensions."""
        together: dict[Dims, list[_Part]] = {}
        for slot in flags:
            dims = self.reading.dims(slot)
            part = self._part(flag_key(slot), dims, slot, ())
            together.setdefault(dims if len(dims) > 1 else frozenset(), []).append(part)
        yield from map(self._together, together.values())

    def _leaves(self, leaves: Sequence[Dependence]) -> Iterator[Group]:
        """Arrays of the same dimensions together, and fewer with more if they share their work.

        A scaled solve that the duration needs for each pair of numbers gives the restitution too:
        it is compiled once, and run no more often.
        """
        together: dict[Dims, list[_Part]] = {}
        for i, leaf in enumerate(leaves):
            part = self._part(leaf_key(i), leaf.dims, self.program.outputs[i], leaf.conditions)
            together.setdefault(leaf.dims, []).append(part)
        for few in sorted(together, key=lambda dims: (len(dims), sorted(dims))):
            for more in sorted(together, key=lambda dims: (len(dims), sorted(dims))):
                if few < more and _alike(together[few], together[more]):
                    together[more] += together.pop(few)
                    break
        yield from map(self._together, together.values())

    def _part(
        self, key: str, dims: Dims, where: int | Constant, conditions: Sequence[int]
    ) -> _Part:
        steps, outputs = self.reading.specialised(conditions, [where])
        (out,) = self.shared.add(steps, outputs)
        numbers = frozenset(self.shared.numbers_of(out))
        return _Part(Array(key, tuple(sorted(dims)), self._kind(where)), numbers, out)

    def _together(self, parts: Sequence[_Part]) -> Group:
        numbers = sorted(frozenset[int]().union(*(part.steps for part in parts)))
        steps, outside = needed([self.shared.steps[k] for k in numbers], [p.out for p in parts])
        inputs = tuple(sorted(outside))
        return self._group([p.array for p in parts], steps, [p.out for p in parts], inputs)

    def _group(
        self,
        arrays: Sequence[Array],
        steps: Sequence[Step],
        outs: Sequence[int | Constant],
        inputs: tuple[int, ...],
    ) -> Group:
        def one(*values: jax.Array) -> list[jax.Array]:
            return run(steps, outs, dict(zip(inputs, values, strict=True)))

        along = [self.kinds[slot][1] for slot in inputs]
        dims = tuple(sorted({d for array in arrays for d in array.dims}))
        grid, lanes = one, one
        for d in reversed(dims):
            grid = jax.vmap(
                grid,
                in_axes=tuple(0 if other == d else None for other in along),
                out_axes=[0 if d in array.dims else None for array in arrays],
            )
        if dims:
            lanes = jax.vmap(lanes, in_axes=tuple(None if d is None else 0 for d in along))
        return Group(dims, tuple(arrays), inputs, jax.jit(grid), jax.jit(lanes))

    def _kind(self, where: int | Constant) -> jax.ShapeDtypeStruct:
        if isinstance(where, int):
            return self.program.shapes[where]
        value = jnp.asarray(where.value)
        return jax.ShapeDtypeStruct(value.shape, value.dtype)


def _alike(some: Sequence[_Part], others: Sequence[_Part]) -> bool:
    """Whether at least half of the work of `some` is done for `others` anyway."""
    mine = frozenset[int]().union(*(part.steps for part in some))
    theirs = frozenset[int]().union(*(part.steps for part in others))
    return 2 * len(mine & theirs) >= len(mine)
