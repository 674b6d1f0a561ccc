"""The figure of a sound recording: its loudness, and the sounds used as bounces."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..._entry import rendered, require_kind
from ...plot._drawing.style import axes_of
from ..recordings import Recording

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_BOUNCE, _DOUBTFUL, _OTHER, _LINE = "#0072B2", "#D55E00", "#777777", "#999999"
_POINTS = 4000
_ROOM = 0.06


def sound(recording: Recording, *, ax: Axes | None = None) -> Axes:
    """Draw the level of a sound recording in dB over its noise, with marks at the detected sounds.

    Used bounces have numbers at the first and the last of each drop; doubtful ones and other sounds
    are not used. The level is that after the whitening filter, its maximum in each of at most 4000
    time intervals. Returns the axes, new ones if `ax` is None. Raises ValueError for a recording
    that is not a sound, and for invalid axes.
    """
    require_kind("recording", recording, Recording, "a `Recording` (see `read_recording`)")
    heard = recording.sound
    ax = axes_of(ax, figsize=(8.0, 4.0))
    if heard is None:
        raise ValueError(
            "Argument `recording` must be that of a sound file, but is read from "
            f"{rendered(recording.source)}."
        )
    found = heard.envelope
    level = 10 * np.log10(np.maximum(found.energy / found.noise, 1e-2))
    width = max(-(-level.size // _POINTS), 1)
    time = found.step * np.arange(level.size)
    at = np.arange(0, level.size, width)
    ax.plot(time[at], np.maximum.reduceat(level, at), color=_LINE, lw=0.8)
    top = float(level.max())
    groups = (
        (
            *("v", _BOUNCE, "bounce, used"),
            [one.time for drop in heard.drops for one in drop],
        ),
        ("x", _DOUBTFUL, "doubtful, not used", [o.time for o in heard.others if o.doubtful]),
        (".", _OTHER, "other sound", [o.time for o in heard.others if not o.doubtful]),
    )
    for row, (marker, colour, label, times) in enumerate(groups):
        if times:
            height = np.full(len(times), top * (1 + _ROOM * (3 - row)))
            ax.plot(times, height, marker, color=colour, ms=6, mew=1.5, ls="none", label=label)
    for drop in heard.drops:
        for one in (drop[0], drop[-1]):
            place = one.time, top * (1 + 3.5 * _ROOM)
            ax.annotate(
                str(one.number), place, ha="center", va="bottom", fontsize="small", color=_BOUNCE
            )
    ax.set_ylim(min(0.0, float(np.quantile(level, 0.05))), top * (1 + 6 * _ROOM))
    ax.set_xlim(0, heard.seconds)
    ax.set_xlabel("time $t$ / s")
    ax.set_ylabel("level over the noise / dB")
    ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, frameon=False, fontsize="small")
    return ax
