"""Plots of the residuals of a fit."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.special import ndtri

from .._calibration import VelocityProfile
from .._fit import Fit
from .._text.units import meaning
from ._drawing.axes import axes_for
from ._drawing.labels import put_label
from ._drawing.style import CURVES, GUIDE, MARKERS, legend_above
from ._fit import fit_of, shown_of


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
        wide = np.asarray(x)[np.any(np.reshape(used, (len(sizes), -1)), axis=0)]
        if wide.min() > 0 and wide.max() > 100 * wide.min():
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
