"""The axes to draw on, and colours and lines that are distinguishable with any colour vision, and
in grey.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..._entry import is_list, refusal, require_kind

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Okabe & Ito (2008), https://jfly.uni-koeln.de/color/: distinguishable with any colour vision.
BLUE, ORANGE, GREEN = "#0072B2", "#E69F00", "#009E73"
VERMILLION, SKY, PURPLE, BLACK = "#D55E00", "#56B4E9", "#CC79A7", "#000000"

CURVES = (
    *((BLUE, "-"), (ORANGE, "--"), (BLACK, "-."), (GREEN, ":")),
    *((VERMILLION, (0, (5, 1, 1, 1, 1, 1))), (SKY, (0, (8, 3)))),
)
"""Curves in order: the first four also differ in grey, all of them in their lines."""

MARKERS = "o", "s", "^", "D", "v", "P"
"""Markers of several sets of points, in order, in the colours of `CURVES`."""

BODIES = BLUE, ORANGE, GREEN, VERMILLION, SKY, PURPLE
"""Colours of spheres, in order; black is reserved for marks."""

DATA, GUIDE = "#555555", "#999999"
"""Colours of points and of guide lines."""

_LETTER, _HANDLE = 0.06, 0.5
"""Width of a letter and of the line sample in a legend, in inches."""

_ROW, _LETTERS = 12.2, 11
"""Height of a row of a legend in points, and letters of a title in an inch."""

_LAST = 0.85
"""Axes that end to the right of this fraction of a figure have no neighbour there."""


def use_curves(ax: Axes) -> Axes:
    """Make the lines of empty axes follow `CURVES`, unless the user has chosen other styles."""
    import matplotlib as mpl
    from cycler import cycler

    chosen = mpl.rcParams["axes.prop_cycle"] != mpl.rcParamsDefault["axes.prop_cycle"]
    if not chosen and not ax.has_data():
        colours, lines = zip(*CURVES, strict=True)
        ax.set_prop_cycle(cycler(color=colours) + cycler(linestyle=lines))
    return ax


def legend_above(ax: Axes, title: str | None = None, *, heading: str = "") -> None:
    """Add a legend above the frame, in as many columns as fit; nothing without labels.

    The `heading` is the title of the axes, above the legend.
    """
    labels = ax.get_legend_handles_labels()[1]
    if not labels:
        return
    figure = ax.get_figure(root=True)
    assert figure is not None
    place = ax.get_position(original=True)
    # The last axes of a row can also use the margin.
    room = ((1 if place.x1 > _LAST else place.x1) - place.x0) * figure.get_figwidth()
    columns = max(int(room / (_HANDLE + _LETTER * max(map(len, labels)))), 1)
    rows = math.ceil(len(labels) / columns)
    ax.legend(
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        borderaxespad=0.3,
        ncols=math.ceil(len(labels) / rows),
        columnspacing=1.0,
        handlelength=2.4,
        frameon=False,
        fontsize="small",
        title=title,
        alignment="left",
    )
    if heading:
        heading = textwrap.fill(heading, int(_LETTERS * figure.get_figwidth()))
        ax.set_title(heading, loc="left", fontsize="medium", pad=_ROW * rows + 12)


def axes_of(ax: Axes | None, *, figsize: tuple[float, float] | None = None) -> Axes:
    """Return the given axes, or new ones for None; ValueError for anything else."""
    if ax is None:
        from matplotlib import pyplot

        return use_curves(pyplot.subplots(figsize=figsize, layout="constrained")[1])
    from matplotlib import axes

    return use_curves(require_kind("ax", ax, axes.Axes, "axes of matplotlib or None"))


def one_or_several(axes: Sequence[Any]) -> Any:
    """Return axes as an array, or single ones themselves."""
    return np.array(axes) if len(axes) > 1 else axes[0]


def require_label(label: Any) -> None:
    """Raise ValueError for anything but a text or None."""
    if label is not None:
        require_kind("label", label, str, "a text or None")


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
    several = is_list(chosen) and all(isinstance(x, axes.Axes) for x in chosen)
    if not several or len(chosen) != count:
        raise refusal("ax", f"be {count} axes of matplotlib, one for each {each}, or None", ax)
    return [use_curves(picture) for picture in chosen]
