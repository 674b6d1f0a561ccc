"""Whether bodies lie apart at the start."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jax.core import Tracer
from jaxtyping import Array
from numpy.typing import NDArray

from ._bodies import AbstractBody, Sphere, words

ROUNDINGS = 64
"""How many roundings of the positions and radii a depth may have that is no overlap."""


def require_apart(bodies: Sequence[AbstractBody], periodic: Sequence[Array | None]) -> None:
    """Raise ValueError for the first pair that overlaps by more than rounding.

    Fixed bodies may lie in each other. Where anything is traced nothing is compared.
    """
    found = [(k, body) for k, body in enumerate(bodies) if isinstance(body, Sphere)]
    spheres = [k for k, _ in found]
    parts = [(sphere.position, sphere.radius) for _, sphere in found]
    walls = [(k, *wall[1:]) for k, body in enumerate(bodies) for wall in body.walls()]
    given = [*(x for part in parts for x in part), *(x for wall in walls for x in wall[1:])]
    if any(isinstance(x, Tracer) for x in (*given, *periodic)):
        return
    position = np.stack([np.asarray(x, float) for x, _ in parts])
    radius = np.array([float(r) for _, r in parts])
    moves = np.array([not sphere.fixed for _, sphere in found])
    digits = min(np.finfo(np.asarray(x).dtype).precision for x in given)
    rounding = ROUNDINGS * 10.0**-digits
    for i in range(len(spheres)):
        apart = _minimum_image(position[i] - position[i + 1 :], periodic)
        gap = np.sqrt(np.sum(apart**2, axis=-1)) - (radius[i] + radius[i + 1 :])
        scale = radius[i] + radius[i + 1 :] + np.max(np.abs(position))
        bad = (gap < -rounding * scale) & (moves[i] | moves[i + 1 :])
        if np.any(bad):
            other = i + 1 + int(np.argmin(np.where(bad, gap, np.inf)))
            raise _overlap(bodies, spheres[i], spheres[other], -gap[other - i - 1])
    for k, normal, offset in walls:
        gap = position @ np.asarray(normal, float) - float(offset) - radius
        scale = radius + np.max(np.abs(position))
        bad = (gap < -rounding * scale) & moves
        if np.any(bad):
            worst = int(np.argmin(np.where(bad, gap, np.inf)))
            raise _overlap(bodies, spheres[worst], k, -gap[worst])


def _minimum_image(
    apart: NDArray[np.float64], periodic: Sequence[Array | None]
) -> NDArray[np.float64]:
    lengths = np.array([np.inf if length is None else float(length) for length in periodic])
    finite = np.where(np.isfinite(lengths), lengths, 1.0)
    return apart - np.where(np.isfinite(lengths), finite * np.round(apart / finite), 0.0)


def _overlap(bodies: Sequence[AbstractBody], a: int, b: int, depth: float) -> ValueError:
    return ValueError(
        f"Argument `bodies` must not overlap at the start, but {words(bodies, a)} and "
        f"{words(bodies, b)} do, by {depth:.6g} m."
    )
