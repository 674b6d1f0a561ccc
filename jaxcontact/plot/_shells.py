"""Shells in the picture of a run: solid outside of a circle."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from matplotlib.patches import PathPatch
from matplotlib.path import Path

from .._scene import Run, Shell

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SOLID, EDGE = "#E0E0E0", "#555555"
_CORNERS = 256


class Round(NamedTuple):
    """A shell: its centre (D,) and radius in m."""

    centre: np.ndarray
    radius: float


def shells(run: Run) -> list[Round]:
    """All shells of a scene."""
    found = [body for body in run.scene.bodies if isinstance(body, Shell)]
    return [Round(np.asarray(body.centre, float), float(body.radius)) for body in found]


def draw_shells(ax: Axes, run: Run, shown: tuple[int, ...]) -> None:
    """Draw what is solid outside of shells; one dimension lies across, as two ends."""
    (left, right), (bottom, top) = ax.get_xlim(), ax.get_ylim()
    for centre, radius in shells(run):
        if len(shown) == 1:
            for low, high in ((left, centre[0] - radius), (centre[0] + radius, right)):
                ax.axvspan(low, high, color=SOLID, lw=0, zorder=0.3)
            continue
        turn = np.linspace(0, 2 * np.pi, _CORNERS)
        # The hole runs round the other way.
        hole = centre[list(shown)] + radius * np.stack([np.cos(turn), -np.sin(turn)], axis=1)
        frame = np.array([(left, bottom), (right, bottom), (right, top), (left, top)])
        path = Path.make_compound_path(*(Path(p, closed=False) for p in (frame, hole)))
        ax.add_patch(PathPatch(path, facecolor=SOLID, lw=0, zorder=0.3))
        ax.plot(*hole.T, color=EDGE, lw=1.6, zorder=0.4)
