"""The figure of a calibration: measured restitution over speed, and the fitted curves."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..._entry import require_kind
from ...plot._choice import curves_of, draw_points, frame_of
from ...plot._drawing.labels import put_label
from ...plot._drawing.style import LEFT_OUT, axes_of, legend_above
from ..calibration.calibrate import Calibration

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_FINE = 200


def calibration(result: Calibration, *, ax: Axes | None = None) -> Axes:
    """Draw e over approach speed (m/s): kept and marked pairs, and each fit ± 2 standard errors.

    Marked pairs outside the frame are drawn at its edge as arrows, so that all are visible. Returns
    the axes, new ones if `ax` is None. Raises ValueError unless `result` is a `Calibration` and
    `ax` are axes.
    """
    require_kind("result", result, Calibration, "a `Calibration` (see `calibrate`)")
    ax = axes_of(ax, figsize=(7.0, 4.6))
    pairs, flagged = result.recorded_pairs, result.outliers.flagged
    v, e = pairs.velocity, pairs.restitution
    low, high = frame_of(e[~flagged])
    draw_points(ax, v[~flagged], e[~flagged], "kept")
    _draw_marked(ax, v[flagged], e[flagged], (low, high))
    speeds = np.linspace(v[~flagged].min(), v[~flagged].max(), _FINE)
    styles = curves_of(result.choice)
    for law in result.choice.laws:
        curve, error = result.choice.curve(law.kind, speeds)
        style = styles[law.kind]
        ax.plot(speeds, curve, lw=1.8, label=law.kind, **style)
        if law.identifiable:
            low_end, high_end = curve - 2 * error, curve + 2 * error
            ax.fill_between(speeds, low_end, high_end, color=style["color"], alpha=0.16, lw=0)
    ax.set_ylim(low, high)
    margin = 0.04 * max(float(np.ptp(v)), 0.1)
    ax.set_xlim(max(float(v.min()) - margin, 0.0), float(v.max()) + margin)
    put_label(ax.xaxis, "velocity", "approach speed")
    air = {True: "drag taken out", False: "drag left in"}[pairs.flight.drag is not None]
    ax.set_ylabel("restitution $e$" + (f" ({air})" if pairs.layout.uses_flight else ""))
    legend_above(ax)
    return ax


def _draw_marked(ax: Axes, v: np.ndarray, e: np.ndarray, frame: tuple[float, float]) -> None:
    low, high = frame
    edge = 0.02 * (high - low)
    inside = (e >= low + edge) & (e <= high - edge)
    label = f"left out ({len(e)})"
    groups = (
        ("x", inside, e),
        ("^", e > high - edge, np.full_like(e, high - edge)),
        ("v", e < low + edge, np.full_like(e, low + edge)),
    )
    for marker, which, height in groups:
        if which.any():
            ax.plot(
                v[which], height[which], marker, color=LEFT_OUT, ms=6, clip_on=False, label=label
            )
            label = "_"  # one entry in the legend
