"""The public function `sweep`."""

from __future__ import annotations

import functools
import os
import warnings
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any

import jax
import numpy as np
from jaxtyping import ArrayLike

from .._entry import (
    refusal,
    rendered,
    require_count,
    require_function,
)
from .._text.progress import Listener, Tell, progress_of
from .planning.axes import SweepGrid, check_call, grid_of
from .planning.blocks import Order, Workers, blocks_of, shape_of, workers_of
from .planning.plan import VALUE, Plan, plan_of
from .planning.signature import signature_of
from .result import Sweep
from .run import Results, collect, collect_stored, compute
from .skip.work import Group, flag_key
from .store import local_folder
from .table import OutputField, SweepColumn, within

if TYPE_CHECKING:
    pass

_LANES = 1 << 14
"""Lanes per call on a CPU, whose intermediate results fit its caches. Measured on two cores:
summaries run at 1.1 million/s in blocks of 2^12 and 2^14, and 0.6 million/s in blocks of 2^16.
"""

_LANES_OPEN_ENDED = 1 << 9
"""Lanes per call for loops of unknown length, in which a call lasts as long as its slowest lane.
Event solves run in chunks of 64 lanes, in blocks of 2^12 a sixth faster.
"""

_LANES_BRANCHING = 1 << 12
"""Lanes per call for programs with branches, which keep more in memory: the phase method runs at
0.43 million/s, and at 0.23 million/s in blocks of 2^14.
"""

_LANES_ACCELERATED = 1 << 20
"""Lanes per call on other devices, enough to use a GPU fully."""


Fold = Callable[[Any, Sweep], Any]


def sweep(
    fn: Callable[..., Any],
    *,
    samples: Mapping[str, ArrayLike] | None = None,
    batch_size: int | None = None,
    store: str | os.PathLike[str] | None = None,
    mesh: jax.sharding.Mesh | None = None,
    reduce: tuple[Any, Fold] | None = None,
    cost: Callable[..., Any] | None = None,
    progress: bool | Listener | None = None,
    **axes: Any,
) -> Sweep:
    """Evaluate a function of named numbers on the grid of its axes, or over aligned samples.

    `fn` is called with one number for each name, and must be traceable by JAX. It returns an array,
    or fields: an `Impact`, any dataclass or equinox module, a named tuple, a dict. `axes` are
    one-dimensional arrays, which span the grid in the given order. A float is a fixed number. Whole
    numbers, strings, None and objects (a law, a method, a function) are passed on unchanged.
    `samples` are arrays of one length by name, taken together lane by lane; axes then span a grid
    for each sample.

    An output is computed once along an axis that it does not depend on, or that only decides
    whether it is NaN. Over (e, K, m, v) the restitution of the Hunt-Crossley family takes one solve
    for each e. The analysis of the traced function finds this; nothing needs to be declared. The
    result is that of the plain computation to rounding, and for an adaptive solve to its tolerance.

    `batch_size` is the largest number of lanes that a core computes at once, which bounds the
    memory beside the result. Defaults: 16384; 4096 for the phase method and other programs with
    branches; 512 for event solves and other loops of unknown length; 1048576 on a GPU.
    `reduce=(start, fold)` stores no lanes: `fold(value, block)` is called for each block, itself a
    `Sweep` of a part of the grid, and returns the next value. The last one is `table.value`.
    `cost`, a function of some of the same names, predicts the work of a lane. Lanes are then
    computed in its order, so that lanes of similar cost share a block. The `steps` of a coarse
    sweep show on which arguments the cost depends.

    `store` is a path (with the extra `data`) to which finished blocks are written. A killed sweep
    continues from there and ends with the same bits; its summary states this (`table.resumed` is
    the fraction found). The store of another function, other axes or another version is refused.
    Results may then be larger than the memory: a field is read on access. `mesh` is a
    `jax.sharding.Mesh` whose devices take blocks in turn. Under `jax.distributed` processes do so
    too, without `mesh`. Neither changes the result.

    `progress`: None shows a bar on stderr after a second, if that is a terminal or a notebook; True
    always does, False never. A function is called with the lanes done and all lanes. Ctrl-C ends a
    sweep early with a warning: lanes that were not computed are NaN and NOT_CONVERGED, and
    `table.complete` is False.

    `fn` is traced once a call, and not compiled again over axes of other numbers. Functions are the
    same if JAX traces them to the same program with the same constants, in one process and for a
    store in any other. A lambda typed again is therefore the same, and one that reads a changed
    number is not. A function that calls back to Python (`jax.pure_callback`) is compiled each time.

    Returns a `Sweep`. Bad lanes are flagged in `.status`; their neighbours are unaffected. Raises
    ValueError for an argument that `fn` does not take or lacks, and for axes that are not numbers.
    """
    if batch_size is not None:
        batch_size = require_count("batch_size", batch_size, 1)
    if cost is not None:
        require_function("cost", cost)
    folder = None if store is None else local_folder(store)
    if folder is not None and (reduce is not None or cost is not None):
        other = "reduce" if reduce is not None else "cost"
        raise ValueError(
            f"Argument `store` must be None with `{other}`, but is {rendered(store)}, since a "
            "store holds every lane in its place."
        )
    grid = grid_of(samples, axes)
    check_call(fn, grid)
    workers = workers_of(mesh)
    plan = plan_of(fn, grid)
    if folder is not None and any(map(plan.program.holds, ("pure_callback", "io_callback"))):
        warnings.warn(
            "Argument `fn` calls back to Python, whose code a store does not record: delete the "
            "store after a change of it.",
            stacklevel=2,
        )
    most = batch_size or _lanes_at_once(plan)
    with progress_of(progress if workers.process == 0 else False, "lanes", "sweep") as tell:
        if reduce is not None:
            table = _reduce(fn, plan, grid, most, workers, reduce, tell)
        else:
            order = None if cost is None else _order_by(cost, grid, most, workers)
            blocks = list(blocks_of(plan.groups, grid, most, order))
            if folder is None:
                results = collect(blocks, grid, workers, tell)
            else:
                constants = {f.name: f.constant for f in plan.fields if not f.arrays}
                signature = signature_of(plan.key, _name_of(fn), plan.leaves, constants, grid, most)
                results = collect_stored(
                    folder, signature, plan.leaves, blocks, grid, workers, tell
                )
            table = _table(plan, plan.groups, grid, results, _name_of(fn))
    if not table.complete:
        warnings.warn(
            f"The sweep was interrupted with {100 * table.done:.0f} % of its work done: lanes that "
            "were not computed are NaN, and `complete` is False.",
            stacklevel=2,
        )
    return table


def _lanes_at_once(plan: Plan) -> int:
    if jax.default_backend() != "cpu":
        return _LANES_ACCELERATED
    if plan.program.holds("while"):
        return _LANES_OPEN_ENDED
    return _LANES_BRANCHING if plan.program.holds("cond") else _LANES


def _name_of(function: Callable[..., Any]) -> str:
    if isinstance(function, functools.partial):
        return _name_of(function.func)
    return getattr(function, "__name__", type(function).__name__)


def _table(
    plan: Plan, groups: tuple[Group, ...], grid: SweepGrid, results: Results, function: str
) -> Sweep:
    arrays = results.arrays
    dims = {array.key: array.dims for group in groups for array in group.arrays}

    def masks(slots: Iterable[int]) -> tuple[SweepColumn, ...]:
        return tuple(SweepColumn(dims[key], arrays[key]) for key in map(flag_key, slots))

    columns = {
        name: SweepColumn(
            dims[name],
            arrays[name],
            () if groups == (plan.whole,) else masks(leaf.conditions),
            leaf.otherwise,
        )
        for name, leaf in plan.leaves.items()
    }
    checks = masks(plan.checks)
    return Sweep(
        *(grid, plan.fields, columns, checks, results.computed),
        done=results.done,
        resumed=results.resumed,
        function=function,
    )


def _order_by(cost: Callable[..., Any], grid: SweepGrid, most: int, workers: Workers) -> Order:
    """Return the lanes of a group from the most to the least expensive, as predicted by `cost`."""
    taken = grid.restrict_to(cost)
    check_call(cost, taken)
    plan = plan_of(cost, taken)
    if len(plan.leaves) != 1 or plan.whole.arrays[0].kind.shape != ():
        raise ValueError("Argument `cost` must return one number for each lane.")
    (group,) = (group for group in plan.groups if not group.flags)
    blocks = list(blocks_of((group,), taken, most))
    (predicted,) = collect(blocks, taken, workers, lambda *_: None).arrays.values()

    def order(wanted: Group) -> np.ndarray:
        # Any index works along a dimension that the wanted arrays do not have.
        here = predicted[tuple(slice(None) if d in wanted.dims else 0 for d in group.dims)]
        dims = [d for d in group.dims if d in wanted.dims]
        lanes = np.broadcast_to(within(here, dims, wanted.dims), shape_of(wanted.dims, grid))
        return np.argsort(-lanes.reshape(-1), kind="stable")

    return order


def _reduce(
    fn: Callable[..., Any],
    plan: Plan,
    grid: SweepGrid,
    most: int,
    workers: Workers,
    reduce: tuple[Any, Fold],
    tell: Tell,
) -> Sweep:
    """Fold all blocks of the grid, each as a small sweep."""
    try:
        value, fold = reduce
    except (TypeError, ValueError):
        fold = value = None
    if not callable(fold):
        raise refusal("reduce", "be a pair (start, fold) with a function", reduce)
    groups, function = (plan.whole,), _name_of(fn)
    done = 0
    try:
        for block, arrays in compute(blocks_of(groups, grid, most), workers):
            part = Results(arrays, (), 1.0)
            value = fold(value, _table(plan, groups, grid.part(block.place), part, function))
            done += block.lanes
            tell(done, grid.size)
    except KeyboardInterrupt:
        if not done or workers.processes > 1:
            raise
    field = OutputField(VALUE, constant=value)
    return Sweep(grid, [field], {}, done=done / grid.size, function=function)
