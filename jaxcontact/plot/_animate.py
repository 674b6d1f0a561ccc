"""The animation of a run."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import pyplot
from matplotlib.animation import FuncAnimation
from matplotlib.patches import Circle

from .._entry import POSITIVE, require_count, require_number
from .._scene import Run
from ._drawing.path import axes_shown, images, line_of, path_of, radii, require_one_run, states
from ._drawing.style import axes_of
from ._drawing.surroundings import colours, frame, moving_walls
from ._scene import frame_axes

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

_WIDTH, _LOW, _HIGH = 5.0, 1.4, 5.4
"""Width of a new figure in inches, and its smallest and largest height."""

_TAIL = 0.08
"""Fraction of the run shown as the tail of a sphere."""


class Animation(FuncAnimation):
    """An animation that a notebook shows with buttons."""

    def __init__(self, figure: Figure, draw: Callable[[int], list[Artist]], **options: Any):
        super().__init__(figure, draw, **options)
        self.figure = figure

    def _repr_html_(self) -> str:
        # Without this the notebook would also show the figure as a still picture.
        pyplot.close(self.figure)
        return self.to_jshtml()


def animate(
    run: Run,
    *,
    seconds: float = 6.0,
    fps: int = 25,
    axes: Sequence[int] | None = None,
    ax: Axes | None = None,
) -> Animation:
    """Animate a run: circles with short tails, walls, and the time.

    Arguments: a single run; the length of the film in `seconds`, and its frames per second; `axes`,
    the two axes of space to draw, such as (0, 2), required in three dimensions; `ax`, the axes of
    matplotlib to draw on, new ones if None. Spheres in one dimension move along a line.

    Returns a matplotlib animation, which a notebook displays. `animation.save("run.gif",
    writer="pillow")` writes a GIF. Keep a reference to it while it is shown. Raises ValueError for
    numbers out of range, other axes, a batch of runs, a run without values, and for anything but a
    run.
    """
    require_one_run(run)
    count = round(require_number("seconds", seconds, POSITIVE) * require_count("fps", fps, 1))
    shown = axes_shown(axes, run.scene.dimensions)
    path = path_of(run)
    frames = states(run, np.linspace(0, float(run.reached), max(count, 2)))
    low, high = frame(run, path.position, shown)
    if len(shown) == 1:
        reach = 1.5 * np.max(radii(run))
        low, high = np.append(low, -reach), np.append(high, reach)
    width, height = high - low
    tall = min(max(_WIDTH * height / width + 0.9, _LOW), _HIGH)
    ax = axes_of(ax, figsize=(_WIDTH, tall))
    frame_axes(ax, shown, low, high)
    move_walls = moving_walls(ax, run, shown, frames.time)
    away = images(run, shown)
    if len(shown) == 1:
        away = _on_paper(away, shown)
    circles, tails = _draw(ax, run, len(away))
    title = ax.set_title(" ", loc="left", fontsize="medium")
    now = _on_paper(frames.position, shown)
    before = [line_of(run, path, row) for row in range(now.shape[1])]
    before = [(time, _on_paper(line, shown)) for time, line in before]
    digits = max(0, 2 - int(np.floor(np.log10(float(run.reached)))))

    def draw(k: int) -> list[Artist]:
        time = frames.time[k]
        since = time - _TAIL * frames.time[-1]
        for row, (images_of_sphere, line) in enumerate(zip(circles, tails, strict=True)):
            for circle, shift in zip(images_of_sphere, away, strict=True):
                circle.set_center(tuple(now[k, row] + shift))
            times, places = before[row]
            line.set_data(*places[(times >= since) & (times <= time)].T)
        title.set_text(f"$t$ = {time:.{digits}f} s")
        return [*itertools.chain(*circles), *tails, *move_walls(k), title]

    figure = ax.get_figure(root=True)
    assert figure is not None  # created with these axes, or by the user
    return Animation(figure, draw, frames=len(frames.time), interval=1000 / fps)


def _draw(ax: Axes, run: Run, images: int) -> tuple[list[list[Circle]], list[Line2D]]:
    """Create the circles of each sphere, one per image, and its tail."""
    circles, tails = [], []
    for colour, radius in zip(colours(run), radii(run), strict=True):
        look = {"facecolor": colour, "edgecolor": colour, "alpha": 0.8, "zorder": 3}
        shapes = [Circle((0.0, 0.0), radius, **look) for _ in range(images)]
        circles.append([ax.add_patch(circle) for circle in shapes])
        tails += ax.plot([], [], color=colour, ls="-", lw=1.2, alpha=0.5, zorder=2)
    return circles, tails


def _on_paper(position: np.ndarray, shown: tuple[int, ...]) -> np.ndarray:
    """Return positions (..., 2) along the axes shown; one dimension becomes a line."""
    if len(shown) == 1:
        return np.concatenate([position, np.zeros_like(position)], axis=-1)
    return position[..., list(shown)]
