"""What is seen in a track, as plain data."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

Floats = Float[np.ndarray, " n"]


@dataclasses.dataclass(frozen=True, eq=False)
class Frames:
    """The places of one ball, in order: `time` (n,) in s; `height` (n,) upwards and `along` (n,),
    None where it was not tracked, in the lengths of the file, whose `unit` is "" where it is not
    written. `row` (n,) are its rows; `sign` is -1 where the heights of the file count downwards.
    """

    time: Floats
    height: Floats
    along: Floats | None
    row: np.ndarray
    sign: int = 1
    unit: str = ""


class Camera(NamedTuple):
    """What a known gravity says of the camera: the `fall` in lengths of the file per s², and its
    standard error; the angle `tilt` in radians from the vertical of the picture to that of gravity,
    towards positive x where positive, with its error; None without x.
    """

    fall: float
    fall_error: float
    tilt: float | None
    tilt_error: float | None


@dataclasses.dataclass(frozen=True, eq=False)
class Drop:
    """The flights of one drop: m + 1 flights, and the m impacts between them.

    `start` and `end` (m + 1,) in s of flights: of the first and of the last those of the whole
    parabola, of which the track has a part. `covariance` (m + 1, m + 1) of their durations in s².
    `impact` (m,) in s, in the middle of each contact, with its standard `error` (m,), and `floor`
    (m,), its height. `camera`; `air` with β = (g/v)² in 1/s² for the terminal speed v and its
    error, None where the drag was given; `rise`, what the floor rises in the picture in lengths of
    the file per s, and `growth`, what heights above it grow, in 1/s, with their errors; the errors
    of one place, `noise`, in lengths of the file along and up. `used` (n,) are the frames that were
    fitted and `off` (n,) those within the flights that lie too far off. `fitted` (n,) and
    `fitted_along` (n,) are the places that the parabolas have in each frame, NaN outside of the
    flights. `vector` is where the search ended.
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
    """The track of one ball: its `frames`, the `drops` that were found, `skipped` impacts."""

    frames: Frames
    drops: tuple[Drop, ...]
    skipped: tuple[Skipped, ...]
