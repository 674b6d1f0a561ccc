"""The axes to draw on."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .._parameter import require_kind

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def axes_of(given: Axes | None, *, figsize: tuple[float, float] | None = None) -> Axes:
    """The axes given, or new ones; ValueError for what is neither axes nor None."""
    if given is None:
        from matplotlib import pyplot

        return pyplot.subplots(figsize=figsize, layout="constrained")[1]
    from matplotlib import axes

    return require_kind("ax", given, axes.Axes, "axes of matplotlib or None")
