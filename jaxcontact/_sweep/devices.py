"""Distribution of blocks: processes take them in turn, as do the devices of a process.

A block is computed completely on one device, by the program for one device. A program that XLA
partitions over devices is fused differently, and its last digits differ. Therefore the number of
devices changes no result, and no lane waits for a slower one on another device.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

from .._entry import rendered


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
        return max(len(self.devices), 1)

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
        raise ValueError(
            f"Argument `mesh` must be a `jax.sharding.Mesh` (see `jax.make_mesh`), but is "
            f"{rendered(mesh)}."
        )
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
