"""Plots of a sweep: lines over one axis, a map over two, dots over samples."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .._entry import refusal, rendered, require_kind
from .._sweep import Sweep
from .._sweep.planning.axes import SAMPLE
from .._text.units import label
from ._drawing.labels import put_label
from ._drawing.style import axes_of, legend_above

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Normalize

_LINES = 6
"""Number of lines that can still be distinguished."""

_DECADES = 100.0
"""Numbers of one sign that span more than this factor get logarithmic colours."""

_EVEN = 1e-6
"""Largest relative deviation of a step at which an axis counts as evenly spaced."""


def sweep(
    table: Sweep, *, field: str | None = None, x: str | None = None, ax: Axes | None = None
) -> Axes:
    """Draw a field of a sweep: a line over one axis, a map over two, dots over samples.

    Arguments: the sweep, with one or two axes or with samples only (`select` the others); the
    `field`, by default the restitution, or else the first field; `x`, the horizontal axis; `ax`,
    the axes to draw on, new ones if None. With `x` the other of two axes becomes a handful of lines
    instead of a map. An axis spaced by a factor is logarithmic, as are colours that span decades.
    Lanes without a number stay white. Returns the axes. Raises ValueError for an unknown field or
    axis, a field without one number per lane, and more than two axes.
    """
    require_kind("table", table, Sweep, "a `Sweep`")
    name, values = _field(table, field)
    sampled = SAMPLE in table.dims and SAMPLE not in table.axes
    if len(table.dims) not in ((1,) if sampled else (1, 2)):
        raise ValueError(
            "Argument `table` must have one or two axes, or samples alone, but has the dimensions "
            f"{table.dims}; `select` some."
        )
    if x is not None and not (isinstance(x, str) and x in table.axes):
        raise refusal("x", f"be one of {tuple(table.axes)}", x)
    ax = axes_of(ax)
    if x is None and len(table.dims) == 2:
        _map(ax, table, name, values)
        return ax
    across = x or next(iter(table.axes))
    numbers = table.axes[across]
    if sampled:
        ax.plot(numbers, values, ".", ms=3)
    elif len(table.dims) == 1:
        ax.plot(numbers, values)
    else:
        _lines(ax, table, across, np.moveaxis(values, table.dims.index(across), 0))
    if not sampled and _geometric(numbers):
        # The margins of an axis up to 1e308 overflow a double.
        with np.errstate(over="ignore"):
            ax.set_xscale("log")
    put_label(ax.xaxis, across)
    put_label(ax.yaxis, name)
    return ax


def _field(table: Sweep, field: str | None) -> tuple[str, np.ndarray]:
    names = [name for name, column in table.columns().items() if column.own_shape == ()]
    if field is None and names:
        field = "restitution" if "restitution" in names else names[0]
    if not isinstance(field, str) or field not in names:
        raise ValueError(
            f"Argument `field` must be one of {', '.join(names)}, but is {rendered(field)}."
            if names
            else "Argument `table` must have a field of one number for each lane, but has none."
        )
    return field, np.asarray(table[field])


def _lines(ax: Axes, table: Sweep, across: str, values: np.ndarray) -> None:
    (other,) = (dim for dim in table.dims if dim != across)
    numbers = table.axes[other]
    chosen = np.unique(np.linspace(0, len(numbers) - 1, min(_LINES, len(numbers))).round())
    for k in chosen.astype(int):
        ax.plot(table.axes[across], values[:, k], label=f"{numbers[k]:.3g}")
    legend_above(ax, label(other))


def _map(ax: Axes, table: Sweep, name: str, values: np.ndarray) -> None:
    down, across = table.dims
    rows, columns = (np.argsort(table.axes[dim], kind="stable") for dim in table.dims)
    y, x = table.axes[down][rows], table.axes[across][columns]
    shown = np.ma.masked_invalid(values[np.ix_(rows, columns)])
    mesh = ax.pcolormesh(_edges(x), _edges(y), shown, norm=_norm(shown), rasterized=True)
    bar = ax.figure.colorbar(mesh, ax=ax)
    put_label(bar.ax.yaxis, name)
    for numbers, scale in ((x, ax.set_xscale), (y, ax.set_yscale)):
        if _geometric(numbers):
            scale("log")
    put_label(ax.xaxis, across)
    put_label(ax.yaxis, down)


def _norm(values: np.ma.MaskedArray) -> Normalize | None:
    """Return logarithmic colours if the numbers span decades, which linear ones would hide."""
    from matplotlib.colors import LogNorm

    if values.count() == 0 or not values.min() > 0 or values.max() < _DECADES * values.min():
        return None
    return LogNorm()


def _geometric(numbers: np.ndarray) -> bool:
    """Return whether the numbers are spaced by a factor."""
    if len(numbers) < 3 or not np.all(numbers > 0) or not np.all(np.isfinite(numbers)):
        return False
    return _even(np.log(numbers)) and not _even(numbers)


def _even(numbers: np.ndarray) -> bool:
    steps = np.diff(numbers)
    return bool(np.ptp(steps) <= _EVEN * np.abs(steps).max())


def _edges(numbers: np.ndarray) -> np.ndarray:
    """Return the borders between the cells of a map, half-way on the scale that is drawn."""
    if len(numbers) == 1:
        return np.array([numbers[0] - 0.5, numbers[0] + 0.5])
    if _geometric(numbers):
        return np.exp(_edges(np.log(numbers)))
    middle = (numbers[1:] + numbers[:-1]) / 2
    return np.concatenate([[2 * numbers[0] - middle[0]], middle, [2 * numbers[-1] - middle[-1]]])
