"""The loop of a sweep: groups of arrays, block by block."""

from __future__ import annotations

import functools
import itertools
import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

from .._progress import Tell
from ._axes import Grid
from ._blocks import cut, padded
from ._devices import Workers
from ._plan import Group
from ._skip import Array, is_flag

Arrays = dict[str, np.ndarray]
Order = Callable[[Group], np.ndarray]
"""The lanes of a group, counted in C order, in the order in which to compute them."""


@dataclass(frozen=True, eq=False)
class Part:
    """One array that a block computes."""

    number: int
    """Its number among the results of the call."""
    array: Array
    useful: tuple[slice, ...]
    """The part without padding."""
    place: tuple[Any, ...]
    """Where in the whole array it belongs: slices, or indices lane by lane."""

    @property
    def form(self) -> jax.ShapeDtypeStruct:
        """Shape and type of the part without padding."""
        lanes = tuple(s.stop for s in self.useful)
        return jax.ShapeDtypeStruct(lanes + self.array.kind.shape, self.array.kind.dtype)


@dataclass(frozen=True, eq=False)
class Block:
    """One call of a compiled function, and the parts of its results that are kept."""

    number: int
    call: Callable[..., Sequence[jax.Array]]
    arguments: Callable[[], list[np.ndarray]]
    parts: tuple[Part, ...]
    place: tuple[slice, ...] = ()
    """The part of the dimensions of its group, if it is a part of a grid."""

    @property
    def lanes(self) -> int:
        """The number of lanes without padding."""
        return max(math.prod(s.stop for s in part.useful) for part in self.parts)

    def results(self, outputs: Sequence[jax.Array]) -> Arrays:
        """What the call returned, by key, without padding."""
        return {
            part.array.key: np.asarray(outputs[part.number])[part.useful] for part in self.parts
        }


def shape_of(dims: Sequence[int], grid: Grid) -> tuple[int, ...]:
    """The lengths of some dimensions."""
    return tuple(grid.shape[d] for d in dims)


def blocks_of(
    groups: Sequence[Group], grid: Grid, most: int, order: Order | None = None
) -> Iterator[Block]:
    """All blocks of all groups, each of at most `most` lanes."""
    numbers = itertools.count()
    for group in groups:
        many = math.prod(shape_of(group.dims, grid)) > most and not group.flags
        if order is not None and many:
            yield from _ordered(group, grid, most, order(group), numbers)
        else:
            yield from _in_place(group, grid, most, numbers)


def _in_place(group: Group, grid: Grid, most: int, numbers: Iterator[int]) -> Iterator[Block]:
    shape = shape_of(group.dims, grid)
    # Arrays that lie apart need no cut: none is as large as the product of the dimensions.
    made = cut(shape, math.prod(shape) if group.apart else most)
    inputs = [grid.inputs[i] for i in group.inputs]

    def arguments(place: tuple[slice, ...]) -> list[np.ndarray]:
        pieces = dict(zip(group.dims, zip(place, made.block, strict=True), strict=True))
        return [i.values if i.dim is None else padded(i.values, *pieces[i.dim]) for i in inputs]

    for place in made.blocks:
        along = dict(zip(group.dims, place, strict=True))
        parts = [
            Part(
                number,
                array,
                tuple(slice(0, along[d].stop - along[d].start) for d in array.dims),
                tuple(along[d] for d in array.dims),
            )
            for number, array in enumerate(group.arrays)
            # The first block along a dimension computes what does not vary along it.
            if all(along[d].start == 0 for d in group.dims if d not in array.dims)
        ]
        yield Block(
            next(numbers), group.grid, functools.partial(arguments, place), tuple(parts), place
        )


def _ordered(
    group: Group, grid: Grid, most: int, order: np.ndarray, numbers: Iterator[int]
) -> Iterator[Block]:
    made = cut((len(order),), most)
    shape = shape_of(group.dims, grid)
    inputs = [grid.inputs[i] for i in group.inputs]

    def places(lanes: np.ndarray) -> dict[int, np.ndarray]:
        return dict(zip(group.dims, np.unravel_index(lanes, shape), strict=True))

    def arguments(piece: slice) -> list[np.ndarray]:
        at = places(padded(order, piece, made.block[0]))
        return [i.values if i.dim is None else i.values[at[i.dim]] for i in inputs]

    for (piece,) in made.blocks:
        at = places(order[piece])
        useful = (slice(0, piece.stop - piece.start),)
        parts = [
            Part(number, array, useful, tuple(at[d] for d in array.dims))
            for number, array in enumerate(group.arrays)
        ]
        yield Block(next(numbers), group.lanes, functools.partial(arguments, piece), tuple(parts))


def compute(
    blocks: Iterable[Block],
    workers: Workers,
    keep: Callable[[Block, Arrays], None] | None = None,
) -> Iterator[tuple[Block, Arrays | None]]:
    """Compute blocks and yield them in order, with their results, in every process.

    The next blocks are computed while one is read. With `keep`, which is called with the
    results of a block by the process that has computed it, processes do not exchange results, and
    None stands for them.
    """
    waiting: deque[tuple[list[Block], Sequence[jax.Array]]] = deque()
    blocks = iter(blocks)
    for turn in itertools.count():
        group = list(itertools.islice(blocks, workers.processes))
        started = ()
        if workers.process < len(group):
            block = group[workers.process]
            started = block.call(*workers.placed(turn, block.arguments()))
        if group:
            waiting.append((group, started))
        while waiting and (not group or len(waiting) > workers.ahead):
            yield from _read(*waiting.popleft(), workers, keep)
        if not group:
            return


def _read(
    group: list[Block],
    started: Sequence[jax.Array],
    workers: Workers,
    keep: Callable[[Block, Arrays], None] | None,
) -> Iterator[tuple[Block, Arrays | None]]:
    mine = {}
    if workers.process < len(group):
        mine = group[workers.process].results(started)
        if keep is not None:
            keep(group[workers.process], mine)
    if keep is not None:
        yield from ((block, None) for block in group)
        return
    forms = [[part.form for part in block.parts] for block in group]
    forms += [[]] * (workers.processes - len(group))
    everyone = workers.exchanged(list(mine.values()), forms)
    for block, found in zip(group, everyone, strict=False):
        keys = [part.array.key for part in block.parts]
        yield block, dict(zip(keys, found, strict=True))


@dataclass(frozen=True, eq=False)
class Outcome:
    """The arrays of a run by key, and the part of the lanes that was computed, 1 at the end."""

    arrays: Mapping[str, Any]
    done: float


def collect(
    blocks: Sequence[Block],
    grid: Grid,
    workers: Workers,
    tell: Tell,
    unfinished: Mapping[str, Any],
) -> Outcome:
    """Compute all blocks into arrays.

    An interrupt from the keyboard ends it early: what has not been computed then holds the numbers
    `unfinished`, by key. An interrupt before the first useful result is raised again.
    """
    arrays = empty_arrays(blocks, grid)
    finished: set[int] = set()
    total = sum(block.lanes for block in blocks)
    done = 0
    try:
        for block, results in compute(blocks, workers):
            assert results is not None
            for part in block.parts:
                arrays[part.array.key][part.place] = results[part.array.key]
            finished.add(block.number)
            done += block.lanes
            tell(done, total)
    except KeyboardInterrupt:
        missing = [block for block in blocks if block.number not in finished]
        fill(arrays, missing, unfinished, workers)
        return Outcome(arrays, done / total)
    return Outcome(arrays, 1.0)


def empty_arrays(blocks: Sequence[Block], grid: Grid) -> Arrays:
    """Arrays that have room for the results of all blocks."""
    return {
        array.key: np.empty(shape_of(array.dims, grid) + array.kind.shape, array.kind.dtype)
        for array in dict.fromkeys(part.array for block in blocks for part in block.parts)
    }


def fill(
    arrays: Arrays, missing: Sequence[Block], unfinished: Mapping[str, Any], workers: Workers
) -> None:
    """Fill what was not computed with `unfinished`; KeyboardInterrupt if the rest is useless."""
    parts = [part for block in missing for part in block.parts]
    # Other processes wait for results that will not come.
    if workers.processes > 1 or any(is_flag(part.array.key) for part in parts):
        raise KeyboardInterrupt
    for part in parts:
        arrays[part.array.key][part.place] = unfinished[part.array.key]
