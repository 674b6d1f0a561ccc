"""The figure of a track: its frames, the parabolas through them, and the impacts between."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from .._calibration import Calibration
from .._measurements import Recording, tracks_of
from .._parameter import rendered
from ._axes import axes_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_USED, _OFF, _OTHER, _LINE = "#0072B2", "#D55E00", "#999999", "#000000"
_UNIT = {"m": " / m", "px": " / px", "": ""}


def track(recording: Recording | Calibration, *, ax: Axes | None = None) -> Axes:
    """Draw the heights of a track over time, with the parabolas that were fitted.

    `recording` is that of a track, or its calibration. Frames that were fitted are full dots,
    misreadings crosses, and others (near impacts, at rest, held) are open ones. Impacts have
    numbers in each drop, and triangles at the floor. Heights are those of the file, upwards.
    Returns the axes, new ones if `ax` is None. Raises ValueError for a recording of something else,
    and for what are no axes.
    """
    records: Iterable[Any] = ()
    if isinstance(recording, Calibration):
        records = [one for pair in recording.pairs.records for one in pair]
    elif isinstance(recording, Recording):
        records = recording.records
    tracks = tracks_of(records)
    ax = axes_of(ax, figsize=(8.0, 4.0))
    if not tracks:
        raise ValueError(
            "Argument `recording` must be that of a track, or its calibration, but is "
            f"{rendered(recording)}."
        )
    for k, one in enumerate(tracks):
        frames = one.frames
        used, off = np.zeros(frames.time.size, bool), np.zeros(frames.time.size, bool)
        for drop in one.drops:
            used, off = used | drop.used, off | drop.off
        groups = (
            (used, {"marker": ".", "ms": 4, "color": _USED}, "frame, used"),
            (off, {"marker": "x", "ms": 5, "color": _OFF}, "frame off the parabolas"),
            (
                ~used & ~off,
                {"marker": "o", "ms": 2.5, "mfc": "none", "mew": 0.6, "color": _OTHER},
                "other frame",
            ),
        )
        for where, style, label in groups:
            if where.any():
                name = label if k == 0 else None
                ax.plot(frames.time[where], frames.height[where], ls="none", label=name, **style)
        for drop in one.drops:
            ax.plot(frames.time, drop.fitted, color=_LINE, lw=0.8)
            floor = np.interp(drop.impact, frames.time, drop.fitted)
            ax.plot(drop.impact, floor, "^", color=_USED, ms=6)
            for number, (time, height) in enumerate(zip(drop.impact, floor, strict=True), 1):
                ax.annotate(
                    str(number),
                    (time, height),
                    (0, -6),
                    textcoords="offset points",
                    ha="center",
                    va="top",
                    fontsize="small",
                    color=_USED,
                )
        for skipped in one.skipped:
            ax.axvline(skipped.time, color=_OFF, lw=0.6, ls=":")
    inside = np.concatenate([d.fitted[np.isfinite(d.fitted)] for t in tracks for d in t.drops])
    room = 0.15 * float(np.ptp(inside))
    # Misreadings may lie far outside of the picture of the ball.
    held = [float(t.frames.height[d.used].max()) for t in tracks for d in t.drops]
    ax.set_ylim(float(inside.min()) - 1.3 * room, max(float(inside.max()), *held) + room)
    ax.set_xlabel("time $t$ / s")
    ax.set_ylabel(f"height{_UNIT[tracks[0].frames.unit]}")
    ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, frameon=False, fontsize="small")
    return ax
