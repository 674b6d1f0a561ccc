"""Plots of simulated mechanisms: gaps, contact forces, phase portraits."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from .._entry import require_count, require_kind
from .._system import SystemRun, SystemStates
from ._drawing.labels import put_label
from ._drawing.style import axes_of, legend_above

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_OVER_ALL, _OF_CONTACT = 400, 24
"""The number of points over a run, and within each contact."""


def gaps(run: SystemRun, *, ax: Axes | None = None) -> Axes:
    """Draw the gaps of a mechanism over time (m, s).

    Arguments: a single run of a `System`; the axes to draw on, new ones if None. Returns the axes.
    Raises ValueError for a batch of runs and for anything but such a run.
    """
    return _over_time(run, "gap", ax)


def forces(run: SystemRun, *, ax: Axes | None = None) -> Axes:
    """Draw the contact forces of a mechanism over time (N, s).

    Arguments: a single run of a `System`; the axes to draw on, new ones if None. Returns the axes.
    Raises ValueError for a batch of runs and for anything but such a run.
    """
    return _over_time(run, "force", ax)


def phase(run: SystemRun, coordinate: int = 0, *, ax: Axes | None = None) -> Axes:
    """Draw the speed of a coordinate of a mechanism over its position.

    Arguments: a single run of a `System`; the number of the coordinate; the axes to draw on, new
    ones if None. Returns the axes. Raises ValueError for a batch of runs, for anything but such a
    run, and for a coordinate that it does not have.
    """
    states, number = _path(run), require_count("coordinate", coordinate, 0)
    count = min(run.position.shape[1], run.velocity.shape[1])
    if number >= count:
        raise ValueError(f"Argument `coordinate` must be below {count}, but is {coordinate}.")
    ax = axes_of(ax)
    ax.plot(np.asarray(states.position)[:, number], np.asarray(states.velocity)[:, number], lw=1.2)
    ax.set_xlabel(f"position {number}")
    ax.set_ylabel(f"speed {number}")
    return ax


def _over_time(run: SystemRun, name: str, ax: Axes | None) -> Axes:
    states = _path(run)
    ax = axes_of(ax)
    values: Any = np.asarray(getattr(states, name))
    for k in range(values.shape[1]):
        ax.plot(states.time, values[:, k], lw=1.2, label=f"gap {k}")
    ax.set_xlim(0, float(run.reached))
    put_label(ax.xaxis, "time")
    ax.set_ylabel({"gap": "gap / m", "force": "contact force / N"}[name])
    legend_above(ax)
    return ax


def _path(run: SystemRun) -> SystemStates:
    """Return the states of a single run at times that show every contact."""
    require_kind("run", run, SystemRun, "a `SystemRun`")
    if run.time.ndim != 1:
        raise ValueError(
            f"Argument `run` must be a single run, but is a batch of {run.time.shape[:-1]}."
        )
    end, table = float(run.reached), run.contacts.to_dict()
    lasts = np.where(np.isfinite(table["duration"]), table["duration"], end - table["time"])
    inside = table["time"][:, None] + lasts[:, None] * np.linspace(0, 1, _OF_CONTACT)[None]
    times = np.unique(np.concatenate([np.linspace(0, end, _OVER_ALL), inside.ravel()]))
    return run.at(times[(times >= 0) & (times <= end)])
