"""The motion of a scene as another engine computed it."""

from __future__ import annotations

import dataclasses
import os
from typing import BinaryIO, TextIO

import numpy as np
from jaxtyping import Float

from .bodies.scene import Scene
from .readout.columns import state_columns, write_csv


@dataclasses.dataclass(frozen=True, kw_only=True)
class EngineRun:
    """The motion of a scene at the output times of another engine, as `read_run` returns it.

    `time` (T,) in s, `position` (T, N, D) in m, `velocity` (T, N, D) in m/s and `spin` in rad/s are
    those of `Run`, as is `to_csv`; `jc.plot.scene` and `jc.plot.energy` draw both. `energy` (T,) in
    J is kinetic and gravitational; that stored in contacts is not in it. An engine reports no
    impacts, and there is no state between the output times.
    """

    engine: str
    time: Float[np.ndarray, " T"]
    position: Float[np.ndarray, "T N D"]
    velocity: Float[np.ndarray, "T N D"]
    energy: Float[np.ndarray, " T"]
    spin: Float[np.ndarray, "T N ..."] | None
    scene: Scene

    @property
    def reached(self) -> float:
        """The last output time in s."""
        return float(self.time[-1])

    def to_csv(self, path: str | os.PathLike[str] | TextIO | BinaryIO) -> None:
        """Write a CSV table with a row for each time, with the columns of `Run.to_csv`.

        `path` is an open file or a file name. A named file appears whole or not at all.
        """
        write_csv(state_columns(self), path)

    def __repr__(self) -> str:
        count, spheres, dimensions = self.position.shape
        return (
            f"EngineRun({self.engine}; {count} times to {self.reached:g} s; spheres: {spheres} in "
            f"{dimensions}D)"
        )
