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
from ._run import Arrays, Block, Outcome, compute, fill, shape_of
from ._skip import is_flag
from ._store import Coordinate, Stored, open_store

_FLAGS = "flags/"
"""The group of a store that holds flags, where they are not taken for results."""


def collect_stored(
    path: str | os.PathLike,
    signature: Mapping[str, Any],
    names: Mapping[str, str],
    conditions: Mapping[str, Sequence[str]],
    blocks: Sequence[Block],
    grid: Grid,
    workers: Workers,
    tell: Tell,
    unfinished: Mapping[str, Any],
) -> Outcome:
    """Compute the blocks that the store at `path` lacks; the arrays are those of the store.

    `names` are those of the arrays in the store, by key; `conditions` are the keys of the flags
    that must be true for an array to hold. Only flags are read at once: the results may be larger
    than the memory. Raises ValueError for a store of another sweep.
    """
    keys = dict.fromkeys(part.array.key for block in blocks for part in block.parts)
    names = {key: names.get(key, _FLAGS + key.split()[-1]) for key in keys}
    store = open_store(
        path,
        signature,
        _forms(blocks, grid, names, conditions),
        [_places(block, names) for block in blocks],
        _coordinates(grid),
    )
    missing = [block for block in blocks if not store.finished(block.number)]
    # All processes list what is missing before one of them writes.
    workers.meet("store opened")
    total = sum(block.lanes for block in blocks)
    done = total - sum(block.lanes for block in missing)
    finished: set[int] = set()

    def keep(block: Block, results: Arrays) -> None:
        store.write(block.number, {names[key]: result for key, result in results.items()})

    try:
        for block, _ in compute(missing, workers, keep):
            finished.add(block.number)
            done += block.lanes
            tell(done, total)
    except KeyboardInterrupt:
        arrays = {key: np.asarray(store.arrays()[name][...]) for key, name in names.items()}
        lacking = [block for block in missing if block.number not in finished]
        fill(arrays, lacking, unfinished, workers)
        return Outcome(arrays, done / total)
    workers.meet("store complete")
    lacking = store.lacking()
    if lacking:
        raise ValueError(
            "Argument `store` must be a path that all processes share, but process "
            f"{workers.process} does not find {len(lacking)} blocks in {os.fspath(path)}."
        )
    found = store.arrays()
    return Outcome(
        {
            key: np.asarray(found[name][...]) if is_flag(key) else found[name]
            for key, name in names.items()
        },
        1.0,
    )


def _forms(
    blocks: Sequence[Block],
    grid: Grid,
    names: Mapping[str, str],
    conditions: Mapping[str, Sequence[str]],
) -> dict[str, Stored]:
    forms = {}
    for part in (part for block in blocks for part in block.parts):
        name, array = names[part.array.key], part.array
        if name in forms:
            continue
        own = tuple(f"{name.split('/')[-1]}_{k}" for k in range(len(array.kind.shape)))
        attributes = dict(attributes_of(name))
        if conditions.get(array.key):
            # For readers of the store itself.
            attributes["valid_where"] = " ".join(names[flag] for flag in conditions[array.key])
        forms[name] = Stored(
            dims=tuple(grid.dims[d] for d in array.dims) + own,
            shape=shape_of(array.dims, grid) + array.kind.shape,
            # The first block has the full length.
            chunk=part.form.shape,
            dtype=np.dtype(array.kind.dtype),
            attributes=attributes,
        )
    return forms


def _places(block: Block, names: Mapping[str, str]) -> dict[str, tuple[slice, ...]]:
    return {
        names[part.array.key]: part.place
        + tuple(slice(0, length) for length in part.array.kind.shape)
        for part in block.parts
    }


def _coordinates(grid: Grid) -> dict[str, Coordinate]:
    return {
        i.name: Coordinate(grid.dims[i.dim], i.values, attributes_of(i.name))
        for i in grid.inputs
        if i.dim is not None
    }
