"""The surroundings of spheres: the frame of a plot, its walls, and colours."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.patches import Polygon

from ..._scene import EngineRun, Run
from ..._scene.bodies.bodies import names_of, shells_of, spheres_of, walls_of
from .path import radii, rows_of_spheres
from .style import BODIES, CURVES

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.lines import Line2D

    _Shape = Callable[[int], tuple[np.ndarray, np.ndarray]]

_FIXED = "#777777"
_SOLID, _SWEPT, _EDGE = "#E0E0E0", "#F1F1F1", "#555555"
NAMED = 8
"""Number of spheres above which a legend has no names."""

_MARGIN = 0.06
"""Margin as a fraction of the size of the content."""

_REACH = 4
"""Walls farther away than this multiple of the range of the spheres are not shown."""

_FINE, _MOST = 48, 100_000
"""Times per period of a wall, and their largest total number."""


def colours(run: Run | EngineRun) -> list[str]:
    """Return the colour of each sphere; fixed ones are grey."""
    spheres = run.scene.spheres
    return [_FIXED if s.fixed else BODIES[k % len(BODIES)] for k, s in enumerate(spheres)]


def lines(run: Run | EngineRun) -> list[Any]:
    """Return the line style of each sphere's path; in grey it separates all named spheres."""
    return [CURVES[k % len(CURVES)][1] for k in range(len(run.scene.spheres))]


def labels(run: Run | EngineRun) -> list[str]:
    """Return the names of the spheres for a legend; empty for many spheres or without names."""
    every = names_of(run.scene.bodies)
    names = [every[k] for k in rows_of_spheres(run)]
    shown = len(names) <= NAMED and any(sphere.name for sphere in run.scene.spheres)
    return names if shown else []


def frame(
    run: Run | EngineRun, position: np.ndarray, shown: tuple[int, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the lower and upper ends of a plot along the axes that are `shown`.

    The frame contains all spheres at all times and the cell of periodic space. Walls normal to an
    axis are included unless they are farther away than a few times the size of the rest.
    """
    size = radii(run)[:, None]
    low = np.min(np.nanmin(position, axis=0) - size, axis=0)
    high = np.max(np.nanmax(position, axis=0) + size, axis=0)
    for axis, length in enumerate(run.scene.periodic):
        if length is not None:
            low[axis], high[axis] = 0.0, float(length)
    reach = _REACH * np.max((high - low)[list(shown)])
    for normal, offset in edges(run, fine_times(run)):
        if np.count_nonzero(normal) == 1:
            axis = int(np.flatnonzero(normal)[0])
            at = offset * normal[axis]
            if low[axis] - reach <= at.max() and at.min() <= high[axis] + reach:
                low[axis], high[axis] = min(low[axis], at.min()), max(high[axis], at.max())
    for _, shell in shells_of(run.scene.bodies):
        centre, radius = shell.centre_at(fine_times(run)), float(shell.radius)
        low = np.minimum(low, np.min(centre, axis=0) - radius)
        high = np.maximum(high, np.max(centre, axis=0) + radius)
    low, high = low[list(shown)], high[list(shown)]
    margin = _MARGIN * np.max(high - low)
    # A periodic cell has no margin.
    open_end = np.array([run.scene.periodic[axis] is None for axis in shown])
    return low - margin * open_end, high + margin * open_end


def edges(run: Run | EngineRun, time: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the unit normals (D,) of all walls that are flat in a plot, and their offsets n·p (T,)
    in m at some times (T,).
    """
    walls = [wall for _, wall in walls_of(run.scene.bodies)]
    segments = [(np.asarray(wall.normal, float), wall.offset_at(time)) for wall in walls]
    for _, shell in shells_of(run.scene.bodies) if run.scene.dimensions == 1 else ():
        # In one dimension a shell is two walls.
        for sign in (1.0, -1.0):
            offset = sign * shell.centre_at(time)[:, 0] - float(shell.radius)
            segments.append((np.array([sign]), offset))
    return segments


def fine_times(run: Run | EngineRun) -> np.ndarray:
    """Return times that resolve every vibration of a body, up to a largest number."""
    bodies = run.scene.bodies
    curved = (*spheres_of(bodies), *shells_of(bodies))
    motions = [wall.motion for _, wall in walls_of(bodies) if wall.motion is not None]
    motions += [body.motion.along(None) for _, body in curved if body.motion is not None]
    fastest = max((float(motion.rate) for motion in motions), default=0.0)
    periods = fastest * float(run.reached) / (2 * np.pi)
    least = 2000 if any(motion.own is not None for motion in motions) else 200
    return np.linspace(0, float(run.reached), int(np.clip(_FINE * periods, least, _MOST)))


def draw_walls(
    ax: Axes, run: Run | EngineRun, shown: tuple[int, ...], time: np.ndarray | None = None
) -> Callable[[int], list[Artist]]:
    """Draw walls, shells and the solid around; return a function that moves them to the k-th time.

    Without times, walls are drawn at the end, and lightly the region they swept; shells at their
    start, and moving ones also in outline at their end. In one dimension shells are drawn as walls.
    """
    in_film = time is not None
    time = fine_times(run) if time is None else time
    (left, right), (bottom, top) = ax.get_xlim(), ax.get_ylim()
    corners = np.array([(left, bottom), (right, bottom), (right, top), (left, top)])
    # The opposite orientation of the corners makes a hole.
    angle = np.linspace(0, -2 * np.pi, 361)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    moving: list[tuple[_Shape, Line2D, Polygon]] = []

    def flat(normal: np.ndarray, offset: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
        middle = corners.mean(axis=0)
        foot = middle + (offset[k] - normal @ middle) * normal
        along = np.array([-normal[1], normal[0]]) * np.hypot(right - left, top - bottom)
        return np.array([foot - along, foot + along]), _clip(corners, normal, offset[k])

    def curved(centre: np.ndarray, radius: float, k: int) -> tuple[np.ndarray, np.ndarray]:
        circle = centre[k] + radius * ring
        return circle, np.concatenate([corners, corners[:1], circle, corners[:1]])

    def draw(shape: _Shape, k: int, moves: bool, **look: Any) -> bool:
        """Draw a solid and its edge; return whether the rest of its motion is to be drawn."""
        edge, corners = shape(k)
        (line,) = ax.plot(*edge.T, color=_EDGE, ls="-", **look)
        solid = Polygon(corners, facecolor=_SOLID, lw=0, zorder=0.3)
        ax.add_patch(solid)
        if in_film and moves:
            moving.append((shape, line, solid))
        return moves and not in_film

    for normal, offset in edges(run, time):
        seen = np.append(normal, 0.0) if len(shown) == 1 else normal[list(shown)]
        # Other walls are not seen edge-on.
        if not np.isclose(np.hypot(*seen), 1.0):
            continue
        wall, moves = functools.partial(flat, seen, offset), bool(np.ptp(offset) > 0)
        # The solid parts of other walls cover a line where it leaves the free space.
        if draw(wall, 0 if in_film else -1, moves, lw=2.4, zorder=0.2):
            swept = wall(int(np.argmax(offset)))[1]
            ax.add_patch(Polygon(swept, facecolor=_SWEPT, lw=0, zorder=0.1))
    for _, shell in shells_of(run.scene.bodies) if len(shown) == 2 else ():
        centre, moves = shell.centre_at(time)[:, list(shown)], shell.motion is not None
        circle = functools.partial(curved, centre, float(shell.radius))
        if draw(circle, 0, moves, lw=1.4, zorder=0.4):
            ax.plot(*circle(-1)[0].T, color=_EDGE, lw=1.0, ls="--", zorder=0.4)

    def move(k: int) -> list[Artist]:
        for shape, line, solid in moving:
            edge, corners = shape(k)
            line.set_data(*edge.T)
            solid.set_xy(corners)
        return [artist for _, *pair in moving for artist in pair]

    return move


def _clip(polygon: np.ndarray, normal: np.ndarray, offset: float) -> np.ndarray:
    """Return the part (K, 2) of a convex polygon that lies behind a wall; NaN if none does."""
    kept = []
    for here, after in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        gap, next_gap = normal @ here - offset, normal @ after - offset
        if gap <= 0:
            kept.append(here)
        if gap * next_gap < 0:
            kept.append(here + (after - here) * gap / (gap - next_gap))
    return np.array(kept or [(np.nan, np.nan)])


def draw_levels(ax: Axes, run: Run | EngineRun) -> None:
    """Draw the walls of a line over time, with the solid above or below."""
    time = fine_times(run)
    for normal, offset in edges(run, time):
        level = offset * normal[0]
        end = ax.get_ylim()[0] if normal[0] > 0 else ax.get_ylim()[1]
        ax.fill_between(time, level, end, color=_SOLID, lw=0, zorder=0.3)
        ax.plot(time, level, color=_EDGE, lw=1.6, ls="-", zorder=0.4)
