"""Scenes by engines, as far as the contacts of Exudyn and MuJoCo allow."""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np

import jaxcontact as jc
from tests.oracle.moving_table import GRAVITY

from .by_exudyn import settings_of, touch
from .by_mujoco import contact_of
from .engines import needs
from .hard_scenes import DAMPING, HEIGHT, STIFFNESS
from .line_scenes import Line, pairs_of
from .measure import NotPossibleError

MOST = 600_000
"""Steps of one run: some seconds."""
SOFT = 0.005
"""s, of the contacts by which MuJoCo goes through impacts that are far from each other."""


def _counted(duration: float, contact: float, steps: float) -> int:
    """Steps of a run of which a contact takes `steps`."""
    count = math.ceil(duration / contact * steps)
    if count > MOST:
        raise NotPossibleError(f"that is {count:,} steps, with contacts of {contact:.0e} s")
    return count


def _contact_time(line: Line) -> float:
    """The shortest contact, about: 2.94 X/v of Hertz, at the speed of the first sphere."""
    speed = float(np.max(np.abs(line.velocity)))
    first, second = pairs_of(line)
    mass = 1 / (1 / line.mass[first] + 1 / line.mass[second])
    return float(np.min(2.94 * (mass * speed**2 / line.stiffness) ** 0.4 / speed))


_HUNT_CROSSLEY = {"impactModel": 1, "contactStiffnessExponent": 1.5}
"""Its impactModel 1 has α = (3/2)(1 - e)."""


def _three(x: np.ndarray) -> list[float]:
    return [*map(float, x), *[0.0] * (3 - len(x))]


def _solve(system: Any, duration: float, count: int, written: float | None = None) -> None:
    """Steps of one length; sensors are `written` at the end, or so often in s."""
    import exudyn

    settings = settings_of(duration / count, count)
    settings.solutionSettings.sensorsWritePeriod = written or duration
    system.SolveDynamic(settings, solverType=exudyn.DynamicSolverType.RK44)


def line_by_exudyn(line: Line, steps: float) -> np.ndarray:
    """With e for the α of the scene its law is the scene's."""
    needs("exudyn")
    import exudyn

    count = _counted(line.duration, _contact_time(line), steps)
    system = exudyn.SystemContainer().AddSystem()
    balls = [
        system.CreateMassPoint(
            referencePosition=_three(x), initialVelocity=_three(v), mass=float(m), gravity=[0, 0, 0]
        )
        for x, v, m in zip(line.position, line.velocity, line.mass, strict=True)
    ]
    law = {"restitutionCoefficient": 1 - line.alpha / 1.5, "contactStiffness": line.stiffness}
    for i, j in zip(*pairs_of(line), strict=True):
        radii = [float(line.radius[i]), float(line.radius[j])]
        gap = float(np.linalg.norm(line.position[i] - line.position[j])) - sum(radii)
        touch(system, balls[i], balls[j], gap, radii, **law, **_HUNT_CROSSLEY)
    system.Assemble()
    _solve(system, line.duration, count)
    kind = exudyn.OutputVariableType.Velocity
    dimensions = line.position.shape[1]
    return np.concatenate([system.GetObjectOutputBody(b, kind)[:dimensions] for b in balls])


def rest_by_exudyn(steps: float) -> float:
    """The last touch of the ball, on a straight line between two steps."""
    needs("exudyn")
    import exudyn
    from exudyn.utilities import SensorBody

    radius, mass = 0.1, 1.0
    speed = math.sqrt(2 * GRAVITY * HEIGHT)
    contact = 2.94 * (mass * speed**2 / STIFFNESS) ** 0.4 / speed
    duration = 3.0
    count = _counted(duration, contact, steps)
    system = exudyn.SystemContainer().AddSystem()
    ball = system.CreateMassPoint(
        referencePosition=[0, 0, 2 * radius + HEIGHT], mass=mass, gravity=[0, 0, -GRAVITY]
    )
    law = {"restitutionCoefficient": 1 - DAMPING / 1.5, "contactStiffness": STIFFNESS}
    touch(system, ball, None, HEIGHT, [radius, radius], **law, **_HUNT_CROSSLEY)
    kind = exudyn.OutputVariableType.Position
    sensor = system.AddSensor(
        SensorBody(bodyNumber=ball, storeInternal=True, outputVariableType=kind)
    )
    system.Assemble()
    _solve(system, duration, count, duration / count)
    record = system.GetSensorStoredData(sensor)
    t, gap = record[:, 0], record[:, 3] - 2 * radius
    last = np.flatnonzero((gap[:-1] > 0) & (gap[1:] <= 0))[-1]
    part = gap[last] / (gap[last] - gap[last + 1])
    return float(t[last] + part * (t[last + 1] - t[last]))


_MUJOCO = """<mujoco><option timestep="{step!r}" gravity="0 0 0">
  <flag warmstart="disable"/></option>
  <default><geom condim="1" {contact}/></default><worldbody>{balls}</worldbody></mujoco>"""
_BALL = """<body pos="{x!r} 0 0"><joint type="slide" axis="1 0 0"/>
  <geom type="sphere" size="{radius!r}" mass="{mass!r}"/></body>"""


def line_by_mujoco(line: Line, steps: float) -> np.ndarray:
    """Its contact is a spring and a dashpot: what counts in a line of balls that lie apart is e."""
    needs("mujoco")
    import mujoco

    count = _counted(line.duration, SOFT, steps)
    model = _mujoco_model(line, count)
    data = mujoco.MjData(model)
    data.qvel[:] = line.velocity[:, 0]
    mujoco.mj_step(model, data, count)
    return np.array(data.qvel)


@functools.lru_cache(4)
def _mujoco_of(key: tuple[Any, ...]) -> Any:
    import mujoco

    position, radius, mass, alpha, step = key
    law = jc.Damped(alpha=alpha)
    contact = jc.Contact(1.0, 1.0)
    unit = float(jc.impact(law, contact, 1.0).duration)
    # An exponent of 1.5: T = τ (m/K)^(2/5) v^(-1/5), at 1 m/s.
    stiff = jc.Contact(1.0, (unit / SOFT) ** 2.5)
    found = jc.export(law, stiff, 1.0, engine="mujoco")
    balls = "".join(
        _BALL.format(x=x, radius=r, mass=m) for x, r, m in zip(position, radius, mass, strict=True)
    )
    text = _MUJOCO.format(step=step, contact=contact_of(found.parameters), balls=balls)
    return mujoco.MjModel.from_xml_string(text)


def _mujoco_model(line: Line, count: int) -> Any:
    numbers = (line.position[:, 0], line.radius, line.mass)
    each = (tuple(x.tolist()) for x in numbers)
    return _mujoco_of((*each, line.alpha, line.duration / count))
