"""The loop of a sweep: groups of arrays, block by block."""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

from ._axes import Grid
from ._blocks import cut, padded
from ._devices import Workers
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

    def forms(self) -> list[jax.ShapeDtypeStruct]:
        """Shape and type of the useful part of what the call returns."""
        lanes = tuple(s.stop for s in self.useful)
        return [jax.ShapeDtypeStruct(lanes + kind.shape, kind.dtype) for kind in self.group.kinds]

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


def compute(
    blocks: Iterable[Block],
    workers: Workers,
    keep: Callable[[Block, Arrays], None] | None = None,
) -> Iterator[tuple[Block, Arrays | None]]:
    """Compute blocks and yield them in order, with their results, in every process.

    While one is being read the next ones are being computed. With `keep`, which is called with the
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
    forms = [block.forms() for block in group] + [[]] * (workers.processes - len(group))
    everyone = workers.exchanged(list(mine.values()), forms)
    for block, found in zip(group, everyone, strict=False):
        yield block, dict(zip(block.group.keys, found, strict=True))


@dataclass(frozen=True, eq=False)
class Outcome:
    """The arrays of a run by key, and the part of the lanes that was computed, 1 at the end."""

    arrays: Mapping[str, Any]
    done: float


def collect(
    blocks: Sequence[Block],
    grid: Grid,
    workers: Workers,
    tell: Listener,
    unfinished: Mapping[str, Any],
) -> Outcome:
    """Compute all blocks into arrays.

    An interrupt from the keyboard ends it early: what has not been computed then holds the numbers
    `unfinished`, by key. An interrupt before anything of use is there is passed on.
    """
    arrays = empty_arrays(blocks, grid)
    finished: set[int] = set()
    total = sum(block.lanes for block in blocks)
    done = 0
    try:
        for block, results in compute(blocks, workers):
            assert results is not None
            for key, result in results.items():
                arrays[key][block.place] = result
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
        key: np.empty(shape_of(group, grid) + kind.shape, kind.dtype)
        for group in dict.fromkeys(block.group for block in blocks)
        for key, kind in zip(group.keys, group.kinds, strict=True)
    }


def fill(
    arrays: Arrays, missing: Sequence[Block], unfinished: Mapping[str, Any], workers: Workers
) -> None:
    """After an interrupt: put `unfinished` where nothing was computed, if the rest is of use."""
    # Other processes wait for results that will not come.
    if workers.processes > 1 or any(is_flag(key) for b in missing for key in b.group.keys):
        raise KeyboardInterrupt
    for block in missing:
        for key in block.group.keys:
            arrays[key][block.place] = unfinished[key]
