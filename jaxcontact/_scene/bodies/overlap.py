"""Checks that bodies do not overlap at the start."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Array
from numpy.typing import NDArray

from ..._entry import traced
from .bodies import AbstractBody, shells_of, spheres_of, walls_of, words

ROUNDINGS = 64
"""The tolerated overlap, in roundings of the positions and radii."""

NOISE = 16
"""The rounding errors of a speed below which touching bodies neither close nor separate."""

_MOST_TIMES = 1_000_000
"""The largest number of times at which wall distances are compared."""


def require_apart(bodies: Sequence[AbstractBody], periodic: Sequence[Array | None]) -> None:
    """Raise ValueError for the first pair that overlaps by more than rounding. Fixed bodies may
    overlap each other. Nothing is compared if any value is traced.
    """
    spheres = [(k, ball.place, ball.radius, not ball.fixed) for k, ball in spheres_of(bodies)]
    walls = [(k, *wall[1:3]) for k, wall in walls_of(bodies)]
    shells = [(k, shell.place, shell.radius) for k, shell in shells_of(bodies)]
    values = [x for part in (*spheres, *walls, *shells) for x in part[1:3]]
    if traced(values, periodic):
        return
    which, places, radius, moves = map(np.array, zip(*spheres, strict=True))
    position, radius = places.astype(float), radius.astype(float)
    digits = min(np.finfo(np.asarray(value).dtype).precision for value in values)
    rounding = ROUNDINGS * 10.0**-digits
    extent = np.max(np.abs(position))

    def require_gap(first: Any, second: Any, gap: Any, size: Any, counts: Any) -> None:
        bad = (gap < -rounding * (size + extent)) & counts
        if np.any(bad):
            worst = int(np.argmin(np.where(bad, gap, np.inf)))
            a, b = (words(bodies, k[worst]) for k in np.broadcast_arrays(first, second))
            raise ValueError(
                f"Argument `bodies` must not overlap at the start, but {a} and {b} do, by "
                f"{-gap[worst]:.6g} m."
            )

    for i in range(len(which)):
        after = slice(i + 1, None)
        size = radius[i] + radius[after]
        apart = minimum_image(position[i] - position[after], periodic)
        gap = np.sqrt(np.sum(apart**2, axis=-1)) - size
        require_gap(which[i], which[after], gap, size, moves[i] | moves[after])
    for k, centre, size in shells:
        away = np.sqrt(np.sum((position - np.asarray(centre, float)) ** 2, axis=-1))
        require_gap(which, k, float(size) - radius - away, float(size), moves)
    for k, normal, offset in walls:
        gap = position @ np.asarray(normal, float) - float(offset) - radius
        require_gap(which, k, gap, radius, moves)


def require_clear_of_each_other(bodies: Sequence[AbstractBody], duration: Array) -> None:
    """Raise ValueError if a moving wall meets a facing wall within the duration. Distances are
    sampled 64 times a period of the fastest wall, and at least 1024 times in all. Nothing is
    compared if any value is traced.
    """
    walls = walls_of(bodies)
    rates = [wall.motion.rate for _, wall in walls if wall.motion is not None]
    if not rates or traced(walls, duration):
        return
    length = float(duration)
    count = min(1024 + int(64 * float(max(rates)) * length / (2 * np.pi)), _MOST_TIMES)
    times = np.linspace(0, length, count)
    for (b, second), (a, first) in itertools.combinations(walls, 2):
        facing = np.sum(np.asarray(first.normal) * np.asarray(second.normal)) <= -1 + 1e-9
        if a == b or not facing:
            continue
        between = -(first.offset_at(times) + second.offset_at(times))
        if np.min(between) <= 0 < between[0]:
            k = int(np.argmax(between <= 0))
            when = np.interp(0, between[k : k - 2 : -1], times[k : k - 2 : -1])
            raise ValueError(
                f"Argument `motion` must keep walls apart, but {words(bodies, b)} and "
                f"{words(bodies, a)} meet at {when:.6g} s."
            )


def minimum_image(
    apart: NDArray[np.float64], periodic: Sequence[Array | None]
) -> NDArray[np.float64]:
    """Return the shortest images of distances (..., D) in periodic space."""
    lengths = np.array([np.inf if length is None else float(length) for length in periodic])
    finite = np.where(np.isfinite(lengths), lengths, 1.0)
    return apart - np.where(np.isfinite(lengths), finite * np.round(apart / finite), 0.0)
