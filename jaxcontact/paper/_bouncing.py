"""Beyond the paper: its ball followed to rest, with gravity in contact and without."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import jax.numpy as jnp
import numpy as np

from .._bounce import Bounce, bounce
from .._contact import Contact
from .._impact import Status
from .._laws import HuGuo
from .._units import label
from . import _ball
from ._reproduction import Reproduction, Table
from ._style import RESTITUTIONS, SHADES, legend_above, sheet

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BOUNCES = 40
"""Enough for the ball of e = 0.8 to come to rest; that of e = 1.0 never does."""

_SECONDS = np.linspace(0, 4.5, 1201)


def bouncing() -> Reproduction:
    """Height against time under Hu-Guo's law, and below it what gravity in contact does to e.

    Tables: "height"; "touches", of both runs of each e; "rest", when and after how many bounces
    each run came to rest, and what its contacts and its unlisted flights add up to.
    """
    runs = {felt: _run(felt) for felt in (False, True)}
    figure, (top, bottom) = sheet(2, 1, height=4.2)
    heights = np.asarray(runs[True].height_at(jnp.asarray(_SECONDS)))
    for i, e in enumerate(RESTITUTIONS):
        if e < 1:
            top.plot(_SECONDS, heights[i], color=SHADES[e], linewidth=0.9, label=f"e = {e:.1f}")
            _draw_restitution(bottom, runs, i, SHADES[e])
    top.set_xlabel(label("time"))
    top.set_ylabel(label("height"))
    bottom.set_xscale("log")
    bottom.set_xlabel(label("impact_velocity", "speed at touch"))
    bottom.set_ylabel(label("restitution"))
    legend_above(figure, top, columns=4)
    tables = {
        "height": {"time_s": _SECONDS}
        | {f"e_{e:g}_m": heights[i] for i, e in enumerate(RESTITUTIONS)},
        "touches": _touches(runs),
        "rest": _rest(runs),
    }
    return Reproduction(figure, tables)


def _run(felt: bool) -> Bounce:
    contact = Contact(mass=_ball.MASS, stiffness=_ball.STIFFNESS)
    law = HuGuo(e=jnp.asarray(RESTITUTIONS))
    return bounce(
        law,
        contact,
        _ball.DROP,
        gravity=_ball.GRAVITY,
        bounces=BOUNCES,
        gravity_in_contact=felt,
    )


def _draw_restitution(ax: Axes, runs: dict[bool, Bounce], i: int, colour: str) -> None:
    looks: dict[bool, dict[str, Any]] = {
        False: {"linestyle": ":"},
        True: {"marker": ".", "linestyle": "-"},
    }
    for felt, look in looks.items():
        run = runs[felt]
        left = np.asarray(run.status[i]) == int(Status.SEPARATED)
        speed, e = np.asarray(run.impact_velocity[i]), np.asarray(run.restitution[i])
        ax.plot(speed[left], e[left], color=colour, linewidth=0.9, markersize=3, **look)


def _touches(runs: dict[bool, Bounce]) -> Table:
    count = len(RESTITUTIONS)
    fields = {
        "time_s": "time",
        "duration_s": "duration",
        "velocity_m_per_s": "impact_velocity",
        "restitution": "restitution",
        "height_m": "height",
        "status": "status",
    }
    table: Table = {
        "gravity_in_contact": np.repeat(list(runs), count * BOUNCES),
        "e_in": np.tile(np.repeat(RESTITUTIONS, BOUNCES), len(runs)),
        "touch": np.tile(np.arange(1, BOUNCES + 1), len(runs) * count),
    }
    for column, field in fields.items():
        table[column] = np.concatenate(
            [np.asarray(getattr(run, field)).ravel() for run in runs.values()]
        )
    return table


def _rest(runs: dict[bool, Bounce]) -> Table:
    count = len(RESTITUTIONS)
    left = [np.asarray(run.status) == int(Status.SEPARATED) for run in runs.values()]
    contact = [
        np.where(kept, np.asarray(run.duration), 0).sum(axis=-1)
        for kept, run in zip(left, runs.values(), strict=True)
    ]
    unlisted = [
        np.full(count, np.nan) if run.remaining_flight is None else np.asarray(run.remaining_flight)
        for run in runs.values()
    ]
    return {
        "gravity_in_contact": np.repeat(list(runs), count),
        "e_in": np.tile(RESTITUTIONS, len(runs)),
        "bounces": np.concatenate([kept.sum(axis=-1) for kept in left]),
        "rest_time_s": np.concatenate([np.asarray(run.rest_time) for run in runs.values()]),
        "contact_time_s": np.concatenate(contact),
        "remaining_flight_s": np.concatenate(unlisted),
        "rest_velocity_m_per_s": np.concatenate([run.rest_velocity for run in runs.values()]),
        "rest_indentation_m": np.concatenate([run.rest_indentation for run in runs.values()]),
    }
