"""The loop of a sweep: groups of arrays, block by block."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

from ._axes import Grid
from ._blocks import cut, padded
from ._plan import Group, is_flag
from ._progress import Listener

Arrays = dict[str, np.ndarray]
Order = Callable[[Group], np.ndarray]
"""The lanes of a group, counted in C order, in the order in which to compute them."""


@dataclass(frozen=True, eq=False)
class Block:
    """One call of a compiled function, and where its results belong."""

    number: int
    group: Group
    call: Callable[..., Sequence[jax.Array]]
    arguments: Callable[[], list[np.ndarray]]
    useful: tuple[slice, ...]
    """The part of what the call returns that is no padding."""
    place: tuple[Any, ...]
    """Where in the arrays of the group it belongs: slices, or indices lane by lane."""

    @property
    def lanes(self) -> int:
        """The number of lanes that are no padding."""
        return math.prod(s.stop for s in self.useful)

    def results(self, outputs: Sequence[jax.Array]) -> Arrays:
        """The useful part of what the call returned, by key."""
        return {
            key: np.asarray(out)[self.useful]
            for key, out in zip(self.group.keys, outputs, strict=True)
        }


def shape_of(group: Group, grid: Grid) -> tuple[int, ...]:
    """The lengths of the dimensions of a group."""
    return tuple(grid.shape[d] for d in group.dims)


def blocks_of(
    groups: Sequence[Group], grid: Grid, most: int, order: Order | None = None
) -> Iterator[Block]:
    """All blocks of all groups, each of at most `most` lanes."""
    numbers = itertools.count()
    for group in groups:
        many = math.prod(shape_of(group, grid)) > most and not is_flag(group.keys[0])
        if order is not None and many:
            yield from _ordered(group, grid, most, order(group), numbers)
        else:
            yield from _in_place(group, grid, most, numbers)


def _in_place(group: Group, grid: Grid, most: int, numbers: Iterator[int]) -> Iterator[Block]:
    made = cut(shape_of(group, grid), most)
    inputs = [grid.inputs[i] for i in group.inputs]

    def arguments(part: tuple[slice, ...]) -> list[np.ndarray]:
        pieces = dict(zip(group.dims, zip(part, made.block, strict=True), strict=True))
        return [i.values if i.dim is None else padded(i.values, *pieces[i.dim]) for i in inputs]

    for part in made.blocks:
        useful = tuple(slice(0, s.stop - s.start) for s in part)
        call = group.grid
        yield Block(next(numbers), group, call, lambda part=part: arguments(part), useful, part)


def _ordered(
    group: Group, grid: Grid, most: int, order: np.ndarray, numbers: Iterator[int]
) -> Iterator[Block]:
    made = cut((len(order),), most)
    shape = shape_of(group, grid)
    inputs = [grid.inputs[i] for i in group.inputs]

    def arguments(part: slice) -> list[np.ndarray]:
        lanes = np.unravel_index(padded(order, part, made.block[0]), shape)
        places = dict(zip(group.dims, lanes, strict=True))
        return [i.values if i.dim is None else i.values[places[i.dim]] for i in inputs]

    for (part,) in made.blocks:
        yield Block(
            next(numbers),
            group,
            group.lanes,
            lambda part=part: arguments(part),
            (slice(0, part.stop - part.start),),
            np.unravel_index(order[part], shape),
        )


def compute(blocks: Iterator[Block]) -> Iterator[tuple[Block, Arrays]]:
    """The results of all blocks; while one is being read the next is being computed."""
    waiting = None
    for block in blocks:
        coming = block, block.call(*block.arguments())
        if waiting is not None:
            yield waiting[0], waiting[0].results(waiting[1])
        waiting = coming
    if waiting is not None:
        yield waiting[0], waiting[0].results(waiting[1])


@dataclass(frozen=True, eq=False)
class Outcome:
    """The arrays of a run by key, and the part of the lanes that was computed, 1 at the end."""

    arrays: Arrays
    done: float


def collect(
    groups: Sequence[Group],
    grid: Grid,
    most: int,
    order: Order | None,
    tell: Listener,
    unfinished: Mapping[str, Any],
) -> Outcome:
    """Compute all blocks into arrays.

    An interrupt from the keyboard ends it early: what has not been computed then holds the numbers
    `unfinished`, by key. An interrupt before anything of use is there is passed on.
    """
    arrays = {
        key: np.empty(shape_of(group, grid) + kind.shape, kind.dtype)
        for group in groups
        for key, kind in zip(group.keys, group.kinds, strict=True)
    }
    finished: set[int] = set()
    total = sum(math.prod(shape_of(group, grid)) for group in groups)
    done = 0
    try:
        for block, results in compute(blocks_of(groups, grid, most, order)):
            for key, result in results.items():
                arrays[key][block.place] = result
            finished.add(block.number)
            done += block.lanes
            tell(done, total)
    except KeyboardInterrupt:
        missing = [b for b in blocks_of(groups, grid, most, order) if b.number not in finished]
        if not finished or any(is_flag(key) for b in missing for key in b.group.keys):
            raise
        for block in missing:
            for key in block.group.keys:
                arrays[key][block.place] = unfinished[key]
        return Outcome(arrays, done / total)
    return Outcome(arrays, 1.0)
