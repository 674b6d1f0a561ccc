"""The plot of one quantity of an impact over another."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .._entry import require_choice, require_kind
from .._impact import Impact, Status, Trajectory
from ._drawing.labels import put_label
from ._drawing.style import axes_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_QUANTITIES = ("time", "indentation", "velocity", "force")


def trajectory(
    path: Trajectory,
    *,
    x: str = "time",
    y: str = "force",
    ax: Axes | None = None,
    label: str | None = None,
) -> Axes:
    """Draw one quantity of an impact over another; force over indentation is the hysteresis loop.

    Arguments: one trajectory (no batch); `x` and `y`, each "time", "indentation", "velocity" or
    "force"; the axes to draw on, new ones if None; a label for the legend. Returns the axes. Raises
    ValueError for an unknown quantity, a batch, and for anything but a trajectory and axes.
    """
    require_choice("x", x, _QUANTITIES)
    require_choice("y", y, _QUANTITIES)
    require_one_path(path)
    if label is not None:
        require_kind("label", label, str, "a text or None")
    ax = axes_of(ax)
    ax.plot(np.asarray(getattr(path, x)), np.asarray(getattr(path, y)), label=label)
    put_label(ax.xaxis, x, x)
    put_label(ax.yaxis, y, y)
    return ax


def require_one_path(path: object) -> Trajectory:
    """Return a single trajectory with values to draw; ValueError for anything else."""
    if isinstance(path, Impact):
        raise ValueError(
            "Argument `path` must be a `Trajectory`, but is an `Impact`, which has no time "
            "history: give `trajectory(law, contact, velocity)`, and to `plot.impact` both."
        )
    chosen = require_kind("path", path, Trajectory, "a `Trajectory`")
    if chosen.time.ndim != 1:
        raise ValueError(
            f"Argument `path` must be a single trajectory, but has the shape {chosen.time.shape}."
        )
    if not np.isfinite(np.asarray(chosen.time)).all():
        raise ValueError(
            "Argument `path` must have values to draw, but they are NaN: its status is "
            f"{Status.names_of(chosen.status)}."
        )
    return chosen
