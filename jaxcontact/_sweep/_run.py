"""The loop of a sweep: groups of arrays, block by block."""

from __future__ import annotations

import functools
import itertools
import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .._impact import Status
from .._progress import Tell
from ._axes import Grid
from ._blocks import cut, padded
from ._devices import Workers
from ._skip import Array, Group, is_flag

Arrays = dict[str, np.ndarray]
Order = Callable[[Group], np.ndarray]
"""The lanes of a group, counted in C order, in the order in which to compute them."""


@dataclass(frozen=True, eq=False)
class Part:
    """One array that a block computes."""

    number: int
    """Its number among the results of the call."""
    array: Array
    lengths: tuple[int, ...]
    """How many lanes it has along each dimension, without padding."""
    place: tuple[Any, ...]
    """Where in the whole array it belongs: slices, or indices lane by lane."""

    @property
    def form(self) -> jax.ShapeDtypeStruct:
        """Shape and type of the part without padding."""
        return jax.ShapeDtypeStruct(self.lengths + self.array.kind.shape, self.array.kind.dtype)


@dataclass(frozen=True, eq=False)
class Block:
    """One call of a compiled function, and the parts of its results that are kept."""

    number: int
    call: Callable[..., Sequence[jax.Array]]
    arguments: Callable[[], list[np.ndarray]]
    parts: Sequence[Part]
    place: tuple[slice, ...] = ()
    """The part of the dimensions of its group, if it is a part of a grid."""

    @property
    def lanes(self) -> int:
        """The number of lanes without padding."""
        return max(math.prod(part.lengths) for part in self.parts)

    def results(self, outputs: Sequence[jax.Array]) -> Arrays:
        """What the call returned, by key, without padding."""
        return {
            part.array.key: np.asarray(outputs[part.number])[tuple(map(slice, part.lengths))]
            for part in self.parts
        }


Keep = Callable[[Block, Arrays], None]
"""Called with a block and its results by key."""


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
                tuple(along[d].stop - along[d].start for d in array.dims),
                tuple(along[d] for d in array.dims),
            )
            for number, array in enumerate(group.arrays)
            # The first block along a dimension computes what does not vary along it.
            if all(along[d].start == 0 for d in group.dims if d not in array.dims)
        ]
        yield Block(next(numbers), group.grid, functools.partial(arguments, place), parts, place)


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
        parts = [
            Part(number, array, (piece.stop - piece.start,), tuple(at[d] for d in array.dims))
            for number, array in enumerate(group.arrays)
        ]
        yield Block(next(numbers), group.lanes, functools.partial(arguments, piece), parts)


def compute(
    blocks: Iterable[Block], workers: Workers, keep: Keep, *, exchange: bool = True
) -> Iterator[Block]:
    """Compute blocks in order, call `keep` with the results of each, and then yield it.

    The next blocks are computed while one is read. Every process keeps every block; without
    `exchange` only the one that has computed it does.
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
            done, outputs = waiting.popleft()
            yield from _kept(done, outputs, workers, keep, exchange)
        if not group:
            return


def _kept(
    group: list[Block],
    outputs: Sequence[jax.Array],
    workers: Workers,
    keep: Keep,
    exchange: bool,
) -> Iterator[Block]:
    mine = {}
    if workers.process < len(group):
        mine = group[workers.process].results(outputs)
        if not exchange:
            keep(group[workers.process], mine)
    if not exchange:
        yield from group
        return
    forms = [[part.form for part in block.parts] for block in group]
    forms += [[]] * (workers.processes - len(group))
    everyone = workers.exchanged(list(mine.values()), forms)
    for block, found in zip(group, everyone, strict=False):
        keep(block, dict(zip([part.array.key for part in block.parts], found, strict=True)))
        yield block


def work_off(
    blocks: Sequence[Block],
    total: int,
    workers: Workers,
    tell: Tell,
    keep: Keep,
    *,
    exchange: bool = True,
) -> tuple[list[Block], float]:
    """Compute blocks: those that were not computed, and the part of `total` lanes that is done.

    An interrupt from the keyboard ends it early. It is raised again if the rest has flags, without
    which no result is useful, or if other processes wait for the rest.
    """
    left = {block.number: block for block in blocks}
    done = total - sum(block.lanes for block in blocks)
    try:
        for block in compute(blocks, workers, keep, exchange=exchange):
            del left[block.number]
            done += block.lanes
            tell(done, total)
    except KeyboardInterrupt:
        flags = any(is_flag(part.array.key) for block in left.values() for part in block.parts)
        if flags or workers.processes > 1:
            raise
    return list(left.values()), done / total if left else 1.0


def collect(
    blocks: Sequence[Block], grid: Grid, workers: Workers, tell: Tell
) -> tuple[Arrays, float]:
    """Compute all blocks into arrays by key; with them the part of the lanes that is done."""
    arrays = {
        array.key: np.empty(shape_of(array.dims, grid) + array.kind.shape, array.kind.dtype)
        for array in dict.fromkeys(part.array for block in blocks for part in block.parts)
    }

    def keep(block: Block, results: Arrays) -> None:
        for part in block.parts:
            arrays[part.array.key][part.place] = results[part.array.key]

    total = sum(block.lanes for block in blocks)
    left, done = work_off(blocks, total, workers, tell, keep)
    fill(arrays, left)
    return arrays, done


def fill(arrays: Arrays, left: Iterable[Block]) -> None:
    """Fill the places of blocks that were not computed: NaN, zero, or NOT_CONVERGED."""
    for part in (part for block in left for part in block.parts):
        key = part.array.key
        unknown = jnp.nan if jnp.issubdtype(part.array.kind.dtype, jnp.inexact) else 0
        arrays[key][part.place] = int(Status.NOT_CONVERGED) if key == "status" else unknown
