"""Pictures of a fit: data, prediction and its uncertainty."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import ArrayLike

from .._fit import Fit, FitData
from .._parameter import as_numbers, rendered, require_kind
from ._axes import axes_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_FINE = 200


def fit(result: Fit, *, x: ArrayLike | None = None, ax: Axes | None = None, **line: Any) -> Axes:
    """Draw the data of a fit, its prediction, and the band of two standard errors around it.

    Arguments: the fit, of one list of numbers over a one-dimensional `x`; the `x` (m,) where the
    prediction is drawn, by default 200 between the ends of the data's, evenly spaced, or by a
    factor where the data's span decades; the axes to draw on, new ones if None; `line`, for the
    line of the prediction. The band is Laplace's, of what the data determine; it is left out where
    there are no standard errors. Returns the axes. Raises ValueError for a fit without such an `x`,
    and for what is no fit, no such numbers and no axes.
    """
    require_kind("result", result, FitData, "a `Fit`")
    given = result.problem.x
    if given is None or np.ndim(given) != 1 or np.shape(given) != result.data.shape:
        raise ValueError(
            "Argument `result` must be a fit over a one-dimensional `x`, one number for each point "
            "of the data, but is none."
        )
    ax = axes_of(ax)
    place = np.asarray(given)
    wide = bool(np.all(place > 0)) and place.max() > 100 * place.min()
    if x is None:
        x = (np.geomspace if wide else np.linspace)(place.min(), place.max(), _FINE)
    x = as_numbers(x, "x")
    if x.ndim != 1 or not x.size:
        raise ValueError(
            f"Argument `x` must have the shape (m,), but has {x.shape}: it is {rendered(x)}."
        )
    curve, error = result.predict_with_error(x)
    ax.plot(place, result.data, ".", color="0.4", label="data", zorder=2)
    style = {"label": "fit" if result.converged else "not converged", "zorder": 3} | line
    (drawn,) = ax.plot(x, curve, **style)
    if np.isfinite(error).all() and error.any():
        ax.fill_between(
            x, curve - 2 * error, curve + 2 * error, color=drawn.get_color(), alpha=0.2, lw=0
        )
    if wide:
        ax.set_xscale("log")
    return ax
