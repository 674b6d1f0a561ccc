"""The picture of a choice of law: measured restitutions and the curve of each kind."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .._calibration import LawChoice
from .._parameter import require_kind
from ._axes import axes_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_STYLES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (8, 3)))
_FINE = 200


def choice(result: LawChoice, *, ax: Axes | None = None) -> Axes:
    """Draw e over the closing speed (m/s): the data, and each kind of law, the one of lowest AICc
    thickest; in grey, a free smooth curve, which is no law.

    Arguments: what `choose_law` returned; the axes to draw on, new ones if None. Returns the axes.
    Raises ValueError for what is no `LawChoice` and no axes.
    """
    require_kind("result", result, LawChoice, "a `LawChoice` (see `choose_law`)")
    ax = axes_of(ax)
    some = next(iter(result.fits.values()))
    x = np.asarray(some.problem.x)
    # ln e comes before contact times and forces.
    log_e = some.data[: len(x)]
    used = np.isfinite(log_e)
    v = x[used]
    ax.plot(v, np.exp(log_e[used]), ".", color="0.4", label="data", zorder=2)
    wide = v.max() > 100 * v.min()
    fine = (np.geomspace if wide else np.linspace)(v.min(), v.max(), _FINE)
    best = min(candidate.aicc for candidate in result.candidates)
    for place, (candidate, style) in enumerate(zip(result.candidates, _STYLES, strict=False)):
        label = f"{candidate.name} (ΔAICc {candidate.aicc - best:.1f})"
        curve, _ = result.curve(candidate.name, fine)
        ax.plot(fine, curve, ls=style, lw=2.4 if place == 0 else 1.4, label=label, zorder=3)
    ax.plot(fine, result.free(fine), color="0.6", lw=1.0, label="free curve, no law", zorder=1)
    if wide:
        ax.set_xscale("log")
    ax.set_xlabel("closing speed / (m/s)")
    ax.set_ylabel("restitution $e$")
    # Outside the frame it covers no data, whatever the data are.
    ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, frameon=False, fontsize="small")
    return ax
