"""The figure of a calibration: measured restitution against speed, and the fitted curves."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .._calibration import Calibration
from .._parameter import require_kind
from ._axes import axes_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Okabe & Ito: told apart by readers with any colour vision; the style tells them apart in grey.
_CURVES = (
    *(("#D55E00", "-"), ("#009E73", "-."), ("#E69F00", ":"), ("#0072B2", "--")),
    *(("#56B4E9", (0, (5, 1, 1, 1, 1, 1))), ("#000000", (0, (8, 3)))),
)
_KEPT, _MARKED = "#555555", "#CC79A7"
_ROOM = 0.35
_FINE = 200


def calibration(result: Calibration, *, ax: Axes | None = None) -> Axes:
    """Draw e against approach speed (m/s): kept and marked pairs, and each fit ± 2 standard errors.

    Marked pairs outside the frame are drawn at its edge as arrows, so that none is hidden. Returns
    the axes, new ones if `ax` is None. Raises ValueError for what is no `Calibration` and no axes.
    """
    require_kind("result", result, Calibration, "a `Calibration` (see `calibrate`)")
    ax = axes_of(ax, figsize=(7.0, 4.6))
    pairs, flagged = result.pairs, result.outliers.flagged
    v, e = pairs.velocity, pairs.restitution
    low, high = float(e[~flagged].min()), float(e[~flagged].max())
    room = _ROOM * max(high - low, 0.02)
    low, high = low - room, high + room
    ax.plot(v[~flagged], e[~flagged], ".", color=_KEPT, alpha=0.6, ms=5, mew=0, label="kept")
    _draw_marked(ax, v[flagged], e[flagged], (low, high))
    speeds = np.linspace(v[~flagged].min(), v[~flagged].max(), _FINE)
    for (colour, style), law in zip(_CURVES, result.choice.laws, strict=False):
        curve, error = result.choice.curve(law.kind, speeds)
        ax.plot(speeds, curve, ls=style, color=colour, lw=1.8, label=law.kind)
        if law.identifiable:
            low_end, high_end = curve - 2 * error, curve + 2 * error
            ax.fill_between(speeds, low_end, high_end, color=colour, alpha=0.22, lw=0)
    ax.set_ylim(low, high)
    margin = 0.04 * max(float(np.ptp(v)), 0.1)
    ax.set_xlim(max(float(v.min()) - margin, 0.0), float(v.max()) + margin)
    ax.set_xlabel("approach speed $v$ / (m/s)")
    air = {True: "drag taken out", False: "drag left in"}[pairs.flight.drag is not None]
    ax.set_ylabel("restitution $e$" + (f" ({air})" if pairs.layout.uses_flight else ""))
    # Outside the frame it covers no data, whatever the data are.
    ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, frameon=False, fontsize="small")
    return ax


def _draw_marked(ax: Axes, v: np.ndarray, e: np.ndarray, frame: tuple[float, float]) -> None:
    low, high = frame
    edge = 0.02 * (high - low)
    inside = (e >= low + edge) & (e <= high - edge)
    label = f"marked, left out ({len(e)})"
    if not inside.all():
        label += "; ▲▼ off scale"
    groups = (
        ("x", inside, e),
        ("^", e > high - edge, np.full_like(e, high - edge)),
        ("v", e < low + edge, np.full_like(e, low + edge)),
    )
    for marker, which, height in groups:
        if which.any():
            ax.plot(
                v[which], height[which], marker, color=_MARKED, ms=6, clip_on=False, label=label
            )
            label = "_"  # one entry in the legend
