"""Pictures of a fit: data, prediction and its uncertainty."""

from __future__ import annotations

from typing import Any

import jax
import numpy as np
from jaxtyping import ArrayLike

from .._fit import Fit, FitData
from .._parameter import FRACTION, as_numbers, rendered, require_kind, require_number
from ._axes import axes_for

_FINE = 200


def fit(
    result: Fit,
    *,
    x: ArrayLike | None = None,
    level: float = 0.95,
    ax: Any = None,
    **line: Any,
) -> Any:
    """Draw the data of a fit, its prediction, and two bands around it.

    The inner one holds the true curve, the outer one a new reading like those of the data, each
    with the probability `level`: `confidence_band` and `prediction_band`. They are left out where
    there are no standard errors.

    Arguments: the fit, of numbers over a one-dimensional `x`, one column or several ("force" and
    "indentation", say), each of which has axes of its own; the `x` (m,) where the prediction is
    drawn, by default 200 between the ends of the data's, evenly spaced, or by a factor where the
    data's span decades; the axes to draw on, as many as there are columns, new ones if None;
    `line`, for the line of the prediction. Returns the axes, an array of them for several columns.
    Raises ValueError for a fit without such an `x`, and for what is no fit, no such numbers and no
    axes.
    """
    require_kind("result", result, FitData, "a `Fit`")
    level = require_number("level", level, FRACTION)
    given = result.problem.x
    size, shapes = np.size(given), result.problem.shapes
    if given is None or np.ndim(given) != 1 or any(shape != (size,) for shape in shapes):
        raise ValueError(
            "Argument `result` must be a fit over a one-dimensional `x`, one number for each point "
            "of the data, but is none."
        )
    place = np.asarray(given)
    wide = bool(np.all(place > 0)) and place.max() > 100 * place.min()
    if x is None:
        x = (np.geomspace if wide else np.linspace)(place.min(), place.max(), _FINE)
    x = as_numbers(x, "x")
    if x.ndim != 1 or not x.size:
        raise ValueError(
            f"Argument `x` must have the shape (m,), but has {x.shape}: it is {rendered(x)}."
        )
    all_axes = axes_for(ax, len(shapes))
    shape = len(shapes), x.size
    curves = np.concatenate([np.ravel(leaf) for leaf in jax.tree.leaves(result.predict(x))])
    bands = ()
    if result.converged and np.isfinite(result.errors).any():
        of = result.confidence_band, result.prediction_band
        bands = [np.reshape(band(x, level=level), (2, *shape)) for band in of]
    names = _names(result, x)
    style = {"label": "fit" if result.converged else "not converged", "zorder": 3} | line
    rows = zip(all_axes, names, result.data.reshape(len(shapes), -1), strict=True)
    for column, (axes, name, y) in enumerate(rows):
        axes.plot(place, y, ".", color="0.4", label="data", zorder=2)
        (drawn,) = axes.plot(x, curves.reshape(shape)[column], **style)
        for band, alpha in zip(bands, (0.2, 0.1), strict=False):
            shade = {"color": drawn.get_color(), "alpha": alpha, "lw": 0}
            axes.fill_between(x, *band[:, column], **shade)
        if wide:
            axes.set_xscale("log")
        if len(shapes) > 1:
            axes.set_ylabel(name)
    return np.array(all_axes) if len(shapes) > 1 else all_axes[0]


def _names(result: Fit, x: np.ndarray) -> list[str]:
    """What the columns are called in the tree of the prediction."""
    paths = jax.tree_util.tree_leaves_with_path(result.predict(x))
    return [jax.tree_util.keystr(path, simple=True) for path, _ in paths]
