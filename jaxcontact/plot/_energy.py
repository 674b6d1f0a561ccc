"""The picture of where the energy of a run goes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .._scene import Run
from ._axes import axes_of
from ._labels import put_label
from ._path import path_of, require_one_run
from ._style import BLACK, SKY, legend_above

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def energy(run: Run, *, ax: Axes | None = None) -> Axes:
    """Draw the energy of a run over time (J, s), and what the losses of its impacts leave of it.

    The line is that of `Run.at`: kinetic energy, weight, and what is stored in contacts. The dashed
    one starts with it and falls at the end of every impact by its loss (a series of bounces and a
    contact that comes to rest: at its touch). Where both agree, the energy is accounted for; with
    walls that move, the line is above by what these gave.

    Arguments: a single run; the axes to draw on, new ones if None. Returns the axes. Raises
    ValueError for a batch of runs, a run without values, and what is no run.
    """
    require_one_run(run)
    path = path_of(run)
    ax = axes_of(ax)
    # Between impacts the energy is constant; at one out of time the value is that after it.
    ax.plot(path.time, path.energy, drawstyle="steps-post", lw=2.2, color=SKY, label="energy")
    impacts = run.impacts.to_dict()
    ends = impacts["time"] + np.where(np.isfinite(impacts["duration"]), impacts["duration"], 0.0)
    order = np.argsort(ends, kind="stable")
    ends, losses = ends[order], impacts["energy_loss"][order]
    counts = np.isfinite(losses) & (ends <= float(run.reached))
    when = np.concatenate([[0.0], ends[counts], [float(run.reached)]])
    left = path.energy[0] - np.concatenate([[0.0], np.cumsum(losses[counts])])
    ax.plot(
        when,
        np.append(left, left[-1]),
        drawstyle="steps-post",
        lw=1.2,
        ls="--",
        color=BLACK,
        label="start less the losses of impacts",
    )
    ax.set_xlim(0, float(run.reached))
    put_label(ax.xaxis, "time")
    put_label(ax.yaxis, "energy")
    legend_above(ax)
    return ax
