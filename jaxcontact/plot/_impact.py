"""The plot of one impact: its hysteresis loop, and its course in time."""

from __future__ import annotations

from typing import Any

import numpy as np

from .._entry import require_kind
from .._impact import Impact, Trajectory
from .._text.units import quantity
from ._drawing.axes import axes_for
from ._drawing.style import GUIDE, legend_above
from ._trajectory import require_one_path, trajectory

_PICTURES = (("indentation", "force"), ("time", "force"), ("time", "velocity"))


def impact(
    path: Trajectory, hit: Impact | None = None, *, ax: Any = None, label: str | None = None
) -> np.ndarray:
    """Draw one impact: its force over the indentation and over time, and its speed over time.

    The area of the loop is the energy lost. With `hit`, dotted lines mark the results of the
    `Impact`: the largest force and indentation, the ends of compression and contact, and the
    rebound speed. The title states e and the energy lost.

    Arguments: a single `path`, from `trajectory`; the `hit` of the same impact, from `impact`;
    three axes to draw on, new ones if None; a `label` for the legend. Pass the axes of another
    impact to draw both. Returns the three axes, (3,). Raises ValueError for a batch, a path without
    values, and for anything but a trajectory, impact, text and axes.
    """
    require_one_path(path)
    if label is not None:
        require_kind("label", label, str, "a text or None")
    if hit is not None:
        require_kind("hit", hit, Impact, "an `Impact` (see `impact`) or None")
        if np.ndim(hit.restitution) > 0:
            raise ValueError(
                "Argument `hit` must be a single impact, but has the shape "
                f"{hit.restitution.shape}."
            )
    loop, force, speed = axes = axes_for(ax, 3, "picture")
    for picture, (x, y) in zip(axes, _PICTURES, strict=True):
        trajectory(path, x=x, y=y, ax=picture, label=label)
    colour = loop.lines[-1].get_color()
    loop.fill(path.indentation, path.force, color=colour, alpha=0.12, lw=0)
    speed.axhline(0, color=GUIDE, lw=0.8, zorder=1)
    if hit is not None:
        across = [(loop, hit.max_force), (force, hit.max_force), (speed, -hit.rebound_velocity)]
        up = [(loop, hit.max_indentation)]
        up += [(one, at) for one in (force, speed) for at in (hit.compression_time, hit.duration)]
        for line, where in (("axhline", across), ("axvline", up)):
            for picture, at in where:
                # A contact that settles has an infinite duration.
                if np.isfinite(at):
                    getattr(picture, line)(float(at), color=colour, ls=":", lw=0.9, zorder=1)
        lost = quantity("energy_loss", f"{float(hit.energy_loss):.3g}")
        words = f"$e$ = {float(hit.restitution):.3f}, {lost} lost"
        speed.set_title(words, loc="left", fontsize="small")
    if label is not None:
        legend_above(loop)
    return np.array(axes)
