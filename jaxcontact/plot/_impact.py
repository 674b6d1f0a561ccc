"""The plots of one impact: one quantity over another, its hysteresis loop, its course in time, and
its energies.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from .._entry import require_choice, require_kind
from .._impact import Impact, Status, Trajectory
from .._scene import EngineRun, Run
from .._text.units import quantity
from ._drawing.labels import put_label
from ._drawing.path import RunPath, path_of, require_one_run
from ._drawing.style import BLACK, GUIDE, SKY, axes_for, axes_of, legend_above, require_label

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_QUANTITIES = ("time", "indentation", "velocity", "force")


def trajectory(
    path: Trajectory,
    *,
    x: str = "time",
    y: str = "force",
    ax: Axes | None = None,
    label: str | None = None,
) -> Axes:
    """Draw one quantity of an impact over another; force over indentation is the hysteresis loop.

    Arguments: one trajectory (no batch); `x` and `y`, each "time", "indentation", "velocity" or
    "force"; the axes to draw on, new ones if None; a label for the legend. Returns the axes. Raises
    ValueError for an unknown quantity, a batch, and for anything but a trajectory and axes.
    """
    require_choice("x", x, _QUANTITIES)
    require_choice("y", y, _QUANTITIES)
    require_one_path(path)
    require_label(label)
    ax = axes_of(ax)
    ax.plot(np.asarray(getattr(path, x)), np.asarray(getattr(path, y)), label=label)
    put_label(ax.xaxis, x, x)
    put_label(ax.yaxis, y, y)
    return ax


def require_one_path(path: object) -> Trajectory:
    """Return a single trajectory with values to draw; ValueError for anything else."""
    if isinstance(path, Impact):
        raise ValueError(
            "Argument `path` must be a `Trajectory`, but is an `Impact`, which has no time "
            "history: give `trajectory(law, contact, velocity)`, and to `plot.impact` both."
        )
    chosen = require_kind("path", path, Trajectory, "a `Trajectory`")
    if chosen.time.ndim != 1:
        raise ValueError(
            f"Argument `path` must be a single trajectory, but has the shape {chosen.time.shape}."
        )
    if not np.isfinite(np.asarray(chosen.time)).all():
        raise ValueError(
            "Argument `path` must have values to draw, but they are NaN: its status is "
            f"{Status.names_of(chosen.status)}."
        )
    return chosen


_PICTURES = (("indentation", "force"), ("time", "force"), ("time", "velocity"))


def impact(
    path: Trajectory, hit: Impact | None = None, *, ax: Any = None, label: str | None = None
) -> np.ndarray:
    """Draw one impact: its force over the indentation and over time, and its speed over time.

    The area of the loop is the energy lost. With `hit`, dotted lines mark the results of the
    `Impact`: the largest force and indentation, the ends of compression and contact, and the
    rebound speed. The title states e and the energy lost.

    Arguments: a single `path`, from `trajectory`; the `hit` of the same impact, from `impact`;
    three axes to draw on, new ones if None; a `label` for the legend. Pass the axes of another
    impact to draw both. Returns the three axes, (3,). Raises ValueError for a batch, a path without
    values, and for anything but a trajectory, impact, text and axes.
    """
    require_one_path(path)
    require_label(label)
    if hit is not None:
        require_kind("hit", hit, Impact, "an `Impact` (see `impact`) or None")
        if np.ndim(hit.restitution) > 0:
            raise ValueError(
                "Argument `hit` must be a single impact, but has the shape "
                f"{hit.restitution.shape}."
            )
    loop, force, speed = axes = axes_for(ax, 3, "picture")
    for picture, (x, y) in zip(axes, _PICTURES, strict=True):
        trajectory(path, x=x, y=y, ax=picture, label=label)
    colour = loop.lines[-1].get_color()
    loop.fill(path.indentation, path.force, color=colour, alpha=0.12, lw=0)
    speed.axhline(0, color=GUIDE, lw=0.8, zorder=1)
    if hit is not None:
        marks = [(loop.axhline, hit.max_force), (loop.axvline, hit.max_indentation)]
        marks += [(force.axhline, hit.max_force), (speed.axhline, -hit.rebound_velocity)]
        marks += [(force.axvline, hit.compression_time), (force.axvline, hit.duration)]
        marks += [(speed.axvline, hit.compression_time), (speed.axvline, hit.duration)]
        for draw, at in marks:
            # A contact that settles has an infinite duration.
            if np.isfinite(at):
                draw(float(at), color=colour, ls=":", lw=0.9, zorder=1)
        lost = quantity("energy_loss", f"{float(hit.energy_loss):.3g}")
        words = f"$e$ = {float(hit.restitution):.3f}, {lost} lost"
        speed.set_title(words, loc="left", fontsize="small")
    if label is not None:
        legend_above(loop)
    return np.array(axes)


def energy(run: Run | EngineRun, *, ax: Axes | None = None) -> Axes:
    """Draw the energy of a run over time (J, s), and the energy left by the losses of its impacts.

    The solid line is the energy from `Run.at`: kinetic, gravitational, and stored in contacts. The
    dashed line starts at the same value and falls at the end of every impact by its loss. For a
    series of bounces and for a contact that comes to rest it falls at the touch. If both lines
    agree, the energy is accounted for. With moving walls the solid line includes the energy
    supplied by them. The loss by sliding on walls at rest is not in the dashed line. For an
    `EngineRun` the solid line is kinetic and gravitational energy, joined from sample to sample,
    and there is no other.

    Arguments: a single run; the axes to draw on, new ones if None. Returns the axes. Raises
    ValueError for a batch of runs, a run without values, and for anything but a run.
    """
    require_one_run(run)
    path = path_of(run)
    ax = axes_of(ax)
    # Between impacts the energy is constant; at an instantaneous one the value is that after it.
    # Nothing is known between the samples of another engine.
    sampled = isinstance(run, EngineRun)
    steps: dict[str, Any] = {"drawstyle": "default" if sampled else "steps-post"}
    ax.plot(path.time, path.energy, lw=2.2, color=SKY, label="energy", **steps)
    if not sampled:
        words = "start minus the losses of impacts"
        ax.plot(*_less_losses(run, path), lw=1.2, ls="--", color=BLACK, label=words, **steps)
    ax.set_xlim(0, float(run.reached))
    put_label(ax.xaxis, "time")
    put_label(ax.yaxis, "energy")
    legend_above(ax)
    return ax


def _less_losses(run: Run, path: RunPath) -> tuple[np.ndarray, np.ndarray]:
    """Return times, and the energy at the start less the losses of the impacts so far."""
    impacts = run.impacts.to_dict()
    ends = impacts["time"] + np.where(np.isfinite(impacts["duration"]), impacts["duration"], 0.0)
    order = np.argsort(ends, kind="stable")
    ends, losses = ends[order], impacts["energy_loss"][order]
    counts = np.isfinite(losses) & (ends <= float(run.reached))
    when = np.concatenate([[0.0], ends[counts], [float(run.reached)]])
    left = path.energy[0] - np.concatenate([[0.0], np.cumsum(losses[counts])])
    return when, np.append(left, left[-1])
