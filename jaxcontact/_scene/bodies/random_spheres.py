"""Spheres at random places in a box, without overlap."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from jaxtyping import ArrayLike
from numpy.typing import NDArray

from ..._contact import Material
from ..._entry import (
    POSITIVE,
    as_numbers,
    is_list,
    refusal,
    refuses_unknown,
    require_count,
    require_kind,
    require_number,
)
from .bodies import Box, Sphere
from .entry import vector

_TRIES = 1000
"""The number of trials for each sphere: if 1/200 of the box is free, 99 % of spheres succeed."""

_CLEARANCE = 1e-9
"""The least distance of surfaces, relative to the radius, so that rounding makes no overlap."""

Places = NDArray[np.float64]


@refuses_unknown
def random_spheres(
    count: int,
    *,
    low: ArrayLike | Sequence[ArrayLike],
    high: ArrayLike | Sequence[ArrayLike],
    radius: ArrayLike,
    mass: ArrayLike | None = None,
    material: Material | None = None,
    speed: float | None = None,
    periodic: Sequence[float | None] | None = None,
    name: str | None = None,
    seed: int = 0,
) -> list[Sphere]:
    """Place spheres at random in a box without overlap, at rest or with thermal velocities.

    - `count`: the number of spheres.
    - `low`, `high`: the corners of the box in m, finite, one to three numbers each.
    - `radius`, `mass`: in m and kg, one for all or (count,).
    - `material`: a `Material`. Its density may replace `mass`.
    - `speed`: in m/s; at rest if not given.
    - `periodic`: as in `Scene`, with the lengths of the box. Along such an axis spheres may cross
      the ends.
    - `name`: one name for all spheres.
    - `seed`: the same seed gives the same spheres.

    Uniform positions are drawn, the largest spheres first, and kept if they are free (random
    sequential addition). This fills about 45 % of a wide box in two dimensions and 30 % in three.
    If a sphere finds no place, each sphere gets a cell of its own and a uniform position in it.
    Cells allow a higher density but look ordered.

    Velocities are normal with variances proportional to 1/m (equipartition). The total momentum is
    then removed, and the velocities are scaled so that ½ Σ m v² = ½ Σ m speed².

    Raises ValueError for values out of range, for spheres that do not fit, and for `speed` with
    fewer than two spheres.
    """
    count = require_count("count", count, 1)
    for corner, word in ((low, "low"), (high, "high")):
        vector(corner, word)  # must be finite, unlike the corners of a `Box`
    box = Box(low, high)
    lower = np.asarray(box.low, float)
    size = np.asarray(box.high, float) - lower
    radii = _one_for_each("radius", radius, count)
    masses = _weights(mass, material, radii)
    around = _around(periodic, size)
    thermal = _thermal_speed(speed, count)
    random = np.random.default_rng(require_count("seed", seed, 0))
    places = lower + _places(random, size, radii, around)
    velocity: Sequence[Places | None] = [None] * count
    if thermal is not None:
        velocity = list(_thermal(random, masses, places.shape, thermal))
    return [
        Sphere(
            radius=float(radii[k]),
            mass=None if mass is None else float(masses[k]),
            position=places[k],
            velocity=velocity[k],
            material=material,
            name=name,
        )
        for k in range(count)
    ]


def _weights(mass: ArrayLike | None, material: Any, radii: Places) -> Places:
    """Return the masses of spheres; without any, R³ times the density of the material."""
    masses = None if mass is None else _one_for_each("mass", mass, len(radii))
    if material is not None:
        require_kind("material", material, Material, "a `Material` or None")
    if masses is not None:
        return masses
    if material is None or material.density is None:
        raise ValueError(
            "Argument `mass` must be given for spheres without a material that has a density, but "
            "is None."
        )
    return float(material.density) * radii**3


def _thermal_speed(speed: float | None, count: int) -> float | None:
    if speed is None:
        return None
    thermal = require_number("speed", speed, POSITIVE, ", or None for spheres at rest")
    if count < 2:
        must = "be None for a single sphere, which cannot move without a total momentum"
        raise refusal("speed", must, speed)
    return thermal


def _one_for_each(name: str, value: ArrayLike, count: int) -> Places:
    """Return positive numbers (count,) from one for all or one for each."""
    numbers = as_numbers(value, name)
    if numbers.shape not in ((), (count,)) or not np.all(POSITIVE.holds(numbers)):
        raise refusal(
            name, f"be a number in {POSITIVE}, or {count} of them, one for each sphere", value
        )
    return np.broadcast_to(numbers, (count,))


def _around(periodic: Sequence[float | None] | None, size: Places) -> NDArray[np.bool_]:
    """Return a mask of the periodic axes."""
    if periodic is None:
        return np.zeros(len(size), bool)
    if not is_list(periodic) or len(periodic) != len(size):
        must = f"be a list with a length or None for each of the {len(size)} axes"
        raise refusal("periodic", must, periodic)
    for axis, length in enumerate(periodic):
        if length is None:
            continue
        period = require_number("periodic", length, POSITIVE)
        if not math.isclose(period, size[axis]):
            must = f"be None or the length of the box, {size[axis]:g} along axis {axis}"
            raise refusal("periodic", must, periodic)
    return np.array([length is not None for length in periodic])


def _places(
    random: np.random.Generator, size: Places, radii: Places, around: NDArray[np.bool_]
) -> Places:
    """Return positions (count, D) above the lower corner; raises ValueError if they do not fit."""
    room = np.where(around, size, size - 2 * np.max(radii))
    if np.any(room < 0):
        sides = " × ".join(f"{side:g}" for side in size)
        raise ValueError(
            f"Argument `radius` must be at most half of the box, which is {sides} m, but the "
            f"largest is {np.max(radii):g}."
        )
    reach = radii * (1 + _CLEARANCE)
    places = _add_spheres(random, size, reach, around)
    if len(places) == len(radii):
        return places
    rows = _cells(size, float(np.max(reach)), len(radii))
    if rows is not None:
        return _in_cells(random, size, reach, rows)
    solid = {1: 2 * radii, 2: math.pi * radii**2, 3: 4 / 3 * math.pi * radii**3}[len(size)]
    largest = np.sort(solid)[::-1]
    filled, wanted = (np.sum(part) / np.prod(size) for part in (largest[: len(places)], largest))
    raise ValueError(
        f"Argument `count` must be one that fits into the box, but is {len(radii)}: they would "
        f"fill {wanted:.3g} of it; at random {len(places)} found a place ({filled:.3g}), and "
        f"there are not so many cells wider than {2 * np.max(radii):g} m."
    )


def _add_spheres(
    random: np.random.Generator, size: Places, reach: Places, around: NDArray[np.bool_]
) -> Places:
    """Place spheres by random sequential addition, the largest first, until one finds no place."""
    # Spheres that can touch a given one lie in its cell or in a neighbouring cell.
    number = np.maximum(1, np.floor(size / (2 * np.max(reach)))).astype(int)
    side, dimensions = size / number, len(size)
    order = np.argsort(-reach, kind="stable")
    cells: dict[tuple[int, ...], list[int]] = {}
    places, count = np.zeros((len(reach), dimensions)), 0
    for k in order:
        margin = np.where(around, 0.0, reach[k])
        for place in margin + random.random((_TRIES, dimensions)) * (size - 2 * margin):
            here = tuple(np.minimum(place / side, number - 1).astype(int).tolist())
            near = [j for cell in _beside(here, number, around) for j in cells.get(cell, ())]
            apart = places[near] - place
            apart -= np.where(around, size * np.round(apart / size), 0.0)
            if np.all(np.sum(apart**2, axis=1) >= (reach[near] + reach[k]) ** 2):
                places[k] = place
                cells.setdefault(here, []).append(int(k))
                count += 1
                break
        else:
            return places[order[:count]]
    return places


def _beside(
    here: tuple[int, ...], number: NDArray[np.int_], around: NDArray[np.bool_]
) -> Iterator[tuple[int, ...]]:
    """Return a cell and its neighbours, each once, across periodic ends."""
    ranges = []
    for place, count, meets in zip(here, number.tolist(), around.tolist(), strict=True):
        near = range(place - 1, place + 2)
        ranges.append({n % count for n in near} if meets else {n for n in near if 0 <= n < count})
    return itertools.product(*ranges)


def _cells(size: Places, reach: float, count: int) -> NDArray[np.int_] | None:
    """Return the numbers of cells along each axis that make at least `count` of the widest cells.

    Cells must be as wide as a sphere. Returns None if there are too few.
    """
    most = np.floor(size / (2 * reach)).astype(int)
    if np.prod(most) < count:
        return None
    # The widths at which one more cell fits along some axis.
    widths = {length / n for length, m in zip(size, most, strict=True) for n in range(1, m + 1)}
    for width in sorted(widths, reverse=True):
        number = np.minimum(np.maximum(1, np.floor(size / width * (1 + 1e-12))), most).astype(int)
        if np.prod(number) >= count:
            return number
    return most


def _in_cells(
    random: np.random.Generator, size: Places, reach: Places, number: NDArray[np.int_]
) -> Places:
    """Place every sphere uniformly in a cell of its own."""
    chosen = random.permutation(int(np.prod(number)))[: len(reach)]
    corner = np.stack(np.unravel_index(chosen, tuple(number)), axis=1)
    side, margin = size / number, reach[:, None]
    return corner * side + margin + random.random(corner.shape) * (side - 2 * margin)


def _thermal(
    random: np.random.Generator, masses: Places, shape: tuple[int, ...], speed: float
) -> Places:
    """Return equilibrium velocities without total momentum, with ½ Σ m v² = ½ Σ m speed²."""
    mass = masses[:, None]
    velocity = random.normal(size=shape) / np.sqrt(mass)
    velocity -= np.sum(mass * velocity, axis=0) / np.sum(mass)
    return velocity * speed * np.sqrt(np.sum(mass) / np.sum(mass * velocity**2))
