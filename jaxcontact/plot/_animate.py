"""The animation of a run."""

from __future__ import annotations

import contextlib
import inspect
import itertools
import pathlib
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import animation, pyplot, rcParams
from matplotlib.collections import LineCollection
from matplotlib.patches import Circle

from .._entry import POSITIVE, refusal, require_count, require_number, require_path
from .._scene import EngineRun, Run
from .._system import SystemRun
from ._drawing.path import (
    axes_shown,
    images,
    line_of,
    path_of,
    radii,
    require_one_run,
    require_one_system_run,
    states,
    touches,
    turned,
)
from ._drawing.style import BODIES, GUIDE, axes_of
from ._drawing.surroundings import colours, draw_walls, frame
from ._scene import frame_axes

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    Show = Callable[[int], list[Artist]]

_WIDTH, _LOW, _HIGH = 5.0, 1.4, 5.4
"""Width of a new figure in inches, and its smallest and largest height."""

_TAIL, _FADE = 0.08, 0.05
"""Fractions of the run: shown as the tail of a sphere, and in which a flash fades."""

_FLASH, _LARGE = "#F0E442", 160.0
"""Colour of a flash (the yellow of Okabe & Ito), and its size at first in square points."""

_LINE = "#333333"


class Animation(animation.FuncAnimation):
    """An animation that a notebook shows with buttons, and that `save` writes to a file."""

    def __init__(self, figure: Figure, draw: Show, **options: Any):
        super().__init__(figure, draw, **options)
        self.figure = figure

    def _repr_html_(self) -> str:
        # Without this the notebook would also show the figure as a still picture.
        pyplot.close(self.figure)
        return self.to_jshtml()

    def save(self, filename: str | pathlib.Path, writer: Any = None, **options: Any) -> None:
        """Write the film as .gif, or by ffmpeg as .mp4 or another of its formats.

        The arguments are those of matplotlib. Without a `writer`, the name of the file selects it.
        Raises ValueError if ffmpeg is needed and not installed.
        """
        path = require_path("filename", filename)
        if writer is None:
            writer = "pillow" if path.suffix.lower() == ".gif" else "ffmpeg"
        if writer == "ffmpeg" and not animation.writers.is_available(writer):
            with contextlib.suppress(ImportError):
                import imageio_ffmpeg  # pyright: ignore[reportMissingImports]

                rcParams["animation.ffmpeg_path"] = imageio_ffmpeg.get_ffmpeg_exe()
        if writer == "ffmpeg" and not animation.writers.is_available(writer):
            raise ValueError(
                f"Argument `filename` must end in .gif, but is {str(path)!r}: other films need "
                "ffmpeg. Install it, or run `pip install imageio-ffmpeg`."
            )
        super().save(path, writer=writer, **options)


def animate(
    run: Run | EngineRun | SystemRun,
    *,
    seconds: float = 6.0,
    fps: int = 25,
    draw: Callable[..., Any] | None = None,
    axes: Sequence[int] | None = None,
    ax: Axes | None = None,
) -> Animation:
    """Animate a run: spheres or a mechanism in motion, contacts that flash, and the time.

    Spheres have short tails and, if they spin, a radius that turns. The samples of an `EngineRun`
    are joined by straight lines; its impacts are not known.

    A mechanism is drawn by `draw(q, args)`, or by `draw(t, q, args)` if time matters. It returns
    points (P, 2) in m, those where the gaps close first, and a list of lines (L, 2) in m. The k-th
    point flashes while the k-th gap is in contact. Mechanisms of `jaxcontact.systems` have a `draw`
    of their own: without one here, that of the object `system.gap` is used.

    Arguments: a single run; the length of the film in `seconds`, and its frames per second; `draw`,
    for a mechanism; `axes`, the two axes of space to draw, such as (0, 2), required for spheres in
    three dimensions; `ax`, the axes of matplotlib to draw on, new ones if None. Spheres in one
    dimension move along a line.

    Returns a matplotlib animation, which a notebook displays. `animation.save("run.gif")` writes a
    GIF, "run.mp4" an MP4. Keep a reference to it while it is shown. Raises ValueError for numbers
    out of range, other axes, a batch of runs, a run without values, and for anything but a run. So
    does a mechanism without `draw`, and a `draw` that returns anything else.
    """
    mechanism = require_one_system_run(run) if isinstance(run, SystemRun) else None
    spheres = require_one_run(run) if mechanism is None else None
    count = round(require_number("seconds", seconds, POSITIVE) * require_count("fps", fps, 1))
    time = np.linspace(0, float(run.reached), max(count, 2))
    if spheres is not None:
        if draw is not None:
            raise refusal("draw", "be None for a run of spheres", draw)
        ax, show = _spheres(spheres, time, axes_shown(axes, spheres.scene.dimensions), ax)
    else:
        assert mechanism is not None
        if axes is not None:
            raise refusal("axes", "be None for a mechanism, whose `draw` chooses them", axes)
        ax, show = _mechanism(mechanism, time, draw, ax)
    title = ax.set_title(" ", loc="left", fontsize="medium")
    digits = max(0, 2 - int(np.floor(np.log10(time[-1]))))

    def show_with_time(k: int) -> list[Artist]:
        title.set_text(f"$t$ = {time[k]:.{digits}f} s")
        return [*show(k), title]

    figure = ax.get_figure(root=True)
    assert figure is not None  # created with these axes, or by the user
    return Animation(figure, show_with_time, frames=len(time), interval=1000 / fps)


def _axes(ax: Axes | None, shown: tuple[int, ...], low: np.ndarray, high: np.ndarray) -> Axes:
    """Return the given axes, or new ones of a suitable height, with these limits."""
    width, height = high - low
    ax = axes_of(ax, figsize=(_WIDTH, min(max(_WIDTH * height / width + 0.9, _LOW), _HIGH)))
    frame_axes(ax, shown, low, high)
    return ax


def _spheres(
    run: Run | EngineRun, time: np.ndarray, shown: tuple[int, ...], ax: Axes | None
) -> tuple[Axes, Show]:
    """Draw spheres and walls, and return a function that moves them to the k-th time."""
    path = path_of(run)
    low, high = frame(run, path.position, shown)
    if len(shown) == 1:
        reach = 1.5 * np.max(radii(run))
        low, high = np.append(low, -reach), np.append(high, reach)
    ax = _axes(ax, shown, low, high)
    move_walls = draw_walls(ax, run, shown, time)
    away, size = images(run, shown), radii(run)
    if len(shown) == 1:
        away = _on_paper(away, shown)
    circles, tails = [], []
    for colour, radius in zip(colours(run), size, strict=True):
        look = {"facecolor": colour, "edgecolor": colour, "alpha": 0.8, "zorder": 3}
        circles.append([ax.add_patch(Circle((0.0, 0.0), radius, **look)) for _ in away])
        tails += ax.plot([], [], color=colour, ls="-", lw=1.2, alpha=0.5, zorder=2)
    now = _on_paper(states(run, time).position, shown)
    before = [line_of(run, path, row) for row in range(now.shape[1])]
    before = [(times, _on_paper(line, shown)) for times, line in before]
    angle = turned(path, time, shown)
    marks = LineCollection([], colors="white", linewidths=1.5, zorder=3.5)
    ax.add_collection(marks)
    when, where = touches(run)
    flash = _flashes(ax, time, when, when)
    where = _on_paper(where, shown)

    def show(k: int) -> list[Artist]:
        for row, (images_of_sphere, line) in enumerate(zip(circles, tails, strict=True)):
            for circle, shift in zip(images_of_sphere, away, strict=True):
                circle.set_center(tuple(now[k, row] + shift))
            times, places = before[row]
            recent = (times >= time[k] - _TAIL * time[-1]) & (times <= time[k])
            line.set_data(*places[recent].T)
        if angle is not None:
            rim = size[:, None] * np.stack([np.cos(angle[k]), np.sin(angle[k])], axis=-1)
            radius = np.stack([now[k], now[k] + rim], axis=1)
            marks.set_segments([*(radius + away[:, None, None]).reshape(-1, 2, 2)])
        return [*itertools.chain(*circles), *tails, marks, *move_walls(k), flash(k, where)]

    return ax, show


def _on_paper(position: np.ndarray, shown: tuple[int, ...]) -> np.ndarray:
    """Return positions (..., 2) along the axes shown; one dimension becomes a line."""
    if len(shown) == 1:
        return np.concatenate([position, np.zeros_like(position)], axis=-1)
    return position[..., list(shown)]


def _flashes(ax: Axes, time: np.ndarray, start: np.ndarray, end: np.ndarray) -> Any:
    """Return a function that draws contacts from `start` to `end` (K,) in s at the k-th time.

    It takes their places (K, 2), and returns the artist. After the end a flash fades.
    """
    look: dict[str, Any] = {"color": _FLASH, "edgecolor": "#D55E00", "alpha": 0.75, "zorder": 5}
    dots = ax.scatter([], [], **look)

    def show(k: int, places: np.ndarray) -> Artist:
        late = np.clip(1 - (time[k] - end) / (_FADE * time[-1]), 0, 1)
        glow = np.where(start <= time[k], late, 0)
        dots.set_offsets(places[glow > 0])
        dots.set_sizes(_LARGE * glow[glow > 0])
        return dots

    return show


def _mechanism(
    run: SystemRun, time: np.ndarray, draw: Callable[..., Any] | None, ax: Axes | None
) -> tuple[Axes, Show]:
    """Draw a mechanism, and return a function that moves it to the k-th time."""
    points, shapes = _pictures(run, time, draw)
    everything = np.concatenate([points.reshape(-1, 2), *itertools.chain(*shapes)])
    low, high = np.nanmin(everything, axis=0), np.nanmax(everything, axis=0)
    margin = 0.06 * np.max(high - low) or 1.0
    ax = _axes(ax, (0, 1), low - margin, high + margin)
    # Lines that do not move are those of the surroundings.
    fixed = map(np.array_equal, shapes[0], shapes[len(shapes) // 2])
    look = {"colors": [(_LINE, GUIDE)[still] for still in fixed] or _LINE, "linewidths": 2.0}
    lines = LineCollection([], capstyle="round", zorder=2, **look)
    ax.add_collection(lines)
    dots = []
    for colour, _ in zip(itertools.cycle(BODIES), points[0], strict=False):
        dots += ax.plot([], [], "o", color=colour, ms=5, zorder=4)
    table = run.contacts.to_dict()
    gap, start = table["gap"].astype(int), table["time"]
    # A contact in progress at the end has no duration.
    end = start + np.nan_to_num(table["duration"], nan=time[-1])
    there = gap < points.shape[1]
    gap, flash = gap[there], _flashes(ax, time, start[there], end[there])

    def show(k: int) -> list[Artist]:
        lines.set_segments(shapes[k])
        for dot, place in zip(dots, points[k], strict=True):
            dot.set_data(*place[:, None])
        return [lines, *dots, flash(k, points[k, gap])]

    return ax, show


def _pictures(
    run: SystemRun, time: np.ndarray, draw: Callable[..., Any] | None
) -> tuple[np.ndarray, list[list[np.ndarray]]]:
    """Return the points (T, P, 2) and the lines (L, 2) of a mechanism at each time."""
    mechanics = run.margin._problem.mechanics
    draw = getattr(mechanics.system.gap, "draw", None) if draw is None else draw
    if not callable(draw):
        function = "be a function draw(q, args) that returns points and lines of this mechanism"
        raise refusal("draw", function, draw)
    given = inspect.signature(draw).parameters.values()
    timeless = sum(one.default is one.empty for one in given) == 2
    points, shapes = [], []
    for t, q in zip(time, np.asarray(run.at(time).position), strict=True):
        value = draw(q, mechanics.args) if timeless else draw(t, q, mechanics.args)
        try:
            arrays = [np.asarray(x, float) for x in (value[0], *value[1])]
        except (IndexError, KeyError, TypeError, ValueError):
            arrays = [np.zeros(0)]
        if any(x.ndim != 2 or x.shape[-1] != 2 for x in arrays):
            raise refusal("draw", "return points (P, 2) and a list of lines (L, 2)", value)
        points.append(arrays[0])
        shapes.append(arrays[1:])
        if len(points[0]) != len(points[-1]) or not np.isfinite(np.concatenate(arrays)).any():
            raise refusal("draw", "return points or lines, and as many points each time", value)
    return np.stack(points), shapes
