"""The closing speeds that occur in a scene."""

from __future__ import annotations

import math
from typing import Any

import equinox as eqx
import numpy as np

from ..._entry import as_numbers, rendered
from ..._scene import Ending
from ..._scene.simulate import simulate_scene
from ..._text.progress import progress_of_run
from .model import SceneModel

FEW = 8
"""Largest number of spheres of a scene that is simulated for its closing speeds."""

_SLOWEST, _COUNT = 0.1, 4
"""Smallest closing speed over the largest, and the number of speeds between both."""

_MARGIN = 1.2
"""Largest speed over that of a run without duration of impacts, whose later impacts differ."""


def require_range(velocity: Any) -> tuple[float, float] | None:
    """Return the smallest and the largest closing speed, or None. Raises ValueError for others."""
    if velocity is None:
        return None
    ends = as_numbers(velocity, "velocity")
    if ends.shape != (2,) or not (np.isfinite(ends).all() and 0 < ends[0] <= ends[1]):
        raise ValueError(
            "Argument `velocity` must be the smallest and the largest closing speed, above 0, "
            f"but is {rendered(velocity)}."
        )
    return float(ends[0]), float(ends[1])


def closing_speeds(
    model: SceneModel, duration: float, velocity: tuple[float, float] | None
) -> np.ndarray:
    """Return closing speeds in m/s, ascending, between the given ones or those that occur.

    Up to `FEW` spheres are simulated with impacts of no duration. For more, with friction, and if
    that run has no impact, the largest speed is estimated. It has the largest difference of two
    velocities, the speeds of walls and of turning surfaces, and that of a fall through the scene as
    it starts.
    """
    if velocity is not None:
        low, high = velocity
    else:
        found = _simulated(model, duration)
        low, high = found or (0.0, 0.0)
        # Friction may turn a spin or the speed of a belt into closing speeds.
        if found is None or model.scene.friction is not None:
            high = max(high, _estimate(model, duration))
    low = min(max(low, _SLOWEST * high), high)
    return np.geomspace(low, high, _COUNT) if low < high else np.array([high])


def _simulated(model: SceneModel, duration: float) -> tuple[float, float] | None:
    if len(model.radius) > FEW:
        return None
    # Friction changes them little, and has no outcome for some laws.
    scene = eqx.tree_at(lambda x: x.friction, model.scene, None, is_leaf=lambda x: x is None)
    with progress_of_run(False) as tell:
        run = simulate_scene(
            scene,
            duration,
            times=None,
            rtol=1e-6,
            # Adhesion with memory has no instantaneous impacts.
            instantaneous=not any(law.forgets for law in scene.law.values),
            v0="peak",
            max_impacts=None,
            max_cluster=None,
            tell=tell,
            throw=False,
        )
    speeds = run.impacts.to_dict()["closing_speed"]
    if not len(speeds) or int(run.status) == Ending.INVALID_INPUT:
        return None
    return float(speeds.min()), _MARGIN * float(speeds.max())


def _estimate(model: SceneModel, duration: float) -> float:
    moving = [m for m in model.motions.values() if m is not None]
    moving += [wall.motion for wall in (*model.flat, *model.round) if wall.motion is not None]
    fastest = [np.linalg.norm(m.speed) + m.rate * np.linalg.norm(m.amplitude) for m in moving]
    middle = model.velocity.mean(axis=0)
    spread = 2 * float(np.max(np.linalg.norm(model.velocity - middle, axis=1)))
    # A mean speed counts, too, if a wall is met.
    spread = max(spread, float(np.max(np.linalg.norm(model.velocity, axis=1))))
    low, high = model.extent()
    pull = float(np.linalg.norm(model.gravity))
    depth = 0.0
    if pull > 0:
        depth = float(np.dot(high - low, np.abs(model.gravity)) / pull)
    fall = pull * duration
    endless = any(
        p is not None and g != 0 for p, g in zip(model.periods, model.gravity, strict=True)
    )
    if not endless:
        fall = min(math.sqrt(2 * pull * depth), fall)
    rolling = float(np.max(np.linalg.norm(model.spin, axis=1) * model.radius))
    speed = math.hypot(spread, fall) + 2 * max([rolling, *map(float, fastest)])
    if not speed > 0:
        raise ValueError(
            "Argument `velocity` must be given for a scene in which nothing moves at the start, "
            "but is None."
        )
    return speed
