"""Fig. 3: velocity and deformation against time, for the two impacts of Eq. 15."""

from __future__ import annotations

import numpy as np

from ..._text.units import label
from .._cases import CASES, impacts
from .._reproduction import Reproduction, long_table
from .style import VELOCITY, sheet


def fig3() -> Reproduction:
    """Plot the whole impact of both cases, with the turn as a dotted line.

    Tables: "motion" (case, time, deformation, velocity) and "impact". The latter lists for each
    case α = c v0/K, the delivered restitution, the duration, and the time and depth of the turn.
    """
    solved = impacts()
    figure, axes = sheet(2, 2, height=3.0)
    for i, case in enumerate(CASES):
        top, bottom = axes[i], axes[2 + i]
        time, turn = solved.time[i] * 1e6, float(solved.compression_time[i]) * 1e6
        top.axhline(0, color="0.7", linewidth=0.6)
        top.plot(time, solved.velocity[i], color="black", linewidth=1.2)
        bottom.plot(time, solved.indentation[i] * 1e6, color="black", linewidth=1.2)
        for ax in (top, bottom):
            ax.axvline(turn, color="0.5", ls=":", linewidth=0.8)
            ax.set_xlim(0, float(time[-1]))
            ax.locator_params(axis="x", nbins=4)
        top.tick_params(labelbottom=False)
        top.title.set_text(case.label)
        top.set_ylim(-1.1 * case.velocity, 1.1 * case.velocity)
        top.set_yticks([-case.velocity, 0, case.velocity])
        bottom.set_ylim(bottom=0)
        bottom.set_xlabel(label("time", prefix="µ"))
    axes[0].set_ylabel(VELOCITY)
    axes[2].set_ylabel(label("indentation", "deformation", prefix="µ"))
    number = np.arange(1, len(CASES) + 1)
    motion = {
        "case": number[:, None],
        "time_s": solved.time,
        "deformation_m": solved.indentation,
        "velocity_m_per_s": solved.velocity,
    }
    outcome = {
        "case": number,
        "impact_velocity_m_per_s": np.array([case.velocity for case in CASES]),
        "alpha": solved.alpha,
        "restitution": solved.restitution,
        "duration_s": solved.duration,
        "compression_time_s": solved.compression_time,
        "max_deformation_m": solved.max_indentation,
    }
    return Reproduction(figure, {"motion": long_table(motion), "impact": outcome})
