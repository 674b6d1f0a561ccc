"""The style of all figures: column width, colours for any colour vision, one style per law."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

from ...extend import label

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
    colour: str
    style: str


# Okabe and Ito's colours; the dashes distinguish the laws in grey.
FOUR_LAWS = (
    PaperLaw("a", "Lankarani-Nikravesh", "lankarani_nikravesh", "#56B4E9", "-."),
    PaperLaw("b", "Hunt-Crossley", "hunt_crossley", "#E69F00", "--"),
    PaperLaw("c", "Flores et al.", "flores", "#009E73", ":"),
    PaperLaw("d", "Hu-Guo", "hu_guo", "#0072B2", "-"),
)

RESTITUTIONS = (1.0, 0.8, 0.6, 0.4, 0.2)
"""The values of e in Figs. 8 to 10."""

# Dark to light, ordered by brightness: samples of matplotlib's cividis.
SHADES = dict(
    zip(RESTITUTIONS, ("#00224E", "#35456C", "#666970", "#948E77", "#C8B866"), strict=True)
)

VELOCITY = label("velocity", "velocity")
"""The label of the velocity of deformation, which changes sign."""

REFERENCE = {"color": "black", "linestyle": (0, (5, 2)), "linewidth": 0.8}
"""Style of the ideal result: the exact diagonal."""


def sheet(
    rows: int = 1,
    columns: int = 1,
    *,
    height: float = 2.4,
    sharex: bool = False,
    sharey: bool = False,
) -> tuple[Figure, list[Axes]]:
    """Create a figure with its axes, row by row, on its own canvas without a display.

    `height` of the whole in inches; `sharex` and `sharey` as in matplotlib.
    """
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    style: dict[Any, Any] = {
        "font.size": _FONT["size"],
        "axes.labelsize": _FONT["size"],
        "axes.titlesize": _FONT["size"],
        "xtick.labelsize": _FONT["small"],
        "ytick.labelsize": _FONT["small"],
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.linewidth": 0.6,
    }
    with rc_context(style):
        figure = Figure(figsize=(COLUMN, height), layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots(rows, columns, squeeze=False, sharex=sharex, sharey=sharey)
    return figure, list(axes.flat)


def legend_above(figure: Figure, axes: Axes, columns: int = 2) -> None:
    """Add the legend of `axes` above the whole figure."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(
        handles,
        labels,
        loc="outside upper center",
        ncols=columns,
        frameon=False,
        fontsize=_FONT["small"],
        handlelength=2.6,
    )
