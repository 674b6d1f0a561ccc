"""The figure of a track: its frames, the fitted parabolas, and the impacts between them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..._entry import rendered
from ...plot._drawing.style import axes_of
from ..calibration.calibrate import Calibration
from ..recordings import Recording, tracks_of
from ..track import Drop, Track

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_USED, _OFF, _OTHER, _LINE = "#0072B2", "#D55E00", "#999999", "#000000"
_UNIT = {"": "", "m": " / m", "px": " / px"}
_ROOM = 0.15
"""Margin above and below, as a fraction of the range of heights."""


def track(recording: Recording | Calibration, *, ax: Axes | None = None) -> Axes:
    """Draw the heights of a track over time, with the fitted parabolas.

    `recording` is that of a track, or its calibration. Fitted frames are full dots, misreadings
    crosses, and others (near impacts, held, at rest) open circles. Impacts are triangles with their
    numbers in the drop; dotted lines mark doubtful impacts that are not used. Heights are those of
    the file; if they count downwards, so does the axis. Returns the axes, new ones if `ax` is None.
    Raises ValueError for other recordings, and for invalid axes.
    """
    tracks: tuple[Track, ...] = ()
    if isinstance(recording, Calibration):
        tracks = tracks_of(one for pair in recording.recorded_pairs.records for one in pair)
    elif isinstance(recording, Recording):
        tracks = recording.tracks
    ax = axes_of(ax, figsize=(8.0, 4.0))
    if not tracks:
        raise ValueError(
            "Argument `recording` must be that of a track, or its calibration, but is "
            f"{rendered(recording)}."
        )
    frames = tracks[0].frames
    for number, one in enumerate(tracks):
        _frames(ax, one, labels=number == 0)
        for drop in one.drops:
            _drop(ax, drop)
        for skipped in one.skipped:
            ax.axvline(skipped.time, color=_OFF, lw=0.6, ls=":")
    low, high = _range([drop for one in tracks for drop in one.drops])
    ax.set_ylim(*sorted((frames.sign * low, frames.sign * high)))
    if frames.sign < 0:
        ax.invert_yaxis()
    ax.set_xlabel("time $t$ / s")
    ax.set_ylabel(f"height{_UNIT[frames.unit]}")
    ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, frameon=False, fontsize="small")
    return ax


def _frames(ax: Axes, track: Track, labels: bool) -> None:
    frames = track.frames
    used, off = (
        np.any([getattr(drop, name) for drop in track.drops], axis=0) for name in ("used", "off")
    )
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
            height = frames.sign * frames.height[where]
            name = label if labels else None
            ax.plot(frames.time[where], height, ls="none", label=name, **style)


def _drop(ax: Axes, drop: Drop) -> None:
    sign = drop.frames.sign
    inside = np.isfinite(drop.fitted)
    time = np.concatenate([drop.frames.time[inside], drop.impact])
    height = np.concatenate([drop.fitted[inside], drop.floor])
    order = np.argsort(time)
    ax.plot(time[order], sign * height[order], color=_LINE, lw=0.8)
    ax.plot(drop.impact, sign * drop.floor, "^", color=_USED, ms=6)
    for number, place in enumerate(zip(drop.impact, sign * drop.floor, strict=True), 1):
        ax.annotate(
            str(number),
            place,
            (0, -6),
            textcoords="offset points",
            ha="center",
            va="top",
            fontsize="small",
            color=_USED,
        )


def _range(drops: Sequence[Drop]) -> tuple[float, float]:
    """Return the range of heights of the ball; misreadings may lie far outside."""
    fitted = np.concatenate([drop.fitted[np.isfinite(drop.fitted)] for drop in drops])
    used = np.concatenate([drop.frames.height[drop.used] for drop in drops])
    low, high = float(fitted.min()), float(max(fitted.max(), used.max()))
    room = _ROOM * (high - low)
    return low - 1.3 * room, high + room
