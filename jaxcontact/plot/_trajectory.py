"""Pictures of an impact."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .. import _units as units

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from .._impact import Trajectory

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
    axes. Raises ValueError for an unknown quantity or a batch.
    """
    for name, quantity in (("x", x), ("y", y)):
        if quantity not in _QUANTITIES:
            raise ValueError(
                f"Argument `{name}` must be one of {_QUANTITIES}, but is {quantity!r}."
            )
    if path.time.ndim != 1:
        raise ValueError(
            f"Argument `path` must be a single trajectory, but has the shape {path.time.shape}."
        )
    if ax is None:
        from matplotlib import pyplot

        _, ax = pyplot.subplots(layout="constrained")
    ax.plot(np.asarray(getattr(path, x)), np.asarray(getattr(path, y)), label=label)
    ax.set_xlabel(units.label(x, x))
    ax.set_ylabel(units.label(y, y))
    return ax
