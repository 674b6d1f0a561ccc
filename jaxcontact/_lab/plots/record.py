"""The figure of an instrument record: the separated impacts and their fits."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..._entry import rendered
from ...plot._drawing.style import axes_for, axes_of
from ..calibration.calibrate import Calibration
from ..recordings import RecordedImpact, Recording

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_LINE, _USED, _DOUBTFUL = "#999999", "#0072B2", "#D55E00"
_POINTS = 4000
_SHOWN = 6
_LABEL = {
    "force": "force / N",
    "acceleration": "acceleration / (m/s²)",
    "indentation": "indentation / m",
}


def record(recording: Recording | Calibration, *, ax: Any = None) -> Any:
    """Draw the record of an instrument with the impacts separated from it.

    `recording` is one of force, acceleration or indentation, or its calibration. Used impacts have
    numbers, doubtful ones crosses. The curve shows the largest and smallest reading in each of at
    most 4000 time intervals. For a calibration two axes are drawn: the second shows the readings of
    the first six impacts over the time since touch, with the fitted curves. `ax`: one, or two for a
    calibration. Returns the axes, new ones if `ax` is None. Raises ValueError for other recordings,
    and for invalid axes.
    """
    fits = recording.impact_fits if isinstance(recording, Calibration) else ()
    impacts: list[RecordedImpact] = []
    if isinstance(recording, Calibration):
        impacts = [one.impact for one in fits]
    elif isinstance(recording, Recording) and recording.layout.fitted:
        impacts = list(recording.records)  # pyright: ignore[reportAssignmentType]
    if not impacts:
        raise ValueError(
            "Argument `recording` must be that of force, acceleration or indentation over time, or "
            f"its calibration, but is {rendered(recording)}."
        )
    if not fits:
        return _whole(axes_of(ax), impacts)
    if ax is None:
        from matplotlib import pyplot

        ax = pyplot.subplots(2, figsize=(8.0, 7.0), layout="constrained")[1]
    above, below = axes_for(ax, 2, "view")
    _whole(above, impacts)
    _fits(below, fits)
    return np.array([above, below])


def _whole(ax: Axes, impacts: list[RecordedImpact]) -> Axes:
    trace = impacts[0].trace
    width = max(-(-trace.time.size // (_POINTS // 2)), 1)
    at = np.arange(0, trace.time.size, width)
    both = [f.reduceat(trace.value, at) for f in (np.minimum, np.maximum)]
    ax.plot(np.repeat(trace.time[at], 2), np.stack(both, axis=1).ravel(), color=_LINE, lw=0.8)
    tops = [float(trace.value[one.start : one.stop].max()) for one in impacts]
    touches = [float(trace.time[0] + one.touch * trace.step) for one in impacts]
    ax.plot(touches, tops, "v", color=_USED, ms=6, ls="none", label="impact, used")
    for one, touch, top in zip(impacts, touches, tops, strict=True):
        ax.annotate(
            str(one.number),
            (touch, top),
            (0, 5),
            textcoords="offset points",
            ha="center",
            fontsize="small",
            color=_USED,
        )
    if trace.doubtful:
        times = [one.time for one in trace.doubtful]
        height = np.interp(times, trace.time, trace.level)
        ax.plot(times, height, "x", color=_DOUBTFUL, ms=6, ls="none", label="doubtful, not used")
    ax.set_ylim(top=float(trace.value.max()) + 0.12 * float(np.ptp(trace.value)))
    ax.set_xlabel("time $t$ / s")
    ax.set_ylabel(_LABEL[trace.quantity])
    ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, frameon=False, fontsize="small")
    return ax


def _fits(ax: Axes, fits: Any) -> Axes:
    for k, one in enumerate(fits[:_SHOWN]):
        trace, color = one.impact.trace, f"C{k}"
        count = one.time.size
        (predicted,) = one.fit.predict().values()
        scale = float(np.max(np.abs(one.reading)))
        own = float(np.max(np.abs(one.fit.data[:count])))
        since = 1e3 * (one.time - one.touch)
        ax.plot(since, one.reading, ".", color=color, ms=2.5, alpha=0.6)
        curve = np.asarray(predicted)[:count] * (scale / own if own > 0 else 1)
        ax.plot(since, curve, color=color, lw=1.2, label=f"{one.impact.number}")
        ax.set_ylabel(_LABEL[trace.quantity])
    ax.set_xlabel("time since touch / ms")
    ax.legend(frameon=False, fontsize="small", title="impact and its fit", title_fontsize="small")
    return ax
