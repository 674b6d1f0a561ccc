"""The plot of a choice of law: measured restitutions and the curve of each kind."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from .._calibration import LawChoice
from .._calibration.choice.law_choice import ChoiceData
from .._entry import require_kind
from ._drawing.labels import put_label
from ._drawing.style import CURVES, DATA, GUIDE, axes_of, legend_above

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_FINE = 200
_ROOM = 0.35
_MANY = 60
"""Number of points above which they are drawn smaller."""


def choice(result: LawChoice, *, ax: Axes | None = None) -> Axes:
    """Draw e over the closing speed (m/s): the data, and the curve of each kind of law.

    The law of lowest AICc has the thickest line. The grey line is a free smooth curve, not a law.
    The frame is that of the data, which the curve of an excluded law may leave.
    Arguments: the result of `choose_law`; the axes to draw on, new ones if None. Returns the axes.
    Raises ValueError for anything but a `LawChoice` and axes.
    """
    require_kind("result", result, LawChoice, "a `LawChoice` (see `choose_law`)")
    ax = axes_of(ax, figsize=(7.0, 4.6))
    any_fit = next(iter(result.fits.values()))
    x = np.asarray(any_fit.problem.x)
    # ln e comes before contact times and forces.
    log_e = any_fit.data[: len(x)]
    used = np.isfinite(log_e)
    v = x[used]
    draw_points(ax, v, np.exp(log_e[used]), "data")
    wide = v.max() > 100 * v.min()
    fine = (np.geomspace if wide else np.linspace)(v.min(), v.max(), _FINE)
    best = min(candidate.aicc for candidate in result.candidates)
    styles = curves_of(result)
    for place, candidate in enumerate(result.candidates):
        label = f"{candidate.name} ({candidate.aicc - best:.1f})"
        curve, _ = result.curve(candidate.name, fine)
        thick = 2.6 if place == 0 else 1.4
        ax.plot(fine, curve, lw=thick, label=label, zorder=3, **styles[candidate.name])
    free = {"color": GUIDE, "lw": 4, "alpha": 0.5, "zorder": 2, "label": "free curve, no law"}
    ax.plot(fine, result.free(fine), **free)
    ax.set_ylim(*frame_of(np.exp(log_e[used])))
    if wide:
        ax.set_xscale("log")
    put_label(ax.xaxis, "velocity")
    ax.set_ylabel("restitution $e$")
    legend_above(ax, "law (ΔAICc)")
    return ax


def frame_of(e: np.ndarray) -> tuple[float, float]:
    """Return the lowest and the highest e of a plot of measured e."""
    low, high = float(e.min()), float(e.max())
    room = _ROOM * max(high - low, 0.02)
    return low - room, high + room


def draw_points(ax: Axes, v: np.ndarray, e: np.ndarray, label: str) -> None:
    """Draw measured e over speed, in front of curves and bands, with a light edge."""
    size = 3.8 if len(v) > _MANY else 6.0
    look = {"color": DATA, "mec": "white", "mew": 0.4, "ms": size, "zorder": 4}
    ax.plot(v, e, "o", label=label, **look)


def curves_of(choice: ChoiceData) -> dict[str, dict[str, Any]]:
    """Return the style of the curve of each kind of law, the same in every plot of a choice."""
    n = len(CURVES)
    # Beyond the last style a colour comes again with another line.
    places = [(k % n, (k + n // 2 * (k // n)) % n) for k in range(len(choice.laws))]
    return {
        law.kind: {"color": CURVES[colour][0], "ls": CURVES[line][1]}
        for law, (colour, line) in zip(choice.laws, places, strict=True)
    }
