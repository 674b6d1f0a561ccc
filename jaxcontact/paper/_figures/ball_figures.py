"""Figs. 8, 9 and 10: the ball's impact under four laws, one panel each."""

from __future__ import annotations

import numpy as np

from ..._text.units import label
from .._ball import ball_table, impacts
from .._impacts import SolvedImpacts
from .._reproduction import Reproduction, long_table
from .style import FOUR_LAWS, RESTITUTIONS, SHADES, VELOCITY, legend_above, sheet

_MILLI, _KILO = 1e3, 1e-3

_TIME = label("time", prefix="m")
_DEFORMATION = label("indentation", "deformation", prefix="m")


def fig8() -> Reproduction:
    """Plot deformation against time; tables "curves" and "ball", the outcome of all impacts."""
    solved = impacts()
    x, y = _MILLI * solved.time, _MILLI * solved.indentation
    return _panels(solved, x, y, _TIME, _DEFORMATION)


def fig9() -> Reproduction:
    """Plot deformation velocity against time; tables as for `fig8`."""
    solved = impacts()
    return _panels(solved, _MILLI * solved.time, solved.velocity, _TIME, VELOCITY)


def fig10() -> Reproduction:
    """Plot contact force against deformation, the hysteresis loops; tables as for `fig8`."""
    solved = impacts()
    x, y = _MILLI * solved.indentation, _KILO * solved.force
    return _panels(solved, x, y, _DEFORMATION, label("force", prefix="k"))


def _panels(
    solved: SolvedImpacts, x: np.ndarray, y: np.ndarray, across: str, up: str
) -> Reproduction:
    figure, axes = sheet(2, 2, height=4.1, sharex=True, sharey=True)
    for i, (law, ax) in enumerate(zip(FOUR_LAWS, axes, strict=True)):
        for j, e in enumerate(RESTITUTIONS):
            ax.plot(x[i, j], y[i, j], color=SHADES[e], linewidth=1.1, label=f"e = {e:.1f}")
        ax.title.set_text(f"({law.panel}) {law.name}")
    for ax in axes[2:]:
        ax.set_xlabel(across)
    for ax in axes[::2]:
        ax.set_ylabel(up)
    legend_above(figure, axes[0], columns=3)
    curves = {
        "law": np.array([[[law.key]] for law in FOUR_LAWS]),
        "e_in": np.array(RESTITUTIONS)[:, None],
        "time_s": solved.time,
        "deformation_m": solved.indentation,
        "velocity_m_per_s": solved.velocity,
        "force_N": solved.force,
    }
    return Reproduction(figure, {"curves": long_table(curves), "ball": ball_table()})
