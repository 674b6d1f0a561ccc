"""The parabolas of successive flights, in picture lengths, with their derivatives.

Flight j lasts from s_j to e_j. Its height above the floor is a H(t - s_j, e_j - s_j), with H(τ, T)
= τ (T - τ)/2 in vacuum and a the acceleration in the picture.

Quadratic drag with terminal speed v adds β h(τ, T), β = (g/v)², to first order with h = -T⁴ x (1 -
|x|³)/192, x = 2τ/T - 1: the way down takes longer than the way up.

A ball that comes nearer looks larger, and its floor lower. The floor rises in the picture by σ in
each second, as a floor that is not level does. Heights above it grow by the relative rate γ.

Impact j with midpoint c_j separates flight j - 1, which ends at c_j - t_j/2, from flight j, which
begins at c_j + t_j/2. Contacts at speeds v_j last t_j = t_c (v_j/v_1)^(-p), with p = 1/5 by Hertz
and p nearer to 0 for shells.

Along the floor a ball drifts at a speed that changes in impacts. Drag adds β T² (1 - |x|³)/48 to
the fraction τ/T of the way. A camera rolled by the angle θ shows the height η and the drift ξ as η
cos θ + ξ sin θ upwards and ξ cos θ - η sin θ along.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import ClassVar, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ..signals import Doubtful

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


@dataclasses.dataclass(frozen=True, eq=False)
class Track:
    """The track of one ball: its `frames`, the detected `drops`, and `skipped` impacts."""

    frames: Frames
    drops: tuple[Drop, ...]
    skipped: tuple[Doubtful, ...]


Shape = Callable[[Floats, Floats], tuple[Floats, Floats, Floats]]
"""H of τ and T, ∂H/∂τ and ∂H/∂T, all (n,) in s² and s."""


def parabola(since: Floats, whole: Floats) -> tuple[Floats, Floats, Floats]:
    """Return H in vacuum."""
    return since * (whole - since) / 2, whole / 2 - since, since / 2


def slowed(since: Floats, whole: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the first-order contribution of drag to H, over β."""
    x = 2 * since / whole - 1
    size = np.abs(x) ** 3
    by_x = -(whole**4) * (1 - 4 * size) / 192
    value = -(whole**4) * x * (1 - size) / 192
    return value, by_x * 2 / whole, 4 * value / whole - by_x * (1 + x) / whole


def lagging(since: Floats, whole: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the contribution of drag to the fraction of a way along the floor, over β."""
    x = 2 * since / whole - 1
    value = whole**2 * (1 - np.abs(x) ** 3) / 48
    by_x = -(whole**2) * x * np.abs(x) / 16
    return value, by_x * 2 / whole, 2 * value / whole - by_x * (1 + x) / whole


class _Offset:
    """The position of a parameter, `after` places behind the number of flights."""

    def __init__(self, after: int):
        self.after = after

    def __get__(self, model: Model, owner: type[Model]) -> int:
        return model.flights + self.after


@dataclasses.dataclass(frozen=True)
class Model:
    """Positions of the parameters of `flights` flights in a vector.

    The order is: start of the first flight, impacts, end of the last; contact time t_c, and p;
    floor and acceleration halfway between `first` and `last`; β; σ and γ. With `along` follow the
    tilt and the positions along the floor at `first`, at the impacts, and at `last`. `speeds`
    (flights - 1,) are v_j/v_1. A known `shape`, with its `beta`, replaces H and the contribution of
    β.
    """

    flights: int
    along: bool
    first: float
    last: float
    speeds: Floats
    shape: Shape | None = None
    beta: float = 0.0

    contact: ClassVar[_Offset] = _Offset(1)
    power: ClassVar[_Offset] = _Offset(2)
    floor: ClassVar[_Offset] = _Offset(3)
    fall: ClassVar[_Offset] = _Offset(4)
    air: ClassVar[_Offset] = _Offset(5)
    rise: ClassVar[_Offset] = _Offset(6)
    growth: ClassVar[_Offset] = _Offset(7)
    tilt: ClassVar[_Offset] = _Offset(8)

    @property
    def size(self) -> int:
        return self.tilt + self.along * (self.flights + 2)

    def beta_of(self, vector: Floats) -> float:
        """Return β in 1/s²."""
        return float(vector[self.air]) if self.shape is None else self.beta

    def ends(
        self, vector: Floats
    ) -> tuple[Float[np.ndarray, "flights two"], Float[np.ndarray, "flights two size"]]:
        """Return start and end of each flight, and their derivatives."""
        slope = np.zeros((self.flights, 2, self.size))
        j = np.arange(self.flights)
        slope[j, 0, j] = slope[j, 1, j + 1] = 1.0
        half = self.speeds ** -vector[self.power] / 2
        by_power = -vector[self.contact] * half * np.log(self.speeds)
        slope[1:, 0, self.contact], slope[:-1, 1, self.contact] = half, -half
        value = slope @ vector  # linear except for the power, whose slope is added below
        slope[1:, 0, self.power], slope[:-1, 1, self.power] = by_power, -by_power
        return value, slope

    def flight_of(self, vector: Floats, time: Floats) -> np.ndarray:
        """Return the number of the flight in which each time lies."""
        return np.searchsorted(vector[1 : self.flights], time)

    def places(
        self, vector: Floats, time: Floats
    ) -> tuple[Float[np.ndarray, "n axes"], Float[np.ndarray, "n axes size"]]:
        """Return heights and positions along the floor (n, 1 or 2), and their derivatives."""
        n, flight = time.size, self.flight_of(vector, time)
        ends, ends_slope = self.ends(vector)
        start, end = ends.T
        since, whole = time - start[flight], (end - start)[flight]
        later, slope = time - (self.first + self.last) / 2, np.zeros((n, self.size))
        size = 1 + vector[self.growth] * later
        fall = vector[self.fall] * size
        if self.shape is None:
            plain, more, beta = parabola(since, whole), slowed(since, whole), self.beta_of(vector)
            shape, by_since, by_whole = (a + beta * b for a, b in zip(plain, more, strict=True))
            slope[:, self.air] = fall * more[0]
        else:
            shape, by_since, by_whole = self.shape(since, whole)
        height = vector[self.floor] + vector[self.rise] * later + fall * shape
        slope += (-fall * (by_since + by_whole))[:, None] * ends_slope[flight, 0]
        slope += (fall * by_whole)[:, None] * ends_slope[flight, 1]
        slope[:, self.floor], slope[:, self.fall] = 1.0, size * shape
        slope[:, self.rise], slope[:, self.growth] = later, vector[self.fall] * later * shape
        if not self.along:
            return height[:, None], slope[:, None]
        drift, drift_slope = self._drift(vector, time, flight, ends, ends_slope)
        cos, sin = np.cos(vector[self.tilt]), np.sin(vector[self.tilt])
        up, right = height * cos + drift * sin, drift * cos - height * sin
        up_slope = slope * cos + drift_slope * sin
        right_slope = drift_slope * cos - slope * sin
        up_slope[:, self.tilt], right_slope[:, self.tilt] = right, -up
        return np.stack([up, right], axis=1), np.stack([up_slope, right_slope], axis=1)

    def _drift(
        self,
        vector: Floats,
        time: Floats,
        flight: np.ndarray,
        ends: Float[np.ndarray, "flights two"],
        ends_slope: Float[np.ndarray, "flights two size"],
    ) -> tuple[Floats, Float[np.ndarray, "n size"]]:
        knots = np.concatenate([[self.first], vector[1 : self.flights], [self.last]])
        beta = self.beta_of(vector)
        start, end = ends.T
        now = _way(time, start[flight], end[flight], beta)
        low, high = _way(knots[:-1], start, end, beta), _way(knots[1:], start, end, beta)
        length = (high.value - low.value)[flight]
        part = (now.value - low.value[flight]) / length
        at = self.tilt + 1 + flight
        change = (vector[at + 1] - vector[at]) / length

        def by(name: str) -> Floats:
            a, b = getattr(low, name)[flight], getattr(high, name)[flight]
            return change * (getattr(now, name) - (1 - part) * a - part * b)

        slope, rows = np.zeros((time.size, self.size)), np.arange(time.size)
        slope += by("by_start")[:, None] * ends_slope[flight, 0]
        slope += by("by_end")[:, None] * ends_slope[flight, 1]
        slope[rows, at], slope[rows, at + 1] = 1 - part, part
        if self.shape is None:
            slope[:, self.air] = by("by_beta")
        # The knots between the ends are impacts, which move.
        inner = flight > 0
        slope[rows[inner], flight[inner]] -= (change * (1 - part) * low.by_time[flight])[inner]
        inner = flight < self.flights - 1
        slope[rows[inner], flight[inner] + 1] -= (change * part * high.by_time[flight])[inner]
        return vector[at] + (vector[at + 1] - vector[at]) * part, slope


class _FlightFraction(NamedTuple):
    """The fraction of its flight that a ball has completed along the floor, and the derivatives."""

    value: Floats
    by_time: Floats
    by_start: Floats
    by_end: Floats
    by_beta: Floats


def _way(time: Floats, start: Floats, end: Floats, beta: float) -> _FlightFraction:
    since, whole = time - start, end - start
    more, by_since, by_whole = lagging(since, whole)
    by_time = 1 / whole + beta * by_since
    by_end = -since / whole**2 + beta * by_whole
    return _FlightFraction(since / whole + beta * more, by_time, -by_time - by_end, by_end, more)
