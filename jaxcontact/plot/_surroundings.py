"""What spheres move in: the frame of a picture, the walls in it, and colours."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .._scene import Run
from ._path import radii, rows_of_spheres

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Okabe & Ito: told apart by readers with any colour vision.
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
_FIXED = "#777777"
_SOLID, _EDGE = "#E4E4E4", "#555555"
NAMED = 8
"""More spheres than this have no names in a legend."""

_MARGIN = 0.06
"""Of the size of what is drawn."""


def colours(run: Run) -> list[str]:
    """The colour of each sphere; fixed ones are grey."""
    spheres = run.scene.spheres
    return [_FIXED if s.fixed else _COLOURS[k % len(_COLOURS)] for k, s in enumerate(spheres)]


def labels(run: Run) -> list[str]:
    """The name of each sphere for a legend, none where there are many or where none has a name."""
    names = [run.impacts.names[k] for k in rows_of_spheres(run)]
    shown = len(names) <= NAMED and any(sphere.name for sphere in run.scene.spheres)
    return names if shown else []


def frame(run: Run, position: np.ndarray, shown: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """The lower and upper ends of a picture along the axes that are `shown`.

    It holds all spheres at all times, the cell of periodic space, and the walls that face along an
    axis, if they are no farther away than the size of the rest.
    """
    size = radii(run)[:, None]
    low = np.min(np.nanmin(position, axis=0) - size, axis=0)
    high = np.max(np.nanmax(position, axis=0) + size, axis=0)
    for axis, length in enumerate(run.scene.periodic):
        if length is not None:
            low[axis], high[axis] = 0.0, float(length)
    reach = np.max((high - low)[list(shown)])
    for normal, offset in _walls(run):
        if np.count_nonzero(normal) == 1:
            axis = int(np.flatnonzero(normal)[0])
            at = offset / normal[axis]
            if low[axis] - reach <= at <= high[axis] + reach:
                low[axis], high[axis] = min(low[axis], at), max(high[axis], at)
    low, high = low[list(shown)], high[list(shown)]
    margin = _MARGIN * np.max(high - low)
    # A periodic cell ends where it ends.
    open_end = np.array([run.scene.periodic[axis] is None for axis in shown])
    return low - margin * open_end, high + margin * open_end


def _walls(run: Run) -> list[tuple[np.ndarray, float]]:
    """The unit normals and offsets of all flat walls."""
    walls = (wall for body in run.scene.bodies for wall in body.walls())
    return [(np.asarray(normal, float), float(offset)) for _, normal, offset in walls]


def draw_walls(ax: Axes, run: Run, shown: tuple[int, ...]) -> None:
    """Draw what is solid behind the walls, inside of the limits of the axes.

    Walls that are not seen from their edge are left out; one dimension lies across.
    """
    (left, right), (bottom, top) = ax.get_xlim(), ax.get_ylim()
    corners = np.array([(left, bottom), (right, bottom), (right, top), (left, top)])
    for normal, offset in _walls(run):
        seen = np.append(normal, 0.0) if len(shown) == 1 else normal[list(shown)]
        if not np.isclose(np.hypot(*seen), 1.0):
            continue
        solid = _clipped(corners, seen, offset)
        along = np.array([-seen[1], seen[0]]) * np.hypot(right - left, top - bottom)
        middle = corners.mean(axis=0)
        foot = middle + (offset - seen @ middle) * seen
        ends = np.array([foot - along, foot + along])
        # The solid parts of other walls cover a line where it leaves the free space.
        ax.plot(*ends.T, color=_EDGE, lw=2.4, zorder=0.2)
        if len(solid):
            ax.fill(*solid.T, color=_SOLID, lw=0, zorder=0.3)


def _clipped(polygon: np.ndarray, normal: np.ndarray, offset: float) -> np.ndarray:
    """The part (K, 2) of a convex polygon that lies behind a wall."""
    kept = []
    for here, after in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        gap, next_gap = normal @ here - offset, normal @ after - offset
        if gap <= 0:
            kept.append(here)
        if gap * next_gap < 0:
            kept.append(here + (after - here) * gap / (gap - next_gap))
    return np.array(kept).reshape(-1, 2)


def draw_levels(ax: Axes, run: Run) -> None:
    """Draw the walls of a line over time: what is solid above or below a position."""
    bottom, top = ax.get_ylim()
    for normal, offset in _walls(run):
        at = offset / normal[0]
        end = bottom if normal[0] > 0 else top
        ax.axhspan(min(at, end), max(at, end), color=_SOLID, lw=0, zorder=0.3)
        ax.axhline(at, color=_EDGE, lw=1.6, zorder=0.4)
