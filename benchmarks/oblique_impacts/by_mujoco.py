"""MuJoCo: a ball on a plane with friction."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from .problems import CHI, MOBILITY, MU

KAPPA = 2 * CHI / MOBILITY
ASKED = 0.9
"""The e of its spring and dashpot; without damping its friction vanishes."""
_STIFFNESS, FRICTION = 1e8, 1e5

_MODEL = """<mujoco>
  <option timestep="{step!r}" gravity="0 0 0" cone="elliptic"><flag warmstart="disable"/></option>
  <worldbody><geom name="wall" type="plane" size="5 5 1"/>
    <body pos="0 0 1"><freejoint/><geom name="ball" type="sphere" size="1" mass="1"/></body>
  </worldbody><contact><pair geom1="wall" geom2="ball" {contact}/></contact></mujoco>"""


def call_of(
    psi: np.ndarray, steps: int, damped: bool
) -> Callable[[], tuple[np.ndarray, np.ndarray]]:
    """Return a call that runs an impact for each ψ1, and gives ψ2 and the restitution.

    `damped`: whether friction has a damping of its own (`solreffriction`); otherwise it has that
    of the contact.
    """
    import mujoco

    ratio = -math.log(ASKED) / math.hypot(math.pi, math.log(ASKED))
    damping = 2 * ratio * math.sqrt(_STIFFNESS)
    contact = (
        f'condim="3" friction="{MU} {MU} 0 0 0" solref="{-_STIFFNESS!r} {-damping!r}" '
        'solimp="0.9999 0.9999 0.001 0.5 2"'
    )
    if damped:
        contact += f' solreffriction="-1 -{FRICTION!r}"'
    step = math.pi / math.sqrt(_STIFFNESS) / steps
    model = mujoco.MjModel.from_xml_string(_MODEL.format(step=step, contact=contact))
    data = mujoco.MjData(model)

    def run() -> tuple[np.ndarray, np.ndarray]:
        found = np.empty((2, len(psi)))
        for k, speed in enumerate(psi * MU / KAPPA):
            mujoco.mj_resetData(model, data)
            data.qvel[:] = (speed, 0, -1, 0, 0, 0)
            mujoco.mj_step(model, data, steps + steps // 3)
            found[:, k] = data.qvel[0] - data.qvel[4], data.qvel[2]
        return found[0] * KAPPA / MU, found[1]

    return run
