"""Results of a track as plain data."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

Floats = Float[np.ndarray, " n"]


@dataclasses.dataclass(frozen=True, eq=False)
class Frames:
    """The positions of one ball in order, in lengths of the file.

    `time` (n,) in s, `height` (n,) upwards, and `along` (n,), None if it was not tracked. `unit` is
    "" if it is not written. `row` (n,) are the rows; `sign` is -1 if the heights of the file count
    downwards.
    """

    time: Floats
    height: Floats
    along: Floats | None
    row: np.ndarray
    sign: int = 1
    unit: str = ""


class Camera(NamedTuple):
    """Camera parameters that follow from known gravity.

    `fall` is the acceleration in lengths of the file per s², with its standard error. `tilt` is the
    angle in radians from the vertical of the picture to that of gravity, positive towards positive
    x, with its error. It is None without x.
    """

    fall: float
    fall_error: float
    tilt: float | None
    tilt_error: float | None


@dataclasses.dataclass(frozen=True, eq=False)
class Drop:
    """The flights of one drop: m + 1 flights, and the m impacts between them.

    `start` and `end` (m + 1,) in s are those of the flights. For the first and the last they belong
    to the whole parabola, of which the track has a part. `covariance` (m + 1, m + 1) is that of the
    durations in s².

    `impact` (m,) in s is the midpoint of each contact, with its standard `error` (m,), and `floor`
    (m,) its height. `camera` holds the camera parameters. `air` is β = (g/v)² in 1/s² for the
    terminal speed v, with its error; None if the drag was given. `rise` is the rate at which the
    floor rises in the picture, in lengths of the file per s. `growth` is the relative rate at which
    heights above it grow, in 1/s. Both have their errors. `noise` is the error of one position
    along and up, in lengths of the file.

    `used` (n,) are the fitted frames, and `off` (n,) those within the flights that lie too far off.
    `fitted` (n,) and `fitted_along` (n,) are the positions on the parabolas in each frame, NaN
    outside the flights. `vector` is the result of the search.
    """

    frames: Frames
    start: Floats
    end: Floats
    covariance: Float[np.ndarray, "f f"]
    impact: Floats
    error: Floats
    floor: Floats
    camera: Camera
    air: tuple[float, float] | None
    rise: tuple[float, float]
    growth: tuple[float, float]
    noise: tuple[float | None, float]
    used: Bool[np.ndarray, " n"]
    off: Bool[np.ndarray, " n"]
    fitted: Floats
    fitted_along: Floats | None
    vector: Floats

    @property
    def seconds(self) -> Floats:
        """Durations of the flights (m + 1,) in s."""
        return self.end - self.start


class Skipped(NamedTuple):
    """An impact that is not used: its time in s, and why."""

    time: float
    why: str


@dataclasses.dataclass(frozen=True, eq=False)
class Track:
    """The track of one ball: its `frames`, the detected `drops`, and `skipped` impacts."""

    frames: Frames
    drops: tuple[Drop, ...]
    skipped: tuple[Skipped, ...]
