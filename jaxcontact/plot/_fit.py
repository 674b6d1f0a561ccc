"""Plots of a fit: data, prediction and its uncertainty."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import jax
import numpy as np
from jaxtyping import ArrayLike

from .._calibration import VelocityProfile
from .._entry import FRACTION, as_numbers, rendered, require_kind, require_number
from .._fit import Fit, FitData
from .._text.units import Shown
from ._drawing.axes import axes_for
from ._drawing.labels import put_label
from ._drawing.style import DATA, legend_above

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_FINE = 200
_DOTS = {"color": DATA, "mew": 0, "ms": 6}
_BANDS = ("true curve", 0.3), ("new reading", 0.12)


def fit(
    result: Fit | VelocityProfile,
    *,
    x: ArrayLike | None = None,
    level: float = 0.95,
    ax: Any = None,
    **line: Any,
) -> Any:
    """Draw the data of a fit, its prediction, and two bands around it.

    The inner band contains the true curve with the probability `level` (`confidence_band`). The
    outer one contains a new reading like those of the data (`prediction_band`). Both are omitted
    without standard errors. Data that the fit did not use are not drawn. Quantities that a
    predefined fit compares as logarithms are drawn on their own scale, with a logarithmic axis if
    they span a decade.

    Arguments: the result of `fit` or any `fit_*`, for numbers over a one-dimensional `x`. Each
    column ("force" and "indentation", say) has its own axes. `x` (m,) holds the points of the
    prediction, by default 200 between the ends of the data, spaced by a factor if the data span
    decades. `ax` are the axes to draw on, one per column, new ones if None. `line` are options for
    the line of the prediction. Returns the axes, as an array for several columns. Raises ValueError
    for a fit without such an `x`, and for anything but a fit, such numbers and axes.
    """
    result = fit_of(result)
    level = require_number("level", level, FRACTION)
    x_data = result.problem.x
    size, shapes = np.size(x_data), result.problem.shapes
    if x_data is None or np.ndim(x_data) != 1 or any(shape != (size,) for shape in shapes):
        raise ValueError(
            "Argument `result` must be a fit over a one-dimensional `x`, one number for each "
            "point of the data, but has no such `x`."
        )
    place = np.asarray(x_data)
    used = np.reshape(np.asarray(result.problem.factor) > 0, (len(shapes), size))
    there = place[used.any(axis=0)]
    wide = bool(np.all(there > 0)) and there.max() > 100 * there.min()
    if x is None:
        x = (np.geomspace if wide else np.linspace)(there.min(), there.max(), _FINE)
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
    style = {"label": "fit" if result.converged else "not converged", "zorder": 3} | line
    rows = zip(all_axes, shown_of(result), result.data.reshape(shape[0], -1), used, strict=True)
    for column, (axes, (over, own), y, finite) in enumerate(rows):
        back = np.exp if own.logarithm else np.asarray
        axes.plot(place[finite], back(y[finite]), ".", label="data", zorder=2, **_DOTS)
        (drawn,) = axes.plot(x, back(curves.reshape(shape)[column]), **style)
        for band, (what, alpha) in zip(bands, _BANDS, strict=False):
            shade = {"color": drawn.get_color(), "alpha": alpha, "lw": 0}
            words = f"{what}, {100 * level:g} %"
            axes.fill_between(x, *back(band[:, column]), label=words, **shade)
        _scales(axes, wide, back(y[finite]) if own.logarithm else None)
        put_label(axes.xaxis, over.name, over.words)
        put_label(axes.yaxis, own.name, own.words)
    legend_above(all_axes[0])
    return np.array(all_axes) if len(shapes) > 1 else all_axes[0]


def _scales(axes: Axes, wide: bool, positive: np.ndarray | None) -> None:
    """Set logarithmic axes if the numbers span decades."""
    if wide:
        axes.set_xscale("log")
    if positive is not None and positive.max() > 10 * positive.min():
        axes.set_yscale("log")


def fit_of(result: object) -> Fit:
    """Return a fit, or the fit inside another result; ValueError for anything else."""
    inner = getattr(result, "fit", None)
    return require_kind(
        "result", inner if isinstance(inner, FitData) else result, FitData, "a `Fit`"
    )  # pyright: ignore[reportReturnType]


def shown_of(result: Fit) -> list[tuple[Shown, Shown]]:
    """Return how each column of the data and its x are labelled."""
    labels = getattr(result.problem.predict, "shown", {})
    with jax.enable_x64(True):
        shape = jax.eval_shape(lambda: result.predict())
    paths = jax.tree_util.tree_leaves_with_path(shape)
    names = [jax.tree_util.keystr(path, simple=True) for path, _ in paths]
    over = labels.get("x", Shown("", "x"))
    return [(over, labels.get(name, Shown("", name or "y"))) for name in names]
