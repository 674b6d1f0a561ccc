"""The loop of a sweep into a store: finished blocks are not computed again."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .._progress import Tell
from ._axes import Grid
from ._devices import Workers
from ._export import attributes_of
from ._run import Arrays, Block, Part, fill, shape_of, work_off
from ._skip import Dependence, flag_key, is_flag
from ._store import Coordinate, Stored, open_store


def collect_stored(
    path: str | os.PathLike,
    signature: Mapping[str, Any],
    leaves: Mapping[str, Dependence],
    blocks: Sequence[Block],
    grid: Grid,
    workers: Workers,
    tell: Tell,
) -> tuple[Mapping[str, Any], float]:
    """Compute the blocks that the store at `path` lacks; the arrays are those of the store.

    `leaves` says which flags must be true for an array to hold. Only flags are read at once: the
    results may be larger than the memory. Raises ValueError for a store of another sweep.
    """
    # The first block of an array has the full length.
    first = {part.array.key: part for block in reversed(blocks) for part in block.parts}
    store = open_store(
        path,
        signature,
        {key: _form(part, grid, leaves.get(key)) for key, part in first.items()},
        [{part.array.key: _place(part) for part in block.parts} for block in blocks],
        {
            i.name: Coordinate(grid.dims[i.dim], i.values, attributes_of(i.name))
            for i in grid.inputs
            if i.dim is not None
        },
    )
    missing = [block for block in blocks if not store.finished(block.number)]
    # All processes list what is missing before one of them writes.
    workers.meet("store opened")

    def keep(block: Block, results: Arrays) -> None:
        store.write(block.number, results)

    total = sum(block.lanes for block in blocks)
    left, done = work_off(missing, total, workers, tell, keep, exchange=False)
    found = store.arrays()
    if left:
        arrays = {key: np.asarray(array[...]) for key, array in found.items()}
        fill(arrays, left)
        return arrays, done
    workers.meet("store complete")
    lacking = store.lacking()
    if lacking:
        raise ValueError(
            "Argument `store` must be a path that all processes share, but process "
            f"{workers.process} does not find {len(lacking)} blocks in {os.fspath(path)}."
        )
    return {k: np.asarray(a[...]) if is_flag(k) else a for k, a in found.items()}, done


def _form(part: Part, grid: Grid, leaf: Dependence | None) -> Stored:
    array, key = part.array, part.array.key
    attributes = attributes_of(key)
    if leaf is not None and leaf.conditions:
        # For readers of the store itself.
        attributes["valid_where"] = " ".join(map(flag_key, leaf.conditions))
    own = tuple(f"{key.split('/')[-1]}_{k}" for k in range(len(array.kind.shape)))
    return Stored(
        dims=tuple(grid.dims[d] for d in array.dims) + own,
        shape=shape_of(array.dims, grid) + array.kind.shape,
        chunk=part.form.shape,
        dtype=np.dtype(array.kind.dtype),
        attributes=attributes,
    )


def _place(part: Part) -> tuple[slice, ...]:
    return part.place + tuple(slice(0, length) for length in part.array.kind.shape)
