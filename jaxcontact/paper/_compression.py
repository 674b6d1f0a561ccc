"""The compression of a solved impact as a curve v(δ), and the sample points of a regression."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from ._impacts import MASS, SolvedImpacts

Sampling = Literal["indentation", "time", "velocity squared"]

SAMPLINGS: tuple[Sampling, ...] = ("indentation", "time", "velocity squared")


class Compression(NamedTuple):
    """Compression from touch to turn: times in s, δ in m, δ' in m/s, and a spline of δ'²."""

    time: np.ndarray
    indentation: np.ndarray
    velocity: np.ndarray
    square: CubicHermiteSpline

    @property
    def max_indentation(self) -> float:
        """δ_m, in m."""
        return float(self.indentation[-1])

    def velocity_at(self, indentation: np.ndarray) -> np.ndarray:
        """Return δ' in m/s; exactly zero at the turn, where rounding errors would remain."""
        square = np.maximum(self.square(indentation), 0)
        return np.sqrt(np.where(indentation < self.max_indentation, square, 0))

    def positions(self, sampling: Sampling, intervals: int) -> np.ndarray:
        """Return `intervals` + 1 values of δ in m from touch to turn, spaced equally in `sampling`.

        Their positions come from linear interpolation, whose error moves a sample along the curve
        only.
        """
        if sampling == "indentation":
            return np.linspace(0, self.max_indentation, intervals + 1)
        scale = self.time if sampling == "time" else -np.square(self.velocity)
        equal = np.linspace(scale[0], scale[-1], intervals + 1)
        return np.interp(equal, scale, self.indentation)


def compression(impacts: SolvedImpacts, case: int) -> Compression:
    """Return the compression of one case: the samples before the turn, and the turn."""
    deepest = float(impacts.max_indentation[case])
    moment = float(impacts.compression_time[case])
    # The turn is that of the closed form; the samples match it to the tolerance of their solve.
    before = (impacts.time[case] < moment) & (impacts.indentation[case] < deepest)

    def with_turn(samples: np.ndarray, turn: float) -> np.ndarray:
        return np.append(samples[case][before], turn)

    time = with_turn(impacts.time, moment)
    depth = with_turn(impacts.indentation, deepest)
    speed = with_turn(impacts.velocity, 0.0)
    force = with_turn(impacts.force, float(impacts.turning_force[case]))
    # δ'² is smooth in δ at the turn, while δ' is not. Its slope is known: d(δ'²)/dδ = 2 δ'' = -2
    # F/m.
    return Compression(time, depth, speed, CubicHermiteSpline(depth, speed**2, -2 * force / MASS))
