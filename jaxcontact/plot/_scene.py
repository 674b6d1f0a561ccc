"""Plots of runs: of scenes as world lines or paths, of mechanisms over time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from .._entry import is_list, refusal, require_count, require_kind
from .._scene import EngineRun, Run
from .._system import SystemRun, SystemStates
from ._drawing.labels import put_label
from ._drawing.path import (
    RunPath,
    axes_shown,
    images,
    line_of,
    path_of,
    radii,
    require_one_run,
    require_one_system_run,
    touches,
)
from ._drawing.style import axes_of, legend_above, require_label
from ._drawing.surroundings import colours, draw_levels, draw_walls, frame, labels, lines

if TYPE_CHECKING:
    from matplotlib.axes import Axes

NAMES = "xyz"
Labels = str | Sequence[str] | None
_WIDTH, _LOW, _HIGH = 6.4, 2.6, 7.2
"""Width of a new figure in inches, and its smallest and largest height."""

_FEW = 40
"""Number of impacts up to which marks have full size."""


def scene(
    run: Run | EngineRun, *, axes: Sequence[int] | None = None, ax: Axes | None = None
) -> Axes:
    """Draw a run: positions over time in one dimension, the paths in two.

    In one dimension every sphere is a band of its diameter over time in s. In two dimensions it is
    a circle, faint at the start and full at the end, with the path of its centre. Dots mark where
    surfaces met. Walls are grey on their solid side, and light grey where a moving wall has been.
    In periodic space images are drawn in the first cell.

    Arguments: a single run, also an `EngineRun`; `axes`, the two axes of space to draw, such as
    (0, 2), required in three dimensions; `ax`, the axes of matplotlib to draw on, new ones if None.
    In a projection spheres may hide each other, and a wall is drawn only if it is seen edge-on. An
    `EngineRun` has no dots, as its impacts are not known. Returns the axes. Raises ValueError for
    other axes, a batch of runs, a run without values, and for anything but a run.
    """
    require_one_run(run)
    shown = axes_shown(axes, run.scene.dimensions)
    path = path_of(run)
    low, high = frame(run, path.position, shown)
    if len(shown) == 1:
        ax = axes_of(ax, figsize=(_WIDTH, 4.4))
        _draw_world_lines(ax, run, path)
        ax.set_xlim(0, path.time[-1])
        ax.set_ylim(low[0], high[0])
        draw_levels(ax, run)
        put_label(ax.xaxis, "time")
        put_label(ax.yaxis, "position", "$x$")
    else:
        width, height = high - low
        tall = min(max(_WIDTH * height / width, _LOW), _HIGH)
        ax = axes_of(ax, figsize=(_WIDTH, tall))
        frame_axes(ax, shown, low, high)
        draw_walls(ax, run, shown)
        _draw_paths(ax, run, path, shown)
        _, places = touches(run)
        _mark(ax, *places[:, list(shown)].T)
    if labels(run):
        legend_above(ax)
    return ax


def frame_axes(ax: Axes, shown: tuple[int, ...], low: np.ndarray, high: np.ndarray) -> None:
    """Set up axes of space with equal scales; one dimension is horizontal."""
    ax.set_xlim(low[0], high[0])
    ax.set_ylim(low[1], high[1])
    ax.set_aspect("equal")
    pair = (ax.xaxis, ax.yaxis), (ax.yaxis, ax.xaxis)
    for (axis, other), number in zip(pair, shown, strict=False):
        put_label(axis, "position", f"${NAMES[number]}$", beside=other)
    if len(shown) == 1:
        ax.set_yticks([])


def _draw_world_lines(ax: Axes, run: Run | EngineRun, path: RunPath) -> None:
    names = labels(run)
    looks = zip(colours(run), lines(run), radii(run), strict=True)
    for k, (colour, dashes, radius) in enumerate(looks):
        time, line = line_of(run, path, k)
        line = line[:, 0]
        for away in images(run, (0,))[:, 0]:
            band = line + away - radius, line + away + radius
            ax.fill_between(time, *band, color=colour, alpha=0.3, lw=0)
        ax.plot(time, line, color=colour, ls=dashes, lw=1.2, label=names[k] if names else None)
    when, where = touches(run)
    _mark(ax, when, where[:, 0])


def _draw_paths(ax: Axes, run: Run | EngineRun, path: RunPath, shown: tuple[int, ...]) -> None:
    from matplotlib.patches import Circle

    names = labels(run)
    many = len(run.scene.spheres) > len(set(colours(run)))
    # Dashes of one path would be lost among many paths.
    dashes = ["-"] * len(radii(run)) if many else lines(run)
    looks = zip(colours(run), dashes, radii(run), strict=True)
    for k, (colour, dash, radius) in enumerate(looks):
        line = line_of(run, path, k)[1][:, list(shown)]
        ax.plot(*line.T, color=colour, ls=dash, lw=0.8 if many else 1.2, alpha=0.7, zorder=2)
        for n, shift in enumerate(images(run, shown)):
            start, end = (Circle(tuple(line[row] + shift), radius) for row in (0, -1))
            start.set(facecolor="none", edgecolor=colour, ls=":", alpha=0.8, zorder=1.5)
            end.set(facecolor=colour, edgecolor=colour, alpha=0.6, zorder=3)
            end.set_label(names[k] if names and n == 0 else "_")
            ax.add_patch(start)
            ax.add_patch(end)


def _mark(ax: Axes, x: np.ndarray, y: np.ndarray) -> None:
    size = 4.0 if len(x) <= _FEW else max(1.0, 4.0 * math.sqrt(_FEW / len(x)))
    ax.plot(x, y, ".", color="black", ms=2 * math.sqrt(size) + 2, mew=0, zorder=4)


_OVER_ALL, _OF_CONTACT = 400, 24
"""The number of points over a run, and within each contact."""


def gaps(run: SystemRun, *, label: Labels = None, ax: Axes | None = None) -> Axes:
    """Draw the gaps of a mechanism over time (m, s).

    Arguments: a single run of a `System`; `label`, a name for each gap, "gap 0" and so on if None;
    the axes to draw on, new ones if None. Returns the axes. Raises ValueError for a batch of runs,
    another number of names, and for anything but such a run.
    """
    return _over_time(run, "gap", label, ax)


def forces(run: SystemRun, *, label: Labels = None, ax: Axes | None = None) -> Axes:
    """Draw the contact forces of a mechanism over time (N, s).

    Arguments: a single run of a `System`; `label`, a name for each gap, "gap 0" and so on if None;
    the axes to draw on, new ones if None. Returns the axes. Raises ValueError for a batch of runs,
    another number of names, and for anything but such a run.
    """
    return _over_time(run, "force", label, ax)


def phase(
    run: SystemRun,
    coordinate: int = 0,
    *,
    units: Sequence[str] | None = None,
    label: str | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Draw the speed of a coordinate of a mechanism over its position.

    Arguments: a single run of a `System`; the number of the coordinate; the `units` of position and
    speed, such as ("rad", "rad/s"), for the axes; a `label` for the legend; the axes to draw on,
    new ones if None. Returns the axes. Raises ValueError for a batch of runs, for anything but such
    a run, and for a coordinate that it does not have.
    """
    states, number = _path(run), require_count("coordinate", coordinate, 0)
    require_label(label)
    written = ("", "") if units is None else _names("units", units, 2)
    count = min(run.position.shape[1], run.velocity.shape[1])
    if number >= count:
        raise ValueError(f"Argument `coordinate` must be below {count}, but is {coordinate}.")
    ax = axes_of(ax)
    line = np.asarray(states.position)[:, number], np.asarray(states.velocity)[:, number]
    ax.plot(*line, lw=1.2, label=label)
    for axis, word, unit in zip((ax.xaxis, ax.yaxis), ("position", "speed"), written, strict=True):
        put_label(axis, word, f"{word} {number}", unit)
    legend_above(ax)
    return ax


def _names(argument: str, value: Any, count: int) -> list[str]:
    """Return so many texts; ValueError for anything else."""
    texts = list(value) if is_list(value) else [value]
    words = "a text or None" if count == 1 else f"a list of {count} texts or None"
    if len(texts) != count:
        raise refusal(argument, f"be {words}", value)
    return [require_kind(argument, text, str, words) for text in texts]


def _over_time(run: SystemRun, name: str, label: Labels, ax: Axes | None) -> Axes:
    states = _path(run)
    values: Any = np.asarray(getattr(states, name))
    count = values.shape[1]
    names = [f"gap {k}" for k in range(count)] if label is None else _names("label", label, count)
    ax = axes_of(ax)
    for k, text in enumerate(names):
        ax.plot(states.time, values[:, k], lw=1.2, label=text)
    ax.set_xlim(0, float(run.reached))
    put_label(ax.xaxis, "time")
    put_label(ax.yaxis, *{"gap": ("indentation", "gap"), "force": ("force", "contact force")}[name])
    legend_above(ax)
    return ax


def _path(run: SystemRun) -> SystemStates:
    """Return the states of a single run at times that show every contact."""
    require_one_system_run(run)
    end, table = float(run.reached), run.contacts.to_dict()
    lasts = np.where(np.isfinite(table["duration"]), table["duration"], end - table["time"])
    inside = table["time"][:, None] + lasts[:, None] * np.linspace(0, 1, _OF_CONTACT)[None]
    times = np.unique(np.concatenate([np.linspace(0, end, _OVER_ALL), inside.ravel()]))
    return run.at(times[(times >= 0) & (times <= end)])
