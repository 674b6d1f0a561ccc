"""Flight between two impacts as JAX sees it: derivatives by the speeds and by the drag.

The mathematics is that of `_flight`, written in b = 1/v_t², which is proportional to the drag
coefficient. A square root of b would have no derivative in vacuum, so every formula is a function
of b itself: the vacuum's times a factor that is 1 at b = 0. With None for b nothing but the
vacuum's is computed.
"""

from __future__ import annotations

import math

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._elementary import horner, kappa, log1p_over
from .._implicit import implicit_root

Lane = Float[Array, "..."]
Drag = Float[Array, ""] | None
"""b in s²/m², or None in vacuum."""

_NEAR = 0.1
# atan(s)/s and asinh(s)/s in powers of s²; cut below half an ulp of float64 at `_NEAR`.
_TIME_SERIES = tuple(
    (-1) ** k * (1 + math.comb(2 * k, k) / 4**k) / (2 * (2 * k + 1)) for k in range(16)
)


def duration(launch: Lane, gravity: Lane, b: Drag) -> Lane:
    """Time in s of a flight launched at `launch` m/s: (atan s + asinh s)/(g √b), s = √b u."""
    vacuum = 2 * launch / gravity
    return vacuum if b is None else vacuum * _shortened(b * jnp.square(launch))


def launch_speed(time: Lane, gravity: Lane, b: Drag) -> Lane:
    """Launch speed in m/s of a flight of `time` s, the inverse of `duration`."""
    vacuum = gravity * time / 2
    return vacuum if b is None else vacuum * _quickened(b * jnp.square(vacuum))


def landing_speed(launch: Lane, b: Drag) -> Lane:
    """Speed in m/s at which a ball launched at `launch` m/s comes down again: u/√(1 + b u²)."""
    return launch if b is None else launch / jnp.sqrt(1 + b * jnp.square(launch))


def speed_after_drop(height: Lane, gravity: Lane, b: Drag) -> Lane:
    """Landing speed in m/s of a ball dropped at rest from `height` m: w² = (1 - e^(-2 g h b))/b."""
    square = 2 * gravity * height
    return jnp.sqrt(square if b is None else square * kappa(-b * square))


def height_reached(launch: Lane, gravity: Lane, b: Drag) -> Lane:
    """Height in m of a flight launched at `launch` m/s: ln(1 + b u²)/(2 g b)."""
    square = jnp.square(launch)
    vacuum = square / (2 * gravity)
    return vacuum if b is None else vacuum * log1p_over(b * square)


def _shortened(z: Lane) -> Lane:
    """(atan √z + asinh √z)/(2√z), what is left of a flight's time at z = b u²; 1 at z = 0."""
    near = z < _NEAR
    s = jnp.sqrt(jnp.where(near, 1, z))
    far = (jnp.arctan(s) + jnp.arcsinh(s)) / (2 * s)
    return jnp.where(near, horner(_TIME_SERIES, jnp.where(near, z, 0)), far)


def _quickened_residual(x: Lane, q: Lane) -> Lane:
    return x * _shortened(q * jnp.square(x)) - 1


def _quickened_guess(q: Lane) -> Lane:
    # With √b u = sinh y the time is y + atan(sinh y), which rises with a slope between 1 and 2:
    # Newton's steps from below never overshoot, however strong the drag is: three leave 2e-10.
    some = q > 0
    p = jnp.sqrt(jnp.where(some, q, 1))
    y = p
    for _ in range(3):
        s = jnp.sinh(y)
        y = y - (y + jnp.arctan(s) - 2 * p) / (1 + 1 / jnp.cosh(y))
    return jnp.where(some, jnp.sinh(y) / p, 1)


_quickened = implicit_root(_quickened_residual, _quickened_guess, iterations=1)
"""Launch speed over that in vacuum, at q = b (g T/2)²."""
