"""Which arrays of a program to compute over which dimensions, and which of them together."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp

from ._dependence import Dependence, Reading, dependences, range_checks
from ._facts import Dims
from ._program import Constant, Program, Shared, Step, needed


@dataclass(frozen=True, eq=False)
class Array:
    """One array to compute: a leaf of the output, or a flag."""

    key: str
    dims: tuple[int, ...]
    """The dimensions it varies along, in ascending order."""
    kind: jax.ShapeDtypeStruct
    """One lane's shape and type."""


@dataclass(frozen=True, eq=False)
class Work:
    """Arrays that are computed together, and the steps that compute them."""

    arrays: tuple[Array, ...]
    inputs: tuple[int, ...]
    """The inputs that the steps read."""
    steps: tuple[Step, ...]
    outputs: tuple[int | Constant, ...]
    """One for each array."""

    @property
    def dims(self) -> tuple[int, ...]:
        """The dimensions of all arrays."""
        return tuple(sorted({d for array in self.arrays for d in array.dims}))


@dataclass(frozen=True, eq=False)
class Analysis:
    """What a sweep computes of a program."""

    leaves: tuple[Dependence, ...]
    """How every output follows from the arrays."""
    checks: tuple[int, ...]
    """The flags that say whether the input of a lane is valid."""
    works: tuple[Work, ...]
    """Flags first, then arrays of few dimensions first."""
    whole: Work
    """All leaves and checks over all dimensions, with nothing skipped."""


def leaf_key(leaf: int) -> str:
    """The key of an array of the output."""
    return f"leaf {leaf}"


def flag_key(slot: int) -> str:
    """The key of a flag."""
    return f"flag {slot}"


def is_flag(key: str) -> bool:
    """Whether a key is that of a flag."""
    return key.startswith("flag")


def analysis_of(program: Program, along: Sequence[int | None], rank: int) -> Analysis:
    """What to compute of `program` over `rank` dimensions.

    `along` holds, for each input, the dimension that it varies along, or None.
    """
    return _Analyst(program, along, rank).analysis()


@dataclass(frozen=True, eq=False)
class _Part:
    """An array, the numbers of its steps, and the slot that holds it."""

    array: Array
    steps: frozenset[int]
    out: int | Constant


class _Analyst:
    def __init__(self, program: Program, along: Sequence[int | None], rank: int):
        self.program, self.all = program, tuple(range(rank))
        self.reading = Reading(program, [frozenset(() if d is None else (d,)) for d in along])
        self.shared = Shared(program.inputs)

    def analysis(self) -> Analysis:
        program = self.program
        checks = tuple(range_checks(self.reading)) if program.pure else ()
        places = {leaf_key(i): where for i, where in enumerate(program.outputs)}
        places |= {flag_key(slot): slot for slot in checks}
        whole = Work(
            tuple(Array(key, self.all, self._kind(where)) for key, where in places.items()),
            tuple(range(program.inputs)),
            program.steps,
            tuple(places.values()),
        )
        if not program.pure:
            # A side effect must happen for every lane: nothing is skipped.
            leaves = [Dependence(frozenset(self.all))] * len(program.outputs)
            return Analysis(tuple(leaves), checks, (whole,), whole)
        leaves = dependences(self.reading)
        flags = {slot for leaf in leaves for slot in leaf.conditions} | set(checks)
        # Flags first, so that an interrupted sweep has them.
        works = (*self._flags(sorted(flags)), *self._leaves(leaves))
        return Analysis(tuple(leaves), checks, works, whole)

    def _flags(self, flags: Sequence[int]) -> Iterator[Work]:
        """Flags of one dimension together, others with those of the same dimensions."""
        together: dict[Dims, list[_Part]] = {}
        for slot in flags:
            dims = self.reading.dims(slot)
            part = self._part(flag_key(slot), dims, slot, ())
            together.setdefault(dims if len(dims) > 1 else frozenset(), []).append(part)
        yield from map(self._together, together.values())

    def _leaves(self, leaves: Sequence[Dependence]) -> Iterator[Work]:
        """Arrays of the same dimensions together; an array of fewer joins one that shares its work.

        The scaled solve that gives the duration for each pair of numbers also gives the
        restitution: together they are compiled once and solved once.
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

    def _together(self, parts: Sequence[_Part]) -> Work:
        steps, outside = needed(
            [self.shared.steps[k] for k in sorted(_steps_of(parts))], [p.out for p in parts]
        )
        arrays, outputs = tuple(p.array for p in parts), tuple(p.out for p in parts)
        return Work(arrays, tuple(sorted(outside)), steps, outputs)

    def _kind(self, where: int | Constant) -> jax.ShapeDtypeStruct:
        if isinstance(where, int):
            return self.program.shapes[where]
        value = jnp.asarray(where.value)
        return jax.ShapeDtypeStruct(value.shape, value.dtype)


def _steps_of(parts: Sequence[_Part]) -> frozenset[int]:
    return frozenset[int]().union(*(part.steps for part in parts))


def _alike(some: Sequence[_Part], others: Sequence[_Part]) -> bool:
    """Whether `others` need at least half of the work of `some` anyway."""
    mine = _steps_of(some)
    return 2 * len(mine & _steps_of(others)) >= len(mine)
