"""The axes to draw on."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..._entry import rendered, require_kind
from .style import use_curves

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def axes_of(ax: Axes | None, *, figsize: tuple[float, float] | None = None) -> Axes:
    """Return the given axes, or new ones for None; ValueError for anything else."""
    if ax is None:
        from matplotlib import pyplot

        return use_curves(pyplot.subplots(figsize=figsize, layout="constrained")[1])
    from matplotlib import axes

    return use_curves(require_kind("ax", ax, axes.Axes, "axes of matplotlib or None"))


def axes_for(ax: Any, count: int, each: str = "column of the data") -> list[Axes]:
    """Return axes for each of several columns or other items: given ones, or new ones in a row."""
    if count == 1:
        return [axes_of(ax)]
    if ax is None:
        from matplotlib import pyplot

        size = (3.6 * count, 3.4)
        new = pyplot.subplots(ncols=count, figsize=size, layout="constrained")[1]
        return [use_curves(picture) for picture in new]
    from matplotlib import axes

    chosen = list(ax.flat) if isinstance(ax, np.ndarray) else ax
    several = isinstance(chosen, list | tuple) and all(isinstance(x, axes.Axes) for x in chosen)
    if not several or len(chosen) != count:
        raise ValueError(
            f"Argument `ax` must be {count} axes of matplotlib, one for each {each}, or None, but "
            f"is {rendered(ax)}."
        )
    return [use_curves(picture) for picture in chosen]
