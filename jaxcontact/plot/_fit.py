"""Plots of a fit: data, prediction and its uncertainty, residuals."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import jax
import numpy as np
from jaxtyping import ArrayLike
from scipy.special import ndtri

from .._entry import FRACTION, as_numbers, rendered, require_kind, require_number
from .._fit import Fit, FitData
from .._text.units import Shown, meaning
from ._drawing.labels import put_label
from ._drawing.style import CURVES, DATA, GUIDE, MARKERS, axes_for, legend_above, one_or_several

if TYPE_CHECKING:
    from .. import VelocityProfile

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
    wide = _spans(there, 100)
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
        if wide:
            axes.set_xscale("log")
        if own.logarithm and _spans(back(y[finite]), 10):
            axes.set_yscale("log")
        put_label(axes.xaxis, over.name, over.words)
        put_label(axes.yaxis, own.name, own.words)
    legend_above(all_axes[0])
    return one_or_several(all_axes)


def _spans(numbers: np.ndarray, factor: float) -> bool:
    """Return whether numbers are positive and span more than a factor."""
    return bool(numbers.max() > factor * numbers.min() > 0)


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


def residuals(result: Fit | VelocityProfile, *, ax: Any = None) -> Any:
    """Draw the residuals of a fit over x, in their order, and against normal quantiles.

    Each residual is (prediction - data)/σ, with the given σ or the one estimated from all
    residuals. 95 % of noise lies between the dashed lines, and normal noise follows the line of the
    last plot. Residuals that rise and fall over x, or lie in rows, are not noise.

    Arguments: the fit; three axes to draw on (two for a fit without a one-dimensional `x`), new
    ones if None. Each column has its own colour and marker. Returns the array of axes. Raises
    ValueError for anything but a fit and such axes.
    """
    result = fit_of(result)
    problem = result.problem
    shown = shown_of(result)
    sizes = [int(np.prod(shape)) for shape in problem.shapes]
    x = problem.x
    over_x = x is not None and np.ndim(x) == 1 and all(size == np.size(x) for size in sizes)
    axes = axes_for(ax, 3 if over_x else 2, "picture")
    factor = np.asarray(problem.factor)
    used = factor > 0
    noise = result.noise if np.isfinite(result.noise) and result.noise > 0 else 1.0
    z = np.where(used, result.residuals * factor, np.nan) / np.sqrt(noise)
    ends = np.cumsum([0, *sizes])
    # Points without weight, such as padding, are not counted in the order.
    order = np.cumsum(used) - 1
    looks = zip(CURVES, MARKERS, strict=True)
    for (_, own), begin, end, (curve, mark) in zip(shown, ends, ends[1:], looks, strict=False):
        part = z[begin:end]
        there = np.sort(part[~np.isnan(part)])
        dots = {"color": curve[0], "marker": mark, "ls": "none", "ms": 4, "mew": 0, "alpha": 0.75}
        if over_x:
            axes[0].plot(np.asarray(x), part, **dots)
        axes[-2].plot(order[begin:end], part, **dots)
        words = own.words or meaning(own.name)[0]
        quantiles = ndtri((np.arange(there.size) + 0.5) / there.size)
        axes[-1].plot(quantiles, there, label=words, **dots)
    _guides(axes)
    for picture, words in zip(axes[::-1], ("normal quantile", "order"), strict=False):
        picture.set_xlabel(words)
    if over_x:
        if _spans(np.asarray(x)[np.any(np.reshape(used, (len(sizes), -1)), axis=0)], 100):
            axes[0].set_xscale("log")
        put_label(axes[0].xaxis, shown[0][0].name, shown[0][0].words)
    axes[0].set_ylabel("(prediction - data)/σ")
    if len(sizes) > 1:
        legend_above(axes[-1])
    return np.array(axes)


def _guides(axes: list[Any]) -> None:
    guide = {"color": GUIDE, "lw": 1, "zorder": 1}
    for picture in axes[:-1]:
        picture.axhline(0, **guide)
        for side in (-1, 1):
            picture.axhline(side * ndtri(0.975), ls="--", **guide)
    axes[-1].axline((0, 0), slope=1, **guide)
