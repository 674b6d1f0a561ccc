"""Plots of what a fit leaves open: posterior samples by pairs of parameters, and profiles."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.special import ndtri

from .._entry import (
    FRACTION,
    as_array,
    is_list,
    refusal,
    require_choice,
    require_kind,
    require_number,
)
from .._fit import Fit, FitData, Posterior
from ._drawing.labels import put_few_ticks
from ._drawing.style import BLACK, BLUE, GUIDE, ORANGE, axes_for, axes_of, one_or_several

_PANEL = 1.9
"""Side of a panel in inches."""

_BINS = 40
_SMOOTH = 1.2
"""Bins of a pair, and the width in bins of the smoothing before a contour."""

_SPAN = 3.5
"""Half-width of a normal density in standard errors."""

_FINE = 200
_MOST_POINTS = 2000
_NORMAL, _DRAWN = ORANGE, BLUE


class _NormalApproximation(NamedTuple):
    """The normal approximation of a fit."""

    names: tuple[str, ...]
    values: Float[np.ndarray, " k"]
    covariance: Float[np.ndarray, "k k"]

    def alone(self, ax: Any, i: int, level: float) -> None:
        value, error = self.values[i], math.sqrt(self.covariance[i, i])
        u = np.linspace(-_SPAN, _SPAN, _FINE)
        density = np.exp(-(u**2) / 2) / (error * math.sqrt(2 * math.pi))
        ax.plot(value + error * u, density, color=_NORMAL, ls="--")
        half = error * ndtri((1 + level) / 2)
        _ends(ax, value - half, value + half, _NORMAL)

    def pair(self, ax: Any, i: int, j: int, level: float) -> None:
        # χ² with two degrees of freedom: 1 - exp(-r²/2).
        radius = math.sqrt(-2 * math.log1p(-level))
        values, vectors = np.linalg.eigh(_correlation(self.covariance, i, j))
        turn = np.linspace(0, 2 * math.pi, _FINE)
        circle = np.sqrt(np.maximum(values, 0))[:, None] * np.stack([np.cos(turn), np.sin(turn)])
        x, y = radius * (vectors @ circle)
        error = np.sqrt(np.diag(self.covariance))
        ellipse = self.values[i] + error[i] * x, self.values[j] + error[j] * y
        ax.plot(*ellipse, color=_NORMAL, ls="--")
        ax.plot(self.values[i], self.values[j], "+", color=_NORMAL)


class _Drawn(NamedTuple):
    """The draws of a posterior."""

    names: tuple[str, ...]
    draws: Float[np.ndarray, "k n"]

    def alone(self, ax: Any, i: int, level: float) -> None:
        low, high = np.quantile(self.draws[i], [(1 - level) / 2, (1 + level) / 2])
        ax.hist(self.draws[i], _BINS, density=True, histtype="step", color=_DRAWN)
        _ends(ax, low, high, _DRAWN)

    def pair(self, ax: Any, i: int, j: int, level: float) -> None:
        x, y = self.draws[i], self.draws[j]
        every = slice(None, None, max(1, x.size // _MOST_POINTS))
        dots = {"ms": 1.5, "alpha": 0.25, "mew": 0, "rasterized": True, "zorder": 1}
        ax.plot(x[every], y[every], ".", color=_DRAWN, **dots)
        if min(np.ptp(x), np.ptp(y)) > 0:
            *place, edge = _region(np.stack([x, y]), level)
            ax.contour(*place, levels=[edge], colors=_DRAWN, linewidths=1.5)


def corner(
    result: Fit | Posterior,
    *,
    names: Sequence[str] | None = None,
    level: float = 0.95,
    ax: Any = None,
) -> np.ndarray:
    """Draw each parameter alone on the diagonal, and each pair below it.

    A `Fit` is drawn by its normal approximation: densities, and ellipses with the probability
    `level`. A `Posterior` is drawn by histograms, draws, and smoothed contours of the most probable
    region with the probability `level`. Dotted lines on the diagonal mark the interval of `level`.

    Arguments: the fit or posterior; the `names` of the parameters to draw, by default all sampled
    ones, or all with a standard error; the `level`, in (0, 1); the axes (k, k), new ones if None.
    Pass the axes of one plot to another to draw both. Returns the axes; those above the diagonal
    are hidden. Raises ValueError for a fit that did not converge, an unknown name, a name without a
    standard error, and a wrong number of axes.
    """
    level = require_number("level", level, FRACTION)
    shown = _drawable(result, names)
    k = len(shown.names)
    grid = _grid(ax, k)
    for (row, column), axes in np.ndenumerate(grid):
        if row < column:
            axes.set_visible(False)
            continue
        if row == column:
            shown.alone(axes, row, level)
            axes.set_ylim(bottom=0)
            axes.set_yticks([])
        else:
            shown.pair(axes, column, row, level)
    _align(grid)
    for row, column in np.ndindex(k, k):
        if row >= column:
            _label(grid[row, column], shown.names, row, column)
    if isinstance(result, Posterior) and not result.converged:
        grid[0, 0].set_title("not converged", loc="left")
    return grid


def _drawable(result: Any, names: Any) -> _NormalApproximation | _Drawn:
    """Return the drawable form of a result; ValueError if nothing can be drawn."""
    if isinstance(result, Posterior):
        chosen = _names(names, result.names, result.names)
        return _Drawn(chosen, np.stack([result.samples[name].ravel() for name in chosen]))
    if not isinstance(result, FitData):
        raise refusal("result", "be a `Fit` or a `Posterior`", result)
    chosen = _with_errors(result, names)
    place = list(map(result.names.index, chosen))
    return _NormalApproximation(
        chosen, result.values[place], result.covariance[np.ix_(place, place)]
    )


def _with_errors(result: FitData, names: Any) -> tuple[str, ...]:
    """Return the named parameters of a fit that converged, or all that have a standard error."""
    if not result.converged:
        raise ValueError(
            f"Argument `result` must be a fit that converged, but it did not: {result.reason}."
        )
    errors = result.standard_errors
    certain = tuple(itertools.compress(errors, np.isfinite([*errors.values()])))
    if names is None and not certain:
        raise ValueError(
            "Argument `result` must be a fit with standard errors, but no parameter has one."
        )
    chosen = _names(names, result.names, certain)
    for name in chosen:
        if name not in certain:
            raise ValueError(
                f"Argument `names` must name parameters with a standard error, but names {name}, "
                "which has none."
            )
    return chosen


def _names(value: Any, all_names: tuple[str, ...], usual: tuple[str, ...]) -> tuple[str, ...]:
    if value is None:
        return usual
    if not is_list(value) or not value:
        raise refusal("names", "be a list of names of parameters or None", value)
    return tuple(require_choice("names", name, all_names) for name in value)


def _grid(value: Any, k: int) -> np.ndarray:
    """Return the given axes (k, k), or new ones."""
    if value is None:
        from matplotlib import pyplot

        side = _PANEL * k + 0.6
        figure = {"figsize": (side, side), "layout": "constrained"}
        return pyplot.subplots(k, k, squeeze=False, **figure)[1]
    grid = as_array(value, object)
    if grid is None or grid.size != k * k:
        raise refusal("ax", f"be {k} x {k} axes of matplotlib or None", value)
    return np.array([axes_of(ax) for ax in grid.ravel()]).reshape(k, k)


def _region(draws: Float[np.ndarray, "2 n"], level: float) -> tuple[Any, Any, Any, float]:
    """Return x, y and smoothed counts of draws on a grid, and the count exceeded by `level` of
    them.

    The grid follows the principal axes of the draws, so that smoothing does not widen a narrow
    ellipse.
    """
    from scipy.ndimage import gaussian_filter, map_coordinates

    centre, size = draws.mean(axis=1), draws.std(axis=1)
    scaled = (draws - centre[:, None]) / size[:, None]
    _, turn = np.linalg.eigh(scaled @ scaled.T)
    along = turn.T @ scaled
    # Margin around the draws, so that the contour closes.
    box = [(v.min() - 0.1 * np.ptp(v), v.max() + 0.1 * np.ptp(v)) for v in along]
    count, *ends = np.histogram2d(along[0], along[1], _BINS, box)
    count = gaussian_filter(count, _SMOOTH)
    bins = [(v - e[0]) / (e[1] - e[0]) - 0.5 for v, e in zip(along, ends, strict=True)]
    edge = np.quantile(map_coordinates(count, bins, order=1), 1 - level)
    middles = np.meshgrid(*((e[1:] + e[:-1]) / 2 for e in ends), indexing="ij")
    x, y = np.tensordot(turn, np.stack(middles), 1) * size[:, None, None] + centre[:, None, None]
    return x, y, count, float(edge)


def _correlation(covariance: np.ndarray, i: int, j: int) -> np.ndarray:
    pair = covariance[np.ix_([i, j], [i, j])]
    error = np.sqrt(np.diag(pair))
    return pair / np.outer(error, error)


def _ends(ax: Any, low: float, high: float, color: str) -> None:
    for end in (low, high):
        ax.axvline(end, color=color, ls=":", lw=1)


def _align(grid: np.ndarray) -> None:
    """Give each parameter the same limits in all its panels."""
    k = len(grid)
    for i in range(k):
        ends = [grid[row, i].get_xlim() for row in range(i, k)]
        ends += [grid[i, column].get_ylim() for column in range(i)]
        low, high = min(low for low, _ in ends), max(high for _, high in ends)
        for row in range(i, k):
            grid[row, i].set_xlim(low, high)
        for column in range(i):
            grid[i, column].set_ylim(low, high)


def _label(ax: Any, names: Sequence[str], row: int, column: int) -> None:
    """Set few ticks, in a unit in which they are short, and names at the outer panels."""
    last = row == len(names) - 1
    sides = [(ax.xaxis, names[column], last)]
    if row != column:
        sides.append((ax.yaxis, names[row], column == 0))
    for axis, name, outer in sides:
        put_few_ticks(axis, name, words=outer)
    for tick in ax.get_xticklabels():
        tick.set(rotation=45, ha="right", rotation_mode="anchor")


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
    chosen = _with_errors(result, [names] if isinstance(names, str) else names)
    all_axes = axes_for(ax, len(chosen), "parameter")
    intervals = result.interval(level)
    for axes, name in zip(all_axes, chosen, strict=True):
        curve = result.profile(name, points=_POINTS)
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
    return one_or_several(all_axes)
