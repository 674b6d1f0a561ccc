"""Pictures of what a fit leaves of its data."""

from __future__ import annotations

from typing import Any

import jax
import numpy as np
from scipy.special import ndtri

from .._fit import Fit, FitData
from .._parameter import require_kind
from ._axes import axes_for


def residuals(result: Fit, *, ax: Any = None) -> Any:
    """Draw the residuals of a fit over x, in their order, and against those of normal noise.

    Each is (prediction - data)/σ, with the σ that was given or that all residuals show: 95 % of
    noise lie between the dashed lines, and normal noise follows the line of the last picture. What
    rises and falls over x, or lies in rows, is not noise.

    Arguments: the fit; three axes to draw on, two for a fit without a one-dimensional `x`, new ones
    if None. Several columns have colours of their own. Returns the array of axes. Raises
    ValueError for what is no fit and no such axes.
    """
    require_kind("result", result, FitData, "a `Fit`")
    problem = result.problem
    names, sizes = _columns(result)
    x = problem.x
    over_x = x is not None and np.ndim(x) == 1 and all(size == np.size(x) for size in sizes)
    axes = axes_for(ax, 3 if over_x else 2, "picture")
    factor = np.asarray(problem.factor)
    used = factor > 0
    noise = result.noise if np.isfinite(result.noise) and result.noise > 0 else 1.0
    z = np.where(used, result.residuals * factor, np.nan) / np.sqrt(noise)
    ends = np.cumsum([0, *sizes])
    for name, begin, end in zip(names, ends, ends[1:], strict=False):
        own = z[begin:end]
        there = np.sort(own[~np.isnan(own)])
        if over_x:
            axes[0].plot(np.asarray(x), own, ".")
        axes[-2].plot(np.arange(begin, end), own, ".")
        axes[-1].plot(ndtri((np.arange(there.size) + 0.5) / there.size), there, ".", label=name)
    for one in axes[:-1]:
        one.axhline(0, color="0.6", lw=1, zorder=1)
        for side in (-1, 1):
            one.axhline(side * ndtri(0.975), color="0.6", lw=1, ls="--", zorder=1)
    axes[-1].axline((0, 0), slope=1, color="0.6", lw=1, zorder=1)
    for one, words in zip(axes[::-1], ("normal quantile", "order", "x"), strict=False):
        one.set_xlabel(words)
    axes[0].set_ylabel("(prediction - data)/σ")
    if over_x and (wide := np.asarray(x)).min() > 0 and wide.max() > 100 * wide.min():
        axes[0].set_xscale("log")
    if len(names) > 1:
        axes[-1].legend()
    return np.array(axes)


def _columns(result: Fit) -> tuple[list[str], list[int]]:
    """The names of the columns of the data, and how many points each of them has."""
    with jax.enable_x64(True):
        shape = jax.eval_shape(lambda: result.predict())
    paths = jax.tree_util.tree_leaves_with_path(shape)
    names = [jax.tree_util.keystr(path, simple=True) for path, _ in paths]
    return names, [int(np.prod(shape)) for shape in result.problem.shapes]
