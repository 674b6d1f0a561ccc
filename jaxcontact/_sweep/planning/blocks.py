"""Blocks of one shape that divide a grid, their computation, and their distribution: processes take
them in turn, as do the devices of a process.

A block is computed completely on one device, by the program for one device. A program that XLA
partitions over devices is fused differently, and its last digits differ. Therefore the number of
devices changes no result, and no lane waits for a slower one on another device.
"""

from __future__ import annotations

import functools
import itertools
import math
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

from ..._entry import refusal
from ..skip.work import Array, Group
from .axes import SweepGrid

Arrays = dict[str, np.ndarray]
Order = Callable[[Group], np.ndarray]
"""Order of computation of the lanes of a group, counted in C order."""


_FEW = 8


def divide(shape: Sequence[int], most: int) -> tuple[int, ...]:
    """Return the shape of the blocks of at most `most` lanes that divide a grid of this shape.

    Leading dimensions are divided first. In C order a block is then one contiguous piece of the
    result. Quantities that depend on leading dimensions only are computed for few values per block.
    """
    block = []
    left = max(most, 1)
    for length in reversed(shape):
        step = min(left, length)
        pieces = math.ceil(length / step)
        if pieces < _FEW:
            # Nearly equal pieces need little padding. With many pieces padding is small anyway, and
            # their length (and thus the compiled function) stays independent of the length of the
            # dimension.
            step = math.ceil(length / pieces)
        block.append(step)
        left = left // step if pieces == 1 else 1
    return tuple(reversed(block))


def places_of(shape: Sequence[int], block: Sequence[int]) -> Iterator[tuple[slice, ...]]:
    """Yield the lanes of every block; the last one along a dimension may be shorter."""
    return itertools.product(
        *(
            [slice(start, min(start + step, length)) for start in range(0, length, step)]
            for length, step in zip(shape, block, strict=True)
        )
    )


def pad(values: np.ndarray, piece: slice, length: int) -> np.ndarray:
    """Return `values[piece]`, padded to `length` with its last element."""
    part = values[piece]
    if len(part) == length:
        return part
    return np.concatenate([part, np.repeat(part[-1:], length - len(part), axis=0)])


@dataclass(frozen=True, eq=False)
class Part:
    """One array that a block computes."""

    number: int
    """Its number among the results of the call."""
    array: Array
    lengths: tuple[int, ...]
    """Number of its lanes along each dimension, without padding."""
    place: tuple[Any, ...]
    """Its place in the whole array: slices, or indices lane by lane."""

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
        """Return the results of the call by key, without padding."""
        return {
            part.array.key: np.asarray(outputs[part.number])[tuple(map(slice, part.lengths))]
            for part in self.parts
        }


def shape_of(dims: Sequence[int], grid: SweepGrid) -> tuple[int, ...]:
    """Return the lengths of some dimensions."""
    return tuple(grid.shape[d] for d in dims)


def blocks_of(
    groups: Sequence[Group], grid: SweepGrid, most: int, order: Order | None = None
) -> Iterator[Block]:
    """Yield all blocks of all groups, each of at most `most` lanes."""
    numbers = itertools.count()
    for group in groups:
        many = math.prod(shape_of(group.dims, grid)) > most and not group.flags
        if order is not None and many:
            yield from _blocks_in_order(group, grid, most, order(group), numbers)
        else:
            yield from _in_place(group, grid, most, numbers)


def _in_place(group: Group, grid: SweepGrid, most: int, numbers: Iterator[int]) -> Iterator[Block]:
    shape = shape_of(group.dims, grid)
    # Arrays along separate dimensions need no division: none has the size of the product.
    block = divide(shape, math.prod(shape) if group.apart else most)
    inputs = [grid.inputs[i] for i in group.inputs]

    def arguments(place: tuple[slice, ...]) -> list[np.ndarray]:
        pieces = dict(zip(group.dims, zip(place, block, strict=True), strict=True))
        return [i.values if i.dim is None else pad(i.values, *pieces[i.dim]) for i in inputs]

    for place in places_of(shape, block):
        along = dict(zip(group.dims, place, strict=True))
        parts = [
            Part(
                number,
                array,
                tuple(along[d].stop - along[d].start for d in array.dims),
                tuple(along[d] for d in array.dims),
            )
            for number, array in enumerate(group.arrays)
            # Arrays that do not vary along a dimension are computed by its first block.
            if all(along[d].start == 0 for d in group.dims if d not in array.dims)
        ]
        yield Block(next(numbers), group.grid, functools.partial(arguments, place), parts, place)


def _blocks_in_order(
    group: Group, grid: SweepGrid, most: int, order: np.ndarray, numbers: Iterator[int]
) -> Iterator[Block]:
    lanes = divide((len(order),), most)
    shape = shape_of(group.dims, grid)
    inputs = [grid.inputs[i] for i in group.inputs]

    def places(lanes: np.ndarray) -> dict[int, np.ndarray]:
        return dict(zip(group.dims, np.unravel_index(lanes, shape), strict=True))

    def arguments(piece: slice) -> list[np.ndarray]:
        at = places(pad(order, piece, lanes[0]))
        return [i.values if i.dim is None else i.values[at[i.dim]] for i in inputs]

    for (piece,) in places_of((len(order),), lanes):
        at = places(order[piece])
        parts = [
            Part(number, array, (piece.stop - piece.start,), tuple(at[d] for d in array.dims))
            for number, array in enumerate(group.arrays)
        ]
        yield Block(next(numbers), group.lanes, functools.partial(arguments, piece), parts)


@dataclass(frozen=True)
class Workers:
    """The devices of this process, and its place among the processes."""

    devices: tuple[Any, ...] = ()
    """Empty for JAX's default device."""
    process: int = 0
    processes: int = 1

    @property
    def ahead(self) -> int:
        """Number of blocks to start before the first is read, so that every device has work."""
        return max(len(self.devices), self.threads)

    @property
    def threads(self) -> int:
        """Number of threads that start blocks. A CPU may compute in the caller's thread."""
        devices = self.devices or jax.local_devices()[:1]
        if any(device.platform != "cpu" for device in devices):
            return 1
        return len(self.devices) or os.cpu_count() or 1

    def place(self, turn: int, arguments: Sequence[np.ndarray]) -> Sequence[Any]:
        """Return the arguments of this process's block number `turn`, on the next device."""
        if not self.devices:
            return arguments
        return jax.device_put(arguments, self.devices[turn % len(self.devices)])

    def exchange(
        self, mine: Sequence[np.ndarray], forms: Sequence[Sequence[jax.ShapeDtypeStruct]]
    ) -> list[list[np.ndarray]]:
        """Return the arrays of every process, bit for bit; `forms` describes each one's arrays."""
        if self.processes == 1:
            return [list(mine)]
        from jax.experimental import multihost_utils

        # As bytes: arrays of any shape and type, without rounding or conversion.
        longest = max(sum(map(_bytes, form)) for form in forms)
        buffer = np.zeros(longest, np.uint8)
        sent = b"".join(np.ascontiguousarray(array).tobytes() for array in mine)
        buffer[: len(sent)] = np.frombuffer(sent, np.uint8)
        rows = np.asarray(multihost_utils.process_allgather(buffer))
        return [_unpack(row, form) for row, form in zip(rows, forms, strict=True)]

    def meet(self, where: str) -> None:
        """Wait for all processes."""
        if self.processes > 1:
            from jax.experimental import multihost_utils

            multihost_utils.sync_global_devices(f"jaxcontact: {where}")


def workers_of(mesh: jax.sharding.Mesh | None) -> Workers:
    """Return the devices of `mesh` in this process, and the processes of JAX."""
    if not isinstance(mesh, jax.sharding.Mesh | None):
        raise refusal("mesh", "be a `jax.sharding.Mesh` (see `jax.make_mesh`)", mesh)
    devices = () if mesh is None else tuple(mesh.local_devices)
    if mesh is not None and not devices:
        raise ValueError(
            "Argument `mesh` must have a device of every process, but has none of process "
            f"{jax.process_index()}."
        )
    return Workers(devices, jax.process_index(), jax.process_count())


def _bytes(form: jax.ShapeDtypeStruct) -> int:
    return math.prod(form.shape) * form.dtype.itemsize


def _unpack(row: np.ndarray, forms: Sequence[jax.ShapeDtypeStruct]) -> list[np.ndarray]:
    parts = np.split(row, list(itertools.accumulate(map(_bytes, forms))))
    return [p.view(f.dtype).reshape(f.shape) for p, f in zip(parts, forms, strict=False)]
