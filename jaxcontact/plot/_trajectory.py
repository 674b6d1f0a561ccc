"""Pictures of an impact."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .. import _units as units
from .._impact import Trajectory
from .._parameter import require_choice, require_kind
from ._axes import axes_of

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
    """Draw one quantity of an impact against another: force against indentation is its hysteresis.

    Arguments: one trajectory (no batch); `x` and `y`, each "time", "indentation", "velocity" or
    "force", in SI units; the axes to draw on, new ones if None; a label for the legend. Returns the
    axes. Raises ValueError for an unknown quantity, a batch, and what is no trajectory or axes.
    """
    require_choice("x", x, _QUANTITIES)
    require_choice("y", y, _QUANTITIES)
    require_kind("path", path, Trajectory, "a `Trajectory`")
    if label is not None:
        require_kind("label", label, str, "a text or None")
    if path.time.ndim != 1:
        raise ValueError(
            f"Argument `path` must be a single trajectory, but has the shape {path.time.shape}."
        )
    ax = axes_of(ax)
    ax.plot(np.asarray(getattr(path, x)), np.asarray(getattr(path, y)), label=label)
    ax.set_xlabel(units.label(x, x))
    ax.set_ylabel(units.label(y, y))
    return ax
