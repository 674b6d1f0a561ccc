"""Flights of a track with air drag."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..._flight import Flight, Floats, height_after, launch_speed
from ..track.model import Shape

_SHORTEST = 256
"""Tracks up to this length share one compiled function."""


def shape_of(flight: Flight) -> Shape:
    """Return H of a flight with drag: height over g, by time since launch and by duration."""

    def shape(since: Floats, whole: Floats) -> tuple[Floats, Floats, Floats]:
        size, n = max(_SHORTEST, 1 << (since.size - 1).bit_length()), since.size
        both = np.ones((2, size))
        both[0, :n], both[1, :n] = since, whole
        with jax.enable_x64(True):
            found = _height(*both, np.float64(flight.gravity), np.float64(flight.rate or 0.0))
        height, by_since, by_whole = (np.array(one)[:n] for one in found)
        return height, by_since, by_whole

    return shape


@jax.jit
def _height(since: Array, whole: Array, gravity: Array, b: Array) -> tuple[Array, Array, Array]:
    def height(since: Array, whole: Array) -> Array:
        return height_after(since, launch_speed(whole, gravity, b), gravity, b) / gravity

    one, zero = jnp.ones_like(since), jnp.zeros_like(since)
    value, by_since = jax.jvp(height, (since, whole), (one, zero))
    _, by_whole = jax.jvp(height, (since, whole), (zero, one))
    return value, by_since, by_whole
