"""Plots of the profile likelihood of each parameter."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from .._entry import FRACTION, rendered, require_kind, require_number
from .._fit import Fit, FitData
from ._drawing.axes import axes_for
from ._drawing.labels import put_few_ticks
from ._drawing.style import BLACK, BLUE, GUIDE

_POINTS = 25


def profile(
    result: Fit, names: Sequence[str] | None = None, *, level: float = 0.95, ax: Any = None
) -> Any:
    """Draw the rise of the loss if a parameter is fixed elsewhere and the others are refitted.

    The curve is 2 (loss - best)/s², which also defines the intervals: `interval(level)` is the
    shaded range in which it lies below the horizontal line. The dashed parabola is the normal
    approximation from the standard error. If the two differ, trust the curve.

    Arguments: the fit; the `names` of parameters, by default all that have a standard error; axes,
    one per parameter, new ones if None. Returns an array of axes, or the axes of a single
    parameter. Raises ValueError for a fit that did not converge, names without a standard error,
    and for anything but a fit and such axes.
    """
    require_kind("result", result, FitData, "a `Fit`")
    level = require_number("level", level, FRACTION)
    fitted = [name for name, error in result.standard_errors.items() if math.isfinite(error)]
    if not fitted:
        raise ValueError(
            "Argument `result` must have a parameter with a standard error, but has none."
        )
    chosen = fitted if names is None else [names] if isinstance(names, str) else names
    if not isinstance(chosen, list | tuple) or not chosen or not all(x in fitted for x in chosen):
        raise ValueError(
            f"Argument `names` must be some of {', '.join(fitted)}, but is {rendered(names)}."
        )
    all_axes = axes_for(ax, len(chosen), "parameter")
    intervals = result.interval(level)
    curves = [result.profile(name, points=_POINTS) for name in chosen]
    for axes, curve in zip(all_axes, curves, strict=True):
        error = result.standard_errors[curve.name]
        axes.plot(curve.values, np.square((curve.values - curve.best) / error), "--", color=GUIDE)
        axes.plot(curve.values, np.square(curve.deviation), color=BLUE, ls="-")
        axes.plot(curve.best, 0, ".", color=BLACK, clip_on=False, zorder=3)
        low, high = intervals[curve.name]
        axes.axhline(curve.quantile(level) ** 2, color=GUIDE, lw=1)
        axes.axvspan(low, high, color=BLUE, alpha=0.1, lw=0)
        axes.set_ylim(0)
        axes.set_xlim(curve.values[0], curve.values[-1])
        put_few_ticks(axes.xaxis, curve.name)
    all_axes[0].set_ylabel("2 (loss - best)/s²")
    return np.array(all_axes) if len(curves) > 1 else all_axes[0]
