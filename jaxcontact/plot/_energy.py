"""The plot of the energy of a run."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .._scene import EngineRun, Run
from ._drawing.axes import axes_of
from ._drawing.labels import put_label
from ._drawing.path import path_of, require_one_run
from ._drawing.style import BLACK, SKY, legend_above

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def energy(run: Run | EngineRun, *, ax: Axes | None = None) -> Axes:
    """Draw the energy of a run over time (J, s), and the energy left by the losses of its impacts.

    The solid line is the energy from `Run.at`: kinetic, gravitational, and stored in contacts. The
    dashed line starts at the same value and falls at the end of every impact by its loss. For a
    series of bounces and for a contact that comes to rest it falls at the touch. If both lines
    agree, the energy is accounted for. With moving walls the solid line includes the energy
    supplied by them. The loss by sliding on walls at rest is not in the dashed line. For an
    `EngineRun` the solid line is kinetic and gravitational energy, and there is no other.

    Arguments: a single run; the axes to draw on, new ones if None. Returns the axes. Raises
    ValueError for a batch of runs, a run without values, and for anything but a run.
    """
    require_one_run(run)
    path = path_of(run)
    ax = axes_of(ax)
    # Between impacts the energy is constant; at an instantaneous one the value is that after it.
    ax.plot(path.time, path.energy, drawstyle="steps-post", lw=2.2, color=SKY, label="energy")
    if isinstance(run, EngineRun):
        return _labelled(ax, run)
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
        label="start minus the losses of impacts",
    )
    return _labelled(ax, run)


def _labelled(ax: Axes, run: Run | EngineRun) -> Axes:
    ax.set_xlim(0, float(run.reached))
    put_label(ax.xaxis, "time")
    put_label(ax.yaxis, "energy")
    legend_above(ax)
    return ax
