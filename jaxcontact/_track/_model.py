"""The parabolas of successive flights, in the lengths of a picture, with their derivatives.

Flight j lasts from s_j to e_j, and its height above the floor is a H(t - s_j, e_j - s_j), in vacuum
with H(τ, T) = τ (T - τ)/2 and the fall a of the picture. Impact j in its middle c_j parts flight
j - 1, which ends at c_j - t_j/2, from flight j, which begins at c_j + t_j/2. Contacts at speeds v_j
last t_j = t_c (v_j/v_1)^(-p), by Hertz with p = 1/5; shells are nearer to 0. Along the floor a ball
drifts at a speed that changes in impacts only. A camera that is rolled by the angle θ sees the
height η and the drift ξ as η cos θ + ξ sin θ upwards, ξ cos θ - η sin θ along.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from ._seen import Floats

Shape = Callable[[Floats, Floats], tuple[Floats, Floats, Floats]]
"""H of τ and T, ∂H/∂τ and ∂H/∂T, all (n,) in s² and s."""


def parabola(since: Floats, whole: Floats) -> tuple[Floats, Floats, Floats]:
    """H in vacuum."""
    return since * (whole - since) / 2, whole / 2 - since, since / 2


@dataclasses.dataclass(frozen=True)
class Model:
    """Where the parameters of `flights` flights stand in a vector.

    Those are the start of the first flight, the impacts, the end of the last; the duration t_c of
    contact, and p; the floor and the fall; with `along` the tilt, and the places along at `first`,
    at the impacts, and at `last`. `speeds` (flights - 1,) are v_j/v_1.
    """

    flights: int
    along: bool
    first: float
    last: float
    speeds: Floats
    shape: Shape = parabola

    @property
    def contact(self) -> int:
        return self.flights + 1

    @property
    def power(self) -> int:
        return self.flights + 2

    @property
    def floor(self) -> int:
        return self.flights + 3

    @property
    def fall(self) -> int:
        return self.flights + 4

    @property
    def tilt(self) -> int:
        return self.flights + 5

    @property
    def size(self) -> int:
        return self.fall + 1 + self.along * (self.flights + 2)

    def ends(
        self, vector: Floats
    ) -> tuple[Float[np.ndarray, "flights two"], Float[np.ndarray, "flights two size"]]:
        """Start and end of each flight, and their derivatives."""
        slope = np.zeros((self.flights, 2, self.size))
        j = np.arange(self.flights)
        slope[j, 0, j] = slope[j, 1, j + 1] = 1.0
        half = self.speeds ** -vector[self.power] / 2
        by_power = -vector[self.contact] * half * np.log(self.speeds)
        slope[1:, 0, self.contact], slope[:-1, 1, self.contact] = half, -half
        value = slope @ vector  # linear but for the power, whose part is not there yet
        slope[1:, 0, self.power], slope[:-1, 1, self.power] = by_power, -by_power
        return value, slope

    def flight_of(self, vector: Floats, time: Floats) -> np.ndarray:
        """The number of the flight in which each time lies."""
        return np.searchsorted(vector[1 : self.flights], time)

    def places(
        self, vector: Floats, time: Floats, derivatives: bool = True
    ) -> tuple[Float[np.ndarray, "n axes"], Float[np.ndarray, "n axes size"]]:
        """Heights, and with them places along (n, 1 or 2), and their derivatives."""
        n, flight = time.size, self.flight_of(vector, time)
        ends, ends_slope = self.ends(vector)
        start, end = ends.T
        shape, by_since, by_whole = self.shape(time - start[flight], (end - start)[flight])
        fall = vector[self.fall]
        height = vector[self.floor] + fall * shape
        slope = np.zeros((n, self.size))
        slope += (-fall * (by_since + by_whole))[:, None] * ends_slope[flight, 0]
        slope += (fall * by_whole)[:, None] * ends_slope[flight, 1]
        slope[:, self.floor], slope[:, self.fall] = 1.0, shape
        if not self.along:
            return height[:, None], slope[:, None]
        drift, drift_slope = self._drift(vector, time, flight)
        cos, sin = np.cos(vector[self.tilt]), np.sin(vector[self.tilt])
        up, right = height * cos + drift * sin, drift * cos - height * sin
        up_slope = slope * cos + drift_slope * sin
        right_slope = drift_slope * cos - slope * sin
        up_slope[:, self.tilt], right_slope[:, self.tilt] = right, -up
        return np.stack([up, right], axis=1), np.stack([up_slope, right_slope], axis=1)

    def _drift(
        self, vector: Floats, time: Floats, flight: np.ndarray
    ) -> tuple[Floats, Float[np.ndarray, "n size"]]:
        knots = np.concatenate([[self.first], vector[1 : self.flights], [self.last]])
        at = self.tilt + 1 + flight
        low, high = vector[at], vector[at + 1]
        length = (knots[1:] - knots[:-1])[flight]
        part = (time - knots[flight]) / length
        slope, rows = np.zeros((time.size, self.size)), np.arange(time.size)
        slope[rows, at], slope[rows, at + 1] = 1 - part, part
        # The knots between the ends are impacts, which move.
        inner = flight > 0
        slope[rows[inner], flight[inner]] -= ((high - low) * (1 - part) / length)[inner]
        inner = flight < self.flights - 1
        slope[rows[inner], flight[inner] + 1] -= ((high - low) * part / length)[inner]
        return low + (high - low) * part, slope
