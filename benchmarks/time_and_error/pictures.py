"""Error against time, one panel for each problem and batch."""

from __future__ import annotations

import itertools
import math
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt

from .reading import Row, batches_of, problems_of, some, ways_of

COLOURS = {
    "ours": ("tab:red",),
    "alone": ("tab:pink",),
    "numba": ("tab:blue",),
    "diffrax": ("tab:green",),
    "scipy": ("tab:orange",),
    # They are many, and all of another kind than the rest.
    "engines": (
        *("tab:purple", "tab:brown", "tab:olive", "tab:cyan", "navy", "darkgreen", "black"),
        *("deeppink", "goldenrod"),
    ),
}
WIDEST = 3
"""Panels beside each other, where there is one batch."""
_STROKES = ("-", "--", ":", "-.")
_MARKS = "osD^vP"
_LEAST_SPAN = 20


def draw(
    rows: list[Row],
    titles: dict[str, str],
    path: Path,
    unit: str,
    head: str,
    batched: str = "batch of",
) -> None:
    """One figure of a group; the better is down and left. `batched`: what numbers of lanes mean."""
    batches = batches_of(rows)
    several = len(batches) > 1
    every = itertools.product(problems_of(rows), batches)
    panels = [(p, b, here) for p, b in every if (here := some(rows, batch=b, problem=p))]
    columns = min(len(panels), len(batches) if several else WIDEST)
    shape = (math.ceil(len(panels) / columns), columns)
    size = (2.3 * columns + 0.6, 2.2 * shape[0] + 1.8)
    fig, axes = plt.subplots(*shape, figsize=size, sharey=True, layout="constrained", squeeze=False)
    lines: dict[str, Any] = {}
    for ax in axes.flat[len(panels) :]:
        ax.remove()
    for ax, (problem, batch, here) in zip(axes.flat, panels, strict=False):
        for way in ways_of(rows):
            points = [row for row in some(here, way=way) if "error" in row]
            if points:
                lines[way] = _line(ax, points, _style(rows, way))
        ax.set(xscale="log", yscale="log")
        low, high = ax.get_xlim()
        if high < _LEAST_SPAN * low:
            # Ticks of less than a decade have labels that overlap.
            middle = math.sqrt(low * high)
            ax.set_xlim(middle / _LEAST_SPAN, middle * _LEAST_SPAN)
        ax.grid(alpha=0.3)
        ax.tick_params(which="both", labelsize=7)
        title = titles[problem] + (f"\n{batched} {batch:,}" if several else "")
        ax.set_title(title, fontsize=8)
    fig.supylabel("relative error", fontsize=9)
    # The legend replaces a label of the axis.
    fig.suptitle(f"{head}: relative error over {unit}", fontsize=10)
    fig.legend(lines.values(), lines.keys(), loc="outside lower center", ncols=columns, fontsize=7)
    fig.savefig(path, dpi=110)
    plt.close(fig)


def _style(rows: list[Row], way: str) -> dict[str, Any]:
    family = some(rows, way=way)[0]["family"]
    place = ways_of(some(rows, family=family)).index(way)
    colours = COLOURS[family]
    return {
        "color": colours[place % len(colours)],
        "linestyle": _STROKES[place % len(_STROKES)],
        "marker": _MARKS[place % len(_MARKS)],
        "markersize": 3.5,
        "linewidth": 1.0,
    }


def _line(ax: Any, points: list[Row], style: dict[str, Any]) -> Any:
    # Independent of the order of measurement.
    points = sorted(points, key=lambda row: row["setting"])
    times, errors = zip(*((row["cost"], row["error"]) for row in points), strict=True)
    return ax.plot(times, errors, **style)[0]
