"""Checks that bodies do not overlap at the start."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np
from jax.core import Tracer
from jaxtyping import Array
from numpy.typing import NDArray

from .bodies import AbstractBody, Shell, Sphere, words

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
    numbered = [(k, body) for k, body in enumerate(bodies) if isinstance(body, Sphere)]
    spheres = [k for k, _ in numbered]
    parts = [(sphere.place, sphere.radius) for _, sphere in numbered]
    walls = [(k, *w[1:3]) for k, body in enumerate(bodies) for w in body.walls()]
    shells = [(k, b.place, b.radius) for k, b in enumerate(bodies) if isinstance(b, Shell)]
    values = [*(x for part in parts for x in part), *(x for w in walls + shells for x in w[1:])]
    if any(isinstance(x, Tracer) for x in (*values, *periodic)):
        return
    position = np.stack([np.asarray(x, float) for x, _ in parts])
    radius = np.array([float(r) for _, r in parts])
    moves = np.array([not sphere.fixed for _, sphere in numbered])
    digits = min(np.finfo(np.asarray(x).dtype).precision for x in values)
    rounding = ROUNDINGS * 10.0**-digits
    for i in range(len(spheres)):
        apart = minimum_image(position[i] - position[i + 1 :], periodic)
        gap = np.sqrt(np.sum(apart**2, axis=-1)) - (radius[i] + radius[i + 1 :])
        scale = radius[i] + radius[i + 1 :] + np.max(np.abs(position))
        bad = (gap < -rounding * scale) & (moves[i] | moves[i + 1 :])
        if np.any(bad):
            other = i + 1 + int(np.argmin(np.where(bad, gap, np.inf)))
            raise _overlap(bodies, spheres[i], spheres[other], -gap[other - i - 1])
    for k, centre, size in shells:
        away = np.sqrt(np.sum((position - np.asarray(centre, float)) ** 2, axis=-1))
        least = -rounding * (float(size) + np.max(np.abs(position)))
        _require_gap(bodies, spheres, k, float(size) - radius - away, moves, least)
    for k, normal, offset in walls:
        gap = position @ np.asarray(normal, float) - float(offset) - radius
        least = -rounding * (radius + np.max(np.abs(position)))
        _require_gap(bodies, spheres, k, gap, moves, least)


def _require_gap(
    bodies: Sequence[AbstractBody],
    spheres: Sequence[int],
    other: int,
    gap: NDArray[np.float64],
    moves: NDArray[np.bool_],
    least: Any,
) -> None:
    """Raise ValueError if the gap of a moving sphere to a body is an overlap."""
    bad = (gap < least) & moves
    if np.any(bad):
        worst = int(np.argmin(np.where(bad, gap, np.inf)))
        raise _overlap(bodies, spheres[worst], other, -gap[worst])


def require_clear_of_each_other(bodies: Sequence[AbstractBody], duration: Array) -> None:
    """Raise ValueError if a moving wall meets a facing wall within the duration. Distances are
    sampled 64 times a period of the fastest wall, and at least 1024 times in all. Nothing is
    compared if any value is traced.
    """
    walls = [(k, wall) for k, body in enumerate(bodies) for wall in body.walls()]
    if all(wall.motion is None for _, wall in walls):
        return
    if any(isinstance(x, Tracer) for x in jax.tree.leaves(([w for _, w in walls], duration))):
        return
    length = float(duration)
    rates = [float(wall.motion.rate) for _, wall in walls if wall.motion is not None]
    count = min(1024 + int(64 * max(rates) * length / (2 * np.pi)), _MOST_TIMES)
    times = np.linspace(0, length, count)
    for (b, second), (a, first) in itertools.combinations(walls, 2):
        if a == b or np.sum(np.asarray(first.normal) * np.asarray(second.normal)) > -1 + 1e-9:
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


def _overlap(bodies: Sequence[AbstractBody], a: int, b: int, depth: float) -> ValueError:
    return ValueError(
        f"Argument `bodies` must not overlap at the start, but {words(bodies, a)} and "
        f"{words(bodies, b)} do, by {depth:.6g} m."
    )
