"""The public function `sweep`."""

from __future__ import annotations

import functools
import math
import os
import warnings
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any, Self

import jax
import numpy as np
from jaxtyping import ArrayLike

from .._entry import (
    refusal,
    rendered,
    require_choice,
    require_count,
    require_function,
    require_number,
)
from .._impact import Status
from .._text.columns import File
from .._text.progress import Listener, Tell, progress_of
from .._text.units import quantity
from .._text.words import wrapped
from .export import dataset, write_csv
from .planning.axes import SweepGrid, check_call, grid_of
from .planning.blocks import Order, Workers, blocks_of, shape_of, workers_of
from .planning.plan import VALUE, Plan, plan_of
from .planning.signature import signature_of
from .run import Results, collect, collect_stored, compute
from .skip.work import Group, flag_key
from .store import local_folder
from .table import OutputField, SweepColumn, SweepTable, dims_in, within

if TYPE_CHECKING:
    import xarray

METHODS = ("nearest",)

_ROUNDINGS = 4
"""Rounding tolerance: a number from linspace may differ in the last bits from a typed one."""

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


class Sweep(SweepTable):
    """The result of `sweep`: every field of the function's output over the grid of the axes.

    A field is read as an attribute, `table.restitution`, or as `table["restitution"]`. An output
    without names is `table.value`. A field is a numpy array of the shape `table.shape`, followed by
    the shape of one lane's value. A field that does not depend on an axis is stored once and
    repeated as a read-only view.

    `axes` maps the names of the axes (or samples) to their numbers, in order; `fixed` holds the
    fixed arguments; `dims` and `shape` are the names and lengths of the dimensions. `status` is
    that of the output. If the output has no status, it is INVALID_INPUT for a parameter out of its
    range, NOT_CONVERGED for a NaN from valid parameters, and SEPARATED otherwise. `complete` is
    False after an interrupt; lanes that were not computed are then NaN and NOT_CONVERGED. `resumed`
    is the fraction of the work that was already in the store.
    """

    def __getattr__(self, name: str) -> Any:
        # Unpickling looks up attributes before they are set.
        if name.startswith("_") or name not in self._fields:
            fields = ", ".join(self.__dict__.get("_fields", ()))
            raise AttributeError(f"this sweep has no field {name!r}; its fields: {fields}")
        return self[name]

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self._fields]

    def select(self, /, *, method: str | None = None, **where: float) -> Self:
        """Return the sweep at one number of one or more axes, without those dimensions.

        A number must be one of the axis, to rounding; `method="nearest"` takes the nearest. Samples
        are selected by their number: `sample=3`. Raises ValueError for a number that is not on the
        axis or a name that is not a dimension.
        """
        if method is not None:
            require_choice("method", method, METHODS)
        table = self
        for name, number in where.items():
            if name not in self.dims:
                raise ValueError(
                    f"Argument `{name}` must be a dimension of the sweep, but those are: "
                    f"{', '.join(self.dims) or 'none'}."
                )
            number = require_number(name, number)
            table = table.taken(name, _place(self.coordinates(name), name, number, method))
        return table

    def to_xarray(self) -> xarray.Dataset:
        """Return the sweep as an `xarray.Dataset`, with units and its origin as attributes.

        Raises ImportError without xarray, which comes with `pip install 'jaxcontact[data]'`.
        """
        return dataset(self)

    def to_csv(self, path: File) -> None:
        """Write a long table, one row per lane: its axes, then its fields.

        `path` names a file, which is written completely or not at all, or is an open file. The
        status is written by name. Every number is written so that it reads back exactly.
        """
        write_csv(self, path)

    def __repr__(self) -> str:
        lengths = " × ".join(f"{name} {n}" for name, n in zip(self.dims, self.shape, strict=True))
        lines = [
            f"Sweep of {self.function}: {lengths or 'no axes'}, {math.prod(self.shape):,} lanes"
        ]
        for name, values in self.axes.items():
            lines += _entry(name, quantity(name, _range(values)))
        if self.fixed:
            fixed = ", ".join(f"{k} = {_number(value)}" for k, value in self.fixed.items())
            lines += _entry("fixed", fixed)
        fields = []
        for name, column in self.columns().items():
            dims = sorted(set(dims_in(column, *column.masks)))
            over = ", ".join(map(self.dims.__getitem__, dims))
            fields.append(f"{name}({over}) {column.own_shape}".removesuffix(" ()"))
        lines += _entry("fields", ", ".join(fields) or "none")
        counts = ", ".join(f"{n:,} {_status(code)}" for code, n in self.status_counts().items())
        lines += _entry("status", counts)
        if self.resumed:
            was = f"{100 * self.resumed:.0f} % of the work was in the store"
            lines += _entry("resumed", was)
        if not self.complete:
            lines += _entry(
                "stopped", f"{100 * self.done:.0f} % of the work is done; the other lanes are NaN"
            )
        return "\n".join(lines)


def _place(values: np.ndarray, name: str, number: float, method: str | None) -> int:
    distance = np.abs(values - number)
    # Of two zeros, the one with the same sign.
    other = np.signbit(values) != np.signbit(number)
    place = int(np.lexsort((other, np.where(np.isnan(distance), np.inf, distance)))[0])
    digits = np.finfo(values.dtype).eps if values.dtype.kind == "f" else 0
    exact = distance[place] <= _ROUNDINGS * digits * abs(number)
    if method is None and not exact:
        near = np.unique(values[np.argsort(distance, kind="stable")[:3]])
        raise ValueError(
            f"Argument `{name}` must be a number of the axis, but is {number!r}; near it are "
            f"{', '.join(f'{value:.9g}' for value in near)} (or pass method='nearest')."
        )
    return place


def _status(code: int) -> str:
    return Status(code).name.lower() if code in set(Status) else f"of status {code}"


def _range(values: np.ndarray) -> str:
    finite = values[np.isfinite(values)]
    if not finite.size:
        return "none finite"
    if len(values) <= 4:
        return ", ".join(f"{value:.6g}" for value in values)
    return f"{finite.min():.6g} to {finite.max():.6g}"


def _number(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, np.floating) else str(value)


def _entry(head: str, text: str) -> list[str]:
    return wrapped(head, text, indent=10, lead="  ")


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
