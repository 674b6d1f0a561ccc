"""Motion between two contacts, under gravity g and quadratic drag: v' = -g (1 + b v |v|).

b = 1/v_t², in s²/m², is proportional to the drag coefficient; v_t is the terminal speed. Every
formula is that of vacuum times a factor that is analytic in b and 1 at b = 0, so derivatives exist
in vacuum too. With b = None only the vacuum formula is computed. Speeds are in m/s, times in s,
heights in m and g in m/s²; all shapes broadcast.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from ._entry import POSITIVE, require_kind, require_number
from ._functions import horner, implicit_root, kappa, log1p_over, sinc_root

STANDARD_GRAVITY = 9.81
AIR_DENSITY = 1.204

Floats = NDArray[np.float64]
Lane = Float[Array, "..."]
Rate = Lane | None
"""b in s²/m², or None in vacuum."""

_SHORTEST = 256
"""Arrays of up to this length share one compiled function."""

_NEAR = 0.1
# Powers of z = s²; the first omitted term is below half an ulp of float64 at `_NEAR`.
_ATAN_SERIES = tuple((-1) ** k / (2 * k + 1) for k in range(16))
_ASINH_SERIES = tuple((-1) ** k * math.comb(2 * k, k) / 4**k / (2 * k + 1) for k in range(16))


@dataclasses.dataclass(frozen=True)
class Drag:
    """Quadratic drag F = ½ ρ C_d π R² v² of a ball.

    `mass` m in kg, `radius` R in m, drag `coefficient` C_d, `air_density` ρ in kg/m³. Raises
    ValueError unless all four are positive and finite.
    """

    mass: float
    radius: float
    coefficient: float
    air_density: float = AIR_DENSITY

    def __post_init__(self) -> None:
        for name, value in vars(self).copy().items():
            object.__setattr__(self, name, require_number(name, value, POSITIVE))

    def terminal_speed(self, gravity: float) -> float:
        """Return v_t = sqrt(2 m g/(ρ C_d π R²)) in m/s."""
        gravity = require_number("gravity", gravity, POSITIVE)
        area = math.pi * self.radius**2
        return math.sqrt(2 * self.mass * gravity / (self.air_density * self.coefficient * area))


@dataclasses.dataclass(frozen=True)
class Flight:
    """Flights over a level floor: gravity in m/s², and the drag (None for vacuum).

    Its formulas take speeds, times or heights, g, and b (None in vacuum); `evaluate` those of it.

    Raises ValueError unless `gravity` is positive and finite, and `drag` a `Drag` or None.
    """

    gravity: float = STANDARD_GRAVITY
    drag: Drag | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "gravity", require_number("gravity", self.gravity, POSITIVE))
        if self.drag is not None:
            require_kind("drag", self.drag, Drag, "a `Drag` or None")

    @property
    def terminal_speed(self) -> float:
        """Terminal speed in m/s; infinite in vacuum."""
        return math.inf if self.drag is None else self.drag.terminal_speed(self.gravity)

    @property
    def rate(self) -> float | None:
        """b = 1/v_t² in s²/m²; None in vacuum."""
        return None if self.drag is None else self.terminal_speed**-2

    def evaluate(
        self, formula: Callable[[Lane, Lane, Rate], Lane], values: Floats
    ) -> tuple[Floats, Floats]:
        """Return y = `formula(values, gravity, b)` and d ln y/d ln x at values x (n,), float64
        (n,).

        The result does not depend on JAX's precision setting.
        """
        # Padding to powers of two lets recordings of all lengths share a few compiled functions.
        x = np.ones(max(_SHORTEST, 1 << (len(values) - 1).bit_length()))
        x[: len(values)] = values
        with jax.enable_x64(True):
            pair = _with_log_slope(formula, x, np.float64(self.gravity), self.rate)
        return np.array(pair[0])[: len(values)], np.array(pair[1])[: len(values)]

    @staticmethod
    def duration(launch: Lane, gravity: Lane, b: Rate) -> Lane:
        """Return the time from a launch to the landing: (atan s + asinh s)/(g √b), s = √b u."""
        vacuum = 2 * launch / gravity
        return vacuum if b is None else vacuum * _duration_factor(b * jnp.square(launch))

    @staticmethod
    def launch_speed(time: Lane, gravity: Lane, b: Rate) -> Lane:
        """Return the launch speed of a flight that lasts `time`: the inverse of `duration`."""
        vacuum = gravity * time / 2
        return vacuum if b is None else vacuum * _launch_factor(b * jnp.square(vacuum))

    @staticmethod
    def landing_speed(launch: Lane, gravity: Lane, b: Rate) -> Lane:
        """Return the landing speed after a launch at u: u/√(1 + b u²), for any gravity."""
        return launch if b is None else launch / jnp.sqrt(1 + b * jnp.square(launch))

    @staticmethod
    def speed_after_drop(height: Lane, gravity: Lane, b: Rate) -> Lane:
        """Return the landing speed of a fall from rest at h: w² = (1 - e^(-2 g h b))/b."""
        square = 2 * gravity * height
        return jnp.sqrt(square if b is None else square * kappa(-b * square))

    @staticmethod
    def speed_to_reach(height: Lane, gravity: Lane, b: Rate) -> Lane:
        """Return the launch speed of a flight that rises to h: u² = (e^(2 g h b) - 1)/b."""
        square = 2 * gravity * height
        return jnp.sqrt(square if b is None else square * kappa(b * square))

    @staticmethod
    def height_reached(launch: Lane, gravity: Lane, b: Rate) -> Lane:
        """Return the height of a flight launched at u = `launch`: ln(1 + b u²)/(2 g b)."""
        square = jnp.square(launch)
        vacuum = square / (2 * gravity)
        return vacuum if b is None else vacuum * log1p_over(b * square)

    @staticmethod
    def time_to_fall(height: Lane, gravity: Lane, b: Rate) -> Lane:
        """Return the time of a fall from rest at h = `height`: acosh(e^(g h b))/(g √b)."""
        if b is None:
            return jnp.sqrt(2 * height / gravity)
        speed = Flight.speed_to_reach(height, gravity, b)
        return speed / gravity * _over_root(jnp.arcsinh, _ASINH_SERIES, b * jnp.square(speed))

    @staticmethod
    def height_after(time: Lane, launch: Lane, gravity: Lane, b: Rate) -> Lane:
        """Return the height above the launch at `time` ≥ 0 after it; negative below the launch.

        The rise lasts t_up = atan(s)/(g √b), s = √b u, with ln(cos θ + s sin θ)/(g b), θ = √b g t.
        The fall from the height reached is ln cosh(√b g (t - t_up))/(g b). In vacuum the height is
        t (u - g t/2).
        """
        if b is None:
            return time * (launch - gravity * time / 2)
        top = launch / gravity * _over_root(jnp.arctan, _ATAN_SERIES, b * jnp.square(launch))
        up, down = jnp.minimum(time, top), jnp.maximum(time - top, 0)
        # 1 - cos θ = 2 sin²(θ/2) keeps the digits of short times.
        angle = b * jnp.square(gravity * up)
        half = gravity * up / 2 * jnp.square(sinc_root(angle / 4))
        rise = up * (launch * sinc_root(angle) - half)
        fall = gravity * jnp.square(down) / 2 * _fall_factor(b * jnp.square(gravity * down))
        return rise * log1p_over(b * gravity * rise) - fall


@functools.partial(jax.jit, static_argnums=0)
def _with_log_slope(
    formula: Callable[[Lane, Lane, Rate], Lane], x: Lane, gravity: Lane, b: Rate
) -> tuple[Lane, Lane]:
    y, slope = jax.jvp(lambda x: formula(x, gravity, b), (x,), (x,))
    return y, slope / y


def _over_root(inverse: Callable[[Lane], Lane], series: Sequence[float], z: Lane) -> Lane:
    """Return inverse(√z)/√z for atan or asinh, with the value 1 at z = 0."""
    near = z < _NEAR
    s = jnp.sqrt(jnp.where(near, 1, z))
    return jnp.where(near, horner(series, jnp.where(near, z, 0)), inverse(s) / s)


def _duration_factor(z: Lane) -> Lane:
    """Return the flight duration over that in vacuum, at z = b u²: (atan √z + asinh √z)/(2√z)."""
    up = _over_root(jnp.arctan, _ATAN_SERIES, z)
    return (up + _over_root(jnp.arcsinh, _ASINH_SERIES, z)) / 2


def _fall_factor(z: Lane) -> Lane:
    """Return the distance of a fall over that in vacuum, 2 ln(cosh √z)/z, at z = b (g t)²."""
    near = z < 1
    z_near = jnp.where(near, z, 0)
    # cosh² = 1 + sinh².
    square = jnp.square(sinc_root(-z_near))
    w = jnp.sqrt(jnp.where(near, 1, z))
    far = 2 * (w + jnp.log1p(jnp.exp(-2 * w)) - math.log(2)) / jnp.square(w)
    return jnp.where(near, square * log1p_over(z_near * square), far)


def _launch_factor_guess(q: Lane) -> Lane:
    # With √b u = sinh y the time is y + atan(sinh y), whose slope is between 1 and 2. Newton steps
    # from below therefore never overshoot, for any drag; three steps leave an error of 2e-10.
    positive = q > 0
    p = jnp.sqrt(jnp.where(positive, q, 1))
    y = p
    for _ in range(3):
        s = jnp.sinh(y)
        y = y - (y + jnp.arctan(s) - 2 * p) / (1 + 1 / jnp.cosh(y))
    return jnp.where(positive, jnp.sinh(y) / p, 1)


_launch_factor = implicit_root(
    lambda x, q: x * _duration_factor(q * jnp.square(x)) - 1, _launch_factor_guess, iterations=1
)
"""Launch speed over that in vacuum, at q = b (g T/2)²."""
