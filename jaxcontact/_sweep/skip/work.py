"""The arrays of a program to compute over each set of dimensions, and their groups."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp

from .dependence import Dependence, Dims, ProgramFacts, dependences, range_checks
from .program import Place, Program, SharedSteps, Step, run, steps_needed

Compiled = Callable[..., list[jax.Array]]


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
    """Arrays that one compiled function computes together."""

    arrays: tuple[Array, ...]
    inputs: Mapping[int, int | None]
    """The numbers of the inputs that are read, with the dimension that each varies along."""
    steps: tuple[Step, ...]
    outputs: tuple[Place, ...]
    """One for each array."""

    @functools.cached_property
    def dims(self) -> tuple[int, ...]:
        """The dimensions of all arrays."""
        return tuple(sorted({d for array in self.arrays for d in array.dims}))

    @property
    def flags(self) -> bool:
        """True if these are flags, which are computed first."""
        return is_flag(self.arrays[0].key)

    @property
    def apart(self) -> bool:
        """True if no array varies along all dimensions, so that there is no product to divide."""
        return all(array.dims != self.dims for array in self.arrays)

    @functools.cached_property
    def grid(self) -> Compiled:
        """Compiled over the outer product of one-dimensional inputs; each array over its dims."""
        grid = self._lane
        for d in reversed(self.dims):
            grid = jax.vmap(
                grid,
                in_axes=tuple(0 if other == d else None for other in self.inputs.values()),
                out_axes=[0 if d in array.dims else None for array in self.arrays],
            )
        return jax.jit(grid)

    @functools.cached_property
    def lanes(self) -> Compiled:
        """Compiled, over aligned inputs, one lane each."""
        axes = tuple(None if d is None else 0 for d in self.inputs.values())
        return jax.jit(jax.vmap(self._lane, in_axes=axes) if self.dims else self._lane)

    def _lane(self, *values: jax.Array) -> list[jax.Array]:
        return run(self.steps, self.outputs, dict(zip(self.inputs, values, strict=True)))


@dataclass(frozen=True, eq=False)
class Analysis:
    """The computation of a sweep, derived from a program."""

    program: Program
    leaves: Mapping[str, Dependence]
    """Relation of every array of the output to the computed ones, by its name."""
    checks: tuple[int, ...]
    """The flags that are true for a lane with valid input."""
    groups: tuple[Group, ...]
    """Flags first, then arrays of few dimensions first."""
    whole: Group
    """All leaves and checks over all dimensions, without skipping."""


_FLAGS = "flags/"


def flag_key(slot: int) -> str:
    """Return the key of a flag; the key of a leaf is its name."""
    return f"{_FLAGS}{slot}"


def is_flag(key: str) -> bool:
    """Return whether a key is that of a flag."""
    return key.startswith(_FLAGS)


_Parts = list[tuple[Array, Place]]
"""Arrays, each with the slot that holds it."""


class Analyst:
    """Decides which arrays of `program` to compute over `rank` dimensions; `along` holds, for each
    input, the dimension that it varies along, or None.
    """

    def __init__(self, program: Program, along: Sequence[int | None], rank: int):
        self.program, self.along, self.all = program, along, frozenset(range(rank))
        self.reading = ProgramFacts(program, [frozenset(() if d is None else (d,)) for d in along])
        self.shared = SharedSteps(program.inputs)

    def analysis(self, names: Sequence[str]) -> Analysis:
        """Return the computation of the outputs, which have these names."""
        program = self.program
        checks = tuple(range_checks(self.reading)) if program.pure else ()
        places = dict(zip(names, program.outputs, strict=True))
        places |= {flag_key(slot): slot for slot in checks}
        group = Group(
            tuple(self._array(key, self.all, where) for key, where in places.items()),
            dict(enumerate(self.along)),
            program.steps,
            tuple(places.values()),
        )
        if not program.pure:
            # A side effect must happen for every lane, so nothing is skipped.
            leaves = dict.fromkeys(names, Dependence(self.all))
            return Analysis(program, leaves, checks, (group,), group)
        outputs = dependences(self.reading)
        leaves = dict(zip(names, outputs, strict=True))
        flags = {slot for leaf in outputs for slot in leaf.conditions} | set(checks)
        # Flags first, so that an interrupted sweep has them.
        groups = (*self._flags(sorted(flags)), *self._leaves(leaves))
        return Analysis(program, leaves, checks, groups, group)

    def _flags(self, flags: Sequence[int]) -> Iterator[Group]:
        """Group flags of one dimension together, others with those of the same dimensions."""
        together: dict[Dims, _Parts] = {}
        for slot in flags:
            dims = self.reading.dims(slot)
            parts = together.setdefault(dims if len(dims) > 1 else frozenset(), [])
            parts.append(self._part(flag_key(slot), slot, Dependence(dims)))
        return map(self._group, together.values())

    def _leaves(self, leaves: Mapping[str, Dependence]) -> Iterator[Group]:
        """Group arrays of the same dimensions; merge a smaller group into one that shares its work.

        The scaled solve that gives the duration for each pair of numbers also gives the
        restitution. Together they are compiled once and solved once.
        """
        together: dict[Dims, _Parts] = {}
        for (name, leaf), where in zip(leaves.items(), self.program.outputs, strict=True):
            together.setdefault(leaf.dims, []).append(self._part(name, where, leaf))
        for few in sorted(together, key=_size):
            for more in sorted(together, key=_size):
                mine, theirs = (self._needed(together[dims])[0] for dims in (few, more))
                # The others need at least half of its work anyway.
                if few < more and 2 * len(mine & theirs) >= len(mine):
                    together[more] += together.pop(few)
                    break
        return map(self._group, together.values())

    def _part(self, key: str, where: Place, leaf: Dependence) -> tuple[Array, Place]:
        version = self.reading.specialise(leaf.conditions, where)
        return self._array(key, leaf.dims, where), self.shared.add(*version)

    def _array(self, key: str, dims: Dims, where: Place) -> Array:
        if isinstance(where, int):
            kind = self.program.shapes[where]
        else:
            kind = jax.eval_shape(jnp.asarray, where.value)
        return Array(key, tuple(sorted(dims)), kind)

    def _needed(self, parts: _Parts) -> tuple[set[int], set[int]]:
        return steps_needed(self.shared.steps, [where for _, where in parts])

    def _group(self, parts: _Parts) -> Group:
        numbers, inputs = self._needed(parts)
        arrays, outputs = zip(*parts, strict=True)
        steps = tuple(self.shared.steps[k] for k in sorted(numbers))
        return Group(arrays, {i: self.along[i] for i in sorted(inputs)}, steps, outputs)


def _size(dims: Dims) -> tuple[int, list[int]]:
    return len(dims), sorted(dims)
