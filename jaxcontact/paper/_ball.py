"""The ball of Table 2 and its twenty impacts: four laws, five restitutions, one batch; Figs. 8, 9
and 10. Beyond the paper: the ball followed to rest, with and without gravity in contact.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import jax.numpy as jnp
import numpy as np

from .. import Contact, Damped, HuGuo, Status, bounce, get_law
from ..extend import label
from ._drawing import (
    FOUR_LAWS,
    RESTITUTIONS,
    SHADES,
    VELOCITY,
    Panel,
    Reproduction,
    Table,
    drawn,
    long_table,
)
from ._impacts import cache_by_precision, solve

MASS, RADIUS, HEIGHT, GRAVITY, STIFFNESS = 1.0, 0.1, 1.0, 9.8, 1.4e8
"""Table 2, in kg, m, m, m/s² and N/m^1.5."""

DROP = HEIGHT - RADIUS
"""Fall height of the ball's lowest point, in m."""

SPEED = float(np.sqrt(2 * GRAVITY * DROP))
"""Speed at contact in m/s, Eq. 41 and 42."""

SAMPLES = 200


@cache_by_precision
def impacts() -> SimpleNamespace:
    """Solve the twenty impacts, shape (4, 5) for laws and restitutions, without gravity as in the
    paper.

    JAX's precision setting applies.
    """
    e = jnp.asarray(RESTITUTIONS)
    alpha = jnp.stack([get_law(law.key, e=e).damping_factor() for law in FOUR_LAWS])
    # One law with α as its parameter represents all four, so one compiled solve suffices.
    return solve(Damped(alpha=alpha), Contact(mass=MASS, stiffness=STIFFNESS), SPEED, SAMPLES)


def ball_table() -> Table:
    """Return the outcome of all twenty impacts, law by law, each from e = 1.0 down to 0.2."""
    solved = impacts()
    columns = {
        "law": np.array([[law.key] for law in FOUR_LAWS]),
        "e_in": RESTITUTIONS,
        "alpha": solved.alpha,
        "max_deformation_m": solved.max_indentation,
        "duration_s": solved.duration,
        "max_force_N": solved.max_force,
        "rebound_velocity_m_per_s": solved.rebound_velocity,
        "energy_loss_J": solved.energy_loss,
        "e_out": solved.restitution,
    }
    return long_table(columns)


BOUNCES = 40
"""Enough for the ball of e = 0.8 to come to rest; the ball of e = 1.0 bounces forever."""

_SECONDS = np.linspace(0, 4.5, 1201)

_FELT = (False, True)
"""The two runs: gravity in flight only, and in contact as well."""


def bouncing() -> Reproduction:
    """Plot height against time under the law of Hu and Guo, and e with gravity in contact.

    Tables: "height"; "touches", of both runs of each e; "rest", with the time of rest, the number
    of bounces, and the total times of contacts and of unlisted flights.
    """
    law, contact = HuGuo(e=jnp.asarray(RESTITUTIONS)), Contact(mass=MASS, stiffness=STIFFNESS)
    how = {"gravity": GRAVITY, "bounces": BOUNCES}
    runs = [bounce(law, contact, DROP, gravity_in_contact=felt, **how) for felt in _FELT]

    def both(field: str) -> np.ndarray:
        """Return a field of both runs; NaN for a run without it."""
        values = [getattr(run, field) for run in runs]
        absent = np.full(len(RESTITUTIONS), np.nan)
        return np.stack([absent if x is None else np.asarray(x) for x in values])

    left = both("status") == int(Status.SEPARATED)
    speed, restitution = both("impact_velocity"), both("restitution")
    heights = np.asarray(runs[1].height_at(jnp.asarray(_SECONDS)))
    above, below = [], []
    for i, (e, shade) in enumerate(SHADES.items()):
        if e < 1:
            look: dict[str, Any] = {"color": shade, "lw": 0.9, "label": f"e = {e:.1f}"}
            above.append((_SECONDS, heights[i], look))
            for k, (line, marker) in enumerate(((":", ""), ("-", "."))):
                listed, style = left[k, i], {**look, "ls": line, "marker": marker, "ms": 3}
                below.append((speed[k, i, listed], restitution[k, i, listed], style))
    axes = {"xlabel": label("impact_velocity", "speed at touch"), "xscale": "log"}
    panels = [
        Panel(above, {"xlabel": label("time"), "ylabel": label("height")}),
        Panel(below, {**axes, "ylabel": label("restitution")}),
    ]
    felt, e_in = np.array(_FELT), np.array(RESTITUTIONS)
    touches = {
        "gravity_in_contact": felt[:, None, None],
        "e_in": e_in[:, None],
        "touch": np.arange(1, BOUNCES + 1),
        "time_s": both("time"),
        "duration_s": both("duration"),
        "velocity_m_per_s": speed,
        "restitution": restitution,
        "height_m": both("height"),
        "status": both("status"),
    }
    rest = {
        "gravity_in_contact": felt[:, None],
        "e_in": e_in,
        "bounces": left.sum(axis=-1),
        "rest_time_s": both("rest_time"),
        "contact_time_s": np.where(left, both("duration"), 0).sum(axis=-1),
        "remaining_flight_s": both("remaining_flight"),
        "rest_velocity_m_per_s": both("rest_velocity"),
        "rest_indentation_m": both("rest_indentation"),
    }
    height = {f"e_{e:g}_m": row for e, row in zip(RESTITUTIONS, heights, strict=True)}
    tables = {
        "height": {"time_s": _SECONDS, **height},
        "touches": long_table(touches),
        "rest": long_table(rest),
    }
    return Reproduction(drawn(panels, height=4.4), tables)


_TIME = "time", 1e3, label("time", prefix="m")
_DEFORMATION = "indentation", 1e3, label("indentation", "deformation", prefix="m")


def fig8() -> Reproduction:
    """Plot deformation against time; tables "curves" and "ball", the outcome of all impacts."""
    return _panels(_TIME, _DEFORMATION)


def fig9() -> Reproduction:
    """Plot deformation velocity against time; tables as for `fig8`."""
    return _panels(_TIME, ("velocity", 1.0, VELOCITY))


def fig10() -> Reproduction:
    """Plot contact force against deformation, the hysteresis loops; tables as for `fig8`."""
    return _panels(_DEFORMATION, ("force", 1e-3, label("force", prefix="k")))


def _panels(*axes: tuple[str, float, str]) -> Reproduction:
    """Plot two fields of the impacts, each with the factor of its unit and its label."""
    solved = impacts()
    x, y = (factor * getattr(solved, name) for name, factor, _ in axes)
    panels = []
    for i, law in enumerate(FOUR_LAWS):
        lines = [
            (x[i, j], y[i, j], {"color": shade, "lw": 1.1, "label": f"e = {e:.1f}"})
            for j, (e, shade) in enumerate(SHADES.items())
        ]
        frame = {"xlabel": axes[0][2]} if i >= 2 else {}
        frame |= {} if i % 2 else {"ylabel": axes[1][2]}
        panels.append(Panel(lines, frame, f"({law.panel}) {law.name}"))
    curves = {
        "law": np.array([[[law.key]] for law in FOUR_LAWS]),
        "e_in": np.array(RESTITUTIONS)[:, None],
        "time_s": solved.time,
        "deformation_m": solved.indentation,
        "velocity_m_per_s": solved.velocity,
        "force_N": solved.force,
    }
    figure = drawn(panels, 2, height=4.1, legend=3, share="xy")
    return Reproduction(figure, {"curves": long_table(curves), "ball": ball_table()})
