"""Flight between two impacts: times and heights against speeds, with and without drag.

The drag is quadratic, F = ½ ρ C_d π R² v², so a falling ball tends to the terminal speed
v_t = sqrt(2 m g/(ρ C_d π R²)). With s = u/v_t for a launch speed u (up: v' = -g (1 + v²/v_t²),
down: v' = g (1 - v²/v_t²)):

    height          h = v_t²/(2g) ln(1 + s²)
    time up         v_t/g atan(s)
    landing speed   w = u/sqrt(1 + s²)
    time down       v_t/g atanh(w/v_t) = v_t/g asinh(s)

Plain numpy in double precision: this prepares measurements and is never differentiated, so it must
not depend on the precision JAX happens to be set to.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

STANDARD_GRAVITY = 9.81
AIR_DENSITY = 1.204

_NEWTON_STEPS = 60
_NEWTON_TOLERANCE = 1e-15

Floats = NDArray[np.float64]


def require_positive(name: str, value: float) -> None:
    """Raise ValueError unless `value` is positive and finite; `name` is the argument it came as."""
    if not (value > 0 and math.isfinite(value)):
        raise ValueError(f"Argument `{name}` must be positive and finite, but is {value!r}.")


@dataclasses.dataclass(frozen=True)
class Drag:
    """Quadratic drag of a ball: mass in kg, radius in m, drag coefficient, air density in kg/m³.

    Raises ValueError unless all four are positive and finite.
    """

    mass: float
    radius: float
    coefficient: float
    air_density: float = AIR_DENSITY

    def __post_init__(self) -> None:
        for name, value in dataclasses.asdict(self).items():
            require_positive(name, value)

    def terminal_speed(self, gravity: float) -> float:
        """v_t = sqrt(2 m g/(ρ C_d π R²)) in m/s."""
        area = math.pi * self.radius**2
        return math.sqrt(2 * self.mass * gravity / (self.air_density * self.coefficient * area))


@dataclasses.dataclass(frozen=True)
class Flight:
    """Free flight over a level floor, in vacuum (`drag` None) or with quadratic drag.

    Every method takes floats or arrays and returns float64 of the same shape. Raises ValueError
    unless `gravity` (m/s²) is positive and finite.
    """

    gravity: float = STANDARD_GRAVITY
    drag: Drag | None = None

    def __post_init__(self) -> None:
        require_positive("gravity", self.gravity)

    @property
    def terminal_speed(self) -> float:
        """Terminal speed in m/s; infinite in vacuum."""
        return math.inf if self.drag is None else self.drag.terminal_speed(self.gravity)

    def duration(self, launch: ArrayLike) -> Floats:
        """Time in s from a launch at speed `launch` (m/s) to the landing."""
        u = np.asarray(launch, dtype=np.float64)
        if self.drag is None:
            return 2 * u / self.gravity
        s = u / self.terminal_speed
        return self.terminal_speed / self.gravity * (np.arctan(s) + np.arcsinh(s))

    def landing_speed(self, launch: ArrayLike) -> Floats:
        """Speed in m/s at which a ball launched at `launch` (m/s) comes down again."""
        u = np.asarray(launch, dtype=np.float64)
        return u / np.sqrt(1 + (u / self.terminal_speed) ** 2)

    def launch_speed(self, duration: ArrayLike) -> Floats:
        """Launch speed in m/s of a flight of `duration` s: the inverse of `duration`.

        Newton's method inside a bracket; the flight time is a rising, concave function of the
        speed, so a step from below never overshoots and the bracket is a safeguard for rounding.
        """
        time = np.asarray(duration, dtype=np.float64)
        vacuum = self.gravity * time / 2
        if self.drag is None:
            return vacuum
        # In vacuum a flight of given duration needs the lower speed: drag shortens the flight.
        low, speed = vacuum.copy(), vacuum.copy()
        # asinh alone bounds the flight time from below, so its inverse bounds the speed from above.
        high = self.terminal_speed * np.sinh(time * self.gravity / self.terminal_speed)
        for _ in range(_NEWTON_STEPS):
            error = self.duration(speed) - time
            low = np.where(error < 0, speed, low)
            high = np.where(error > 0, speed, high)
            step = speed - error / self._duration_slope(speed)
            inside = (step >= low) & (step <= high)
            new = np.where(inside, step, (low + high) / 2)
            if np.all(np.abs(new - speed) <= _NEWTON_TOLERANCE * speed):
                return new
            speed = new
        return speed

    def log_slopes(self, duration: ArrayLike) -> tuple[Floats, Floats]:
        """d ln(launch speed)/d ln T and d ln(landing speed)/d ln T at T s; both 1 in vacuum."""
        time = np.asarray(duration, dtype=np.float64)
        speed = self.launch_speed(time)
        launch = time / (speed * self._duration_slope(speed))
        return launch, launch / (1 + (speed / self.terminal_speed) ** 2)

    def speed_after_drop(self, height: ArrayLike) -> Floats:
        """Landing speed in m/s of a ball dropped at rest from `height` m."""
        h = np.asarray(height, dtype=np.float64)
        if self.drag is None:
            return np.sqrt(2 * self.gravity * h)
        return self.terminal_speed * np.sqrt(-np.expm1(-self._height_exponent(h)))

    def speed_to_reach(self, height: ArrayLike) -> Floats:
        """Launch speed in m/s that carries the ball to `height` m."""
        h = np.asarray(height, dtype=np.float64)
        if self.drag is None:
            return np.sqrt(2 * self.gravity * h)
        return self.terminal_speed * np.sqrt(np.expm1(self._height_exponent(h)))

    def _height_exponent(self, height: Floats) -> Floats:
        return 2 * self.gravity * height / self.terminal_speed**2

    def _duration_slope(self, launch: Floats) -> Floats:
        square = (launch / self.terminal_speed) ** 2
        return (1 / (1 + square) + 1 / np.sqrt(1 + square)) / self.gravity
