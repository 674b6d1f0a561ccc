"""How the figures are drawn, in one style, from tables of curves; and what a figure returns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..extend import label, text_table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMN = 3.4
"""Width of a column in inches, for which all text is sized."""

_FONT = {"size": 8.0, "small": 7.0}


class PaperLaw(NamedTuple):
    """One of the four laws compared in the paper; the panel letter is that of Figs. 8 to 10."""

    panel: str
    name: str
    key: str
    """The registered name, used for the columns of tables."""
    look: dict[str, str]


# Okabe and Ito's colours, for any colour vision; the dashes distinguish the laws in grey.
FOUR_LAWS = (
    PaperLaw("a", "Lankarani-Nikravesh", "lankarani_nikravesh", {"color": "#56B4E9", "ls": "-."}),
    PaperLaw("b", "Hunt-Crossley", "hunt_crossley", {"color": "#E69F00", "ls": "--"}),
    PaperLaw("c", "Flores et al.", "flores", {"color": "#009E73", "ls": ":"}),
    PaperLaw("d", "Hu-Guo", "hu_guo", {"color": "#0072B2", "ls": "-"}),
)

# The values of e in Figs. 8 to 10, dark to light: samples of matplotlib's cividis.
SHADES = {1.0: "#00224E", 0.8: "#35456C", 0.6: "#666970", 0.4: "#948E77", 0.2: "#C8B866"}
RESTITUTIONS = tuple(SHADES)

VELOCITY = label("velocity", "velocity")
"""The label of the velocity of deformation, which changes sign."""

REFERENCE = {"color": "black", "linestyle": (0, (5, 2)), "linewidth": 0.8}
"""Style of the ideal result: the exact diagonal."""


class Panel(NamedTuple):
    """One pair of axes: curves (x, y, style), what `Axes.set` takes, and a title.

    A curve without x is a horizontal line, one without y a vertical line.
    """

    curves: Sequence[tuple[Any, Any, Mapping[str, Any]]]
    frame: dict[str, Any]
    title: str = ""


def drawn(
    panels: Sequence[Panel], columns: int = 1, *, height: float, legend: int = 2, share: str = ""
) -> Figure:
    """Return the figure of the panels, row by row; a legend of so many columns if curves have
    labels. `share` names the axes that panels share, such as "xy".
    """
    shared = {f"share{axis}": True for axis in share}
    figure, axes = sheet(len(panels) // columns, columns, height=height, **shared)
    for ax, panel in zip(axes, panels, strict=True):
        for x, y, style in panel.curves:
            if x is None:
                ax.axhline(y, **style)
            elif y is None:
                ax.axvline(x, **style)
            else:
                ax.plot(x, y, **style)
        ax.title.set_text(panel.title)
        ax.set(**panel.frame)
    if axes[0].get_legend_handles_labels()[1]:
        legend_above(figure, axes[0], legend)
    return figure


def sheet(
    rows: int = 1, columns: int = 1, *, height: float = 2.4, **shared: Any
) -> tuple[Figure, list[Axes]]:
    """Create a figure with its axes, row by row, on its own canvas without a display.

    `height` of the whole in inches; `shared` are `sharex` and `sharey` of matplotlib.
    """
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    style: dict[Any, Any] = {
        **dict.fromkeys(("font.size", "axes.labelsize", "axes.titlesize"), _FONT["size"]),
        **dict.fromkeys(("xtick.labelsize", "ytick.labelsize"), _FONT["small"]),
        **{"axes.spines.top": False, "axes.spines.right": False, "axes.linewidth": 0.6},
    }
    with rc_context(style):
        figure = Figure(figsize=(COLUMN, height), layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots(rows, columns, squeeze=False, **shared)
    return figure, list(axes.flat)


def legend_above(figure: Figure, axes: Axes, columns: int = 2) -> None:
    """Add the legend of `axes` above the whole figure."""
    place: Any = {"loc": "outside upper center", "ncols": columns, "frameon": False}
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, fontsize=_FONT["small"], handlelength=2.6, **place)


Table = dict[str, np.ndarray]
"""Named columns of equal length; names end in their SI unit if they have one: `time_s`."""


def long_table(columns: Mapping[str, np.typing.ArrayLike]) -> Table:
    """Return a table of columns that broadcast: one row per element, the last axis fastest."""
    arrays = np.broadcast_arrays(*map(np.asarray, columns.values()))
    return dict(zip(columns, map(np.ravel, arrays), strict=True))


class Reproduction(NamedTuple):
    """A figure, and its numbers as named tables, which the command writes as CSV."""

    figure: Figure
    tables: dict[str, Table]

    def __repr__(self) -> str:
        lines = [
            [name, f"{len(next(iter(table.values())))} rows", ", ".join(table)]
            for name, table in self.tables.items()
        ]
        header = ["tables", "", "columns"]
        return "\n".join(["Reproduction", *text_table(lines, header=header, align="<><", indent=2)])
