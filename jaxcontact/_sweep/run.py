"""The loop of a sweep, in memory or into a store, which skips finished blocks."""

from __future__ import annotations

import functools
import itertools
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .._impact import Status
from .._text.progress import Tell
from .planning.axes import SweepGrid
from .planning.blocks import Arrays, Block, Part, Workers, shape_of
from .skip.dependence import Dependence
from .skip.work import flag_key, is_flag
from .store import Stored, coordinate, open_store
from .table import SweepColumn, attributes_of


def compute(
    blocks: Iterable[Block], workers: Workers, *, exchange: bool = True
) -> Iterator[tuple[Block, Arrays]]:
    """Compute blocks in order, and yield each with its results by key.

    The next blocks are computed while one is read, on a CPU each in a thread, since a loop runs on
    one core. Every process receives the results of every block. Without `exchange` each process
    receives only its own results.
    """
    waiting: deque[tuple[list[Block], Callable[[], Sequence[jax.Array]]]] = deque()
    blocks, compiled = iter(blocks), set()
    pool = ThreadPoolExecutor(workers.threads)
    # A setting of the caller's thread alone does not hold in others.
    x64 = jax.dtypes.canonicalize_dtype(float) == np.float64

    def run(block: Block, arguments: Sequence[Any]) -> Sequence[jax.Array]:
        with jax.enable_x64(x64):
            return jax.block_until_ready(block.call(*arguments))

    try:
        for turn in itertools.count():
            group = list(itertools.islice(blocks, workers.processes))
            started: Callable[[], Sequence[jax.Array]] = tuple
            if workers.process < len(group):
                block = group[workers.process]
                arguments = workers.place(turn, block.arguments())
                if block.call in compiled and workers.threads > 1:
                    started = pool.submit(run, block, arguments).result
                else:
                    started = functools.partial(lambda out: out, block.call(*arguments))
                    compiled.add(block.call)
            if group:
                waiting.append((group, started))
            while waiting and (not group or len(waiting) > workers.ahead):
                group_done, finished = waiting.popleft()
                yield from _results(group_done, finished(), workers, exchange)
            if not group:
                return
    finally:
        pool.shutdown(cancel_futures=True)


def _results(
    group: list[Block], outputs: Sequence[jax.Array], workers: Workers, exchange: bool
) -> Iterator[tuple[Block, Arrays]]:
    mine = group[workers.process].results(outputs) if workers.process < len(group) else {}
    if not exchange:
        yield from ((b, mine if k == workers.process else {}) for k, b in enumerate(group))
        return
    forms = [[part.form for part in block.parts] for block in group]
    forms += [[]] * (workers.processes - len(group))
    everyone = workers.exchange(list(mine.values()), forms)
    for block, results in zip(group, everyone, strict=False):
        yield block, dict(zip([part.array.key for part in block.parts], results, strict=True))


def _lanes_in(blocks: Sequence[Block]) -> int:
    return sum(block.lanes for block in blocks)


def work_off(
    missing: Sequence[Block],
    blocks: Sequence[Block],
    workers: Workers,
    tell: Tell,
    keep: Callable[[Block, Arrays], None],
    *,
    exchange: bool = True,
    note: str = "",
) -> tuple[list[Block], float]:
    """Compute the `missing` blocks; return those left, and the fraction of all lanes done.

    `keep` is called with each block computed in this process and its results. `note` is reported
    beside the progress. A keyboard interrupt ends the loop early. It is raised again if flags are
    missing, without which no result is usable, or if other processes wait for the rest.
    """
    left = {block.number: block for block in missing}
    total = _lanes_in(blocks)
    done = total - _lanes_in(missing)
    try:
        for block, results in compute(missing, workers, exchange=exchange):
            if results:
                keep(block, results)
            del left[block.number]
            done += block.lanes
            tell(done, total, note)
    except KeyboardInterrupt:
        flags = any(is_flag(part.array.key) for block in left.values() for part in block.parts)
        if flags or workers.processes > 1:
            raise
    return list(left.values()), done / total if left else 1.0


@dataclass(frozen=True, eq=False)
class Results:
    """The computed arrays."""

    arrays: Mapping[str, Any]
    """By key; lanes omitted after an interrupt are NaN, zero, or NOT_CONVERGED."""
    computed: tuple[SweepColumn, ...]
    """Flags that are false where an array was omitted; empty after a complete run."""
    done: float
    """The fraction of all lanes that was computed."""
    resumed: float = 0.0
    """The fraction of all lanes that was in the store before."""


def collect(blocks: Sequence[Block], grid: SweepGrid, workers: Workers, tell: Tell) -> Results:
    """Compute all blocks."""
    arrays = {
        array.key: np.empty(shape_of(array.dims, grid) + array.kind.shape, array.kind.dtype)
        for array in dict.fromkeys(part.array for block in blocks for part in block.parts)
    }

    def keep(block: Block, results: Arrays) -> None:
        for part in block.parts:
            arrays[part.array.key][part.place] = results[part.array.key]

    left, done = work_off(blocks, blocks, workers, tell, keep)
    return _fill(arrays, left, grid, done)


def _fill(arrays: Arrays, left: Iterable[Block], grid: SweepGrid, done: float) -> Results:
    """Return the results, with the places of the blocks that are `left` filled."""
    flags: dict[str, SweepColumn] = {}
    for part in (part for block in left for part in block.parts):
        dims, key = part.array.dims, part.array.key
        unknown = jnp.nan if jnp.issubdtype(part.array.kind.dtype, jnp.inexact) else 0
        arrays[key][part.place] = int(Status.NOT_CONVERGED) if key == "status" else unknown
        if key not in flags:
            flags[key] = SweepColumn(dims, np.ones(shape_of(dims, grid), bool))
        flags[key].stored[part.place] = False
    return Results(arrays, tuple(flags.values()), done)


def collect_stored(
    path: Path,
    signature: Mapping[str, Any],
    leaves: Mapping[str, Dependence],
    blocks: Sequence[Block],
    grid: SweepGrid,
    workers: Workers,
    tell: Tell,
) -> Results:
    """Compute the blocks that the store at `path` lacks, and return the arrays of the store.

    `leaves` lists the flags that must be true for an array to be valid. Only flags are loaded at
    once, since the results may be larger than the memory. Raises ValueError for a store of another
    sweep.
    """
    # The first block of an array has the full length.
    first = {part.array.key: part for block in reversed(blocks) for part in block.parts}
    store = open_store(
        path,
        signature,
        {key: _form(part, grid, leaves.get(key)) for key, part in first.items()},
        [{part.array.key: _place(part) for part in block.parts} for block in blocks],
        {
            i.name: coordinate(grid.dims[i.dim], i.values, attributes_of(i.name))
            for i in grid.inputs
            if i.dim is not None
        },
    )
    missing = [block for block in blocks if not store.is_finished(block.number)]
    # All processes list the missing blocks before one of them writes.
    workers.meet("store opened")

    def keep(block: Block, results: Arrays) -> None:
        store.write(block.number, results)

    resumed = 1 - _lanes_in(missing) / _lanes_in(blocks)
    note = f"{100 * resumed:.0f} % from the store" if resumed else ""
    left, done = work_off(missing, blocks, workers, tell, keep, exchange=False, note=note)
    if left:
        arrays = {key: np.asarray(array[...]) for key, array in store.arrays.items()}
        return replace(_fill(arrays, left, grid, done), resumed=resumed)
    workers.meet("store complete")
    if lacking := store.lacking():
        raise ValueError(
            "Argument `store` must be a path that all processes share, but process "
            f"{workers.process} does not find {len(lacking)} blocks in {path}."
        )
    arrays = {k: np.asarray(a[...]) if is_flag(k) else a for k, a in store.arrays.items()}
    return Results(arrays, (), done, resumed)


def _form(part: Part, grid: SweepGrid, leaf: Dependence | None) -> Stored:
    array, key = part.array, part.array.key
    attributes = attributes_of(key)
    if leaf is not None and leaf.conditions:
        # For readers of the store itself.
        attributes["valid_where"] = " ".join(map(flag_key, leaf.conditions))
    own_dims = tuple(f"{key.split('/')[-1]}_{k}" for k in range(len(array.kind.shape)))
    return Stored(
        dims=tuple(grid.dims[d] for d in array.dims) + own_dims,
        shape=shape_of(array.dims, grid) + array.kind.shape,
        # A chunk has a length, even for an array without elements.
        chunk=tuple(max(length, 1) for length in part.form.shape),
        dtype=np.dtype(array.kind.dtype),
        attributes=attributes,
    )


def _place(part: Part) -> tuple[slice, ...]:
    return part.place + tuple(slice(0, length) for length in part.array.kind.shape)
