"""The public function `export_scene`: from a scene to the model of an engine."""

from __future__ import annotations

import dataclasses
import itertools
import math
import os
from collections.abc import Iterable, Mapping
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import ArrayLike, Float

from ... import Ending, EngineRun, Scene, impact, simulate
from ...extend import (
    POSITIVE,
    as_numbers,
    refusal,
    refuses_unknown,
    require_kind,
    require_number,
    require_path,
    restitution_is_constant,
    text_table,
    write_all,
)
from ..at_time_step import TimeStepRestitution, restitution_in_steps
from ..export import export
from ..inside.time_step import ERROR
from ..result import Export
from .engine import EqualSteps, SceneEngine, refuse_adhesion, scene_engine
from .model import SceneModel, Touch, scene_model
from .read_run import read_run

_EVEN = 1e-6
"""Largest deviation of output times from even spacing, relative to it."""

FEW = 8
"""Largest number of spheres of a scene that is simulated for its closing speeds."""

_SLOWEST, _COUNT = 0.1, 4
"""Smallest closing speed over the largest, and the number of speeds between both."""

_MARGIN = 1.2
"""Largest speed over that of a run without duration of impacts, whose later impacts differ."""

Pair = tuple[int, int]

_EQUAL = 8
"""Decimals of errors of e that count as equal: a solve is as accurate."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class SceneExport:
    """A complete model of a scene for an engine, as `export_scene` returns it.

    `files` has the texts of the model by file name, `command` runs it in their folder, and `output`
    is the file that it then writes. `time_step` is in s; `steps` is their number. `velocity` has
    the smallest and the largest closing speed in m/s for which the contacts were matched.

    `expected_error` is the largest error of e in an impact: that of the engine's law over these
    speeds, plus that of its time step. `keeps_tolerance` is False if it is above the `tolerance`.
    `contacts` has the `Export` of each kind of contact.
    """

    engine: str
    files: Mapping[str, str]
    command: str
    output: str
    time_step: float
    steps: int
    velocity: tuple[float, float]
    tolerance: float
    expected_error: float
    contacts: tuple[Export, ...]
    scene: Scene

    @property
    def keeps_tolerance(self) -> bool:
        """True if e stays within the tolerance."""
        return self.expected_error <= self.tolerance * (1 + 1e-6)

    def write(self, folder: str | os.PathLike[str]) -> None:
        """Write all files into a folder, which is made if missing."""
        path = require_path("folder", folder)
        write_all({path / name: text.encode() for name, text in self.files.items()})

    def read(self, folder: str | os.PathLike[str]) -> EngineRun:
        """Read the output of a run in this folder; see `read_run`, which also raises the errors."""
        path = require_path("folder", folder) / self.output
        return read_run(path, self.engine, self.scene, duration=self.steps * self.time_step)

    def __repr__(self) -> str:
        low, high = self.velocity
        error = f"{self.expected_error:.2g}"
        if not self.keeps_tolerance:
            error += f", above the tolerance {self.tolerance:g}"
        rows = [
            ("files", ", ".join(self.files)),
            ("command", self.command),
            ("output", self.output),
            ("steps", f"{self.steps} of {self.time_step:.4g} s"),
            ("closing speeds", f"{low:.3g} to {high:.3g} m/s"),
            ("error of e", error),
        ]
        limits = dict.fromkeys(f"{made.model}: {made.limit}" for made in self.contacts)
        lines = [f"Scene for {self.engine}", *text_table(rows, indent=2)]
        return "\n".join([*lines, *(f"  limit of {limit}" for limit in limits)])


@refuses_unknown
def export_scene(
    scene: Scene,
    engine: str,
    duration: float,
    *,
    times: ArrayLike | None = None,
    time_step: float | None = None,
    tolerance: float = 1e-3,
    velocity: tuple[float, float] | None = None,
) -> SceneExport:
    """Write a scene as a complete model of an engine, whose impacts have the e of the scene's laws.

    Each kind of contact gets its own parameters, those of `export`. The engine runs the whole scene
    with its own time steps, so that its impacts take time. Engines: "drake", "exudyn", "lammps",
    "mujoco".

    - `duration`: in s. `times` (T,): output times in s, from 0 in equal steps. Default: start and
      end.
    - `time_step`: in s, a whole fraction of the time between two outputs. By default the longest
      for which the steps change no e by more than the engine's law leaves of the `tolerance`.
    - `tolerance`: of e, absolute.
    - `velocity`: the smallest and the largest closing speed in m/s. By default, up to 8 spheres are
      simulated with instantaneous impacts. For more, and with friction, the largest speed is
      estimated from the start velocities, spins, the walls' speeds and the depth of a fall within
      the scene as it starts. Spheres that leave it may be faster. The smallest is at least a tenth
      of the largest. A law whose e does not depend on speed is matched at all speeds.

    Returns a `SceneExport`, whose `expected_error` is also given where it is above the tolerance.
    Computes in double precision for any setting of JAX. Raises ValueError for what the engine
    cannot express, which the message names, and for arguments out of range.
    """
    model_of = scene_engine(engine)
    require_kind("scene", scene, Scene, "a `Scene`")
    duration = require_number("duration", duration, POSITIVE)
    tolerance = require_number("tolerance", tolerance, ERROR)
    outputs, ends = _outputs(times, duration), require_range(velocity)
    with jax.enable_x64(True):
        model = scene_model(scene, merges=model_of.merges)
        refuse_adhesion(model, model_of)
        model_of.refuse(model)
        speeds = closing_speeds(model, duration, ends)
        found = matched(model, model_of, speeds, tolerance)
        steps = _steps(outputs, found.time_step, time_step)
        return SceneExport(
            engine=engine,
            files=model_of.files(model, found.exports, steps),
            command=model_of.command,
            output=model_of.output,
            time_step=steps.length,
            steps=steps.between * steps.outputs,
            velocity=(float(speeds[0]), float(speeds[-1])),
            tolerance=tolerance,
            expected_error=found.law_error + found.step_error(steps.length),
            contacts=tuple({made.snippet: made for made in found.exports.values()}.values()),
            scene=scene,
        )


def _outputs(times: ArrayLike | None, duration: float) -> Float[np.ndarray, " T"]:
    """Return the output times; ValueError unless they are evenly spaced from zero on."""
    if times is None:
        return np.array([0.0, duration])
    values = as_numbers(times, "times")
    even = values.ndim == 1 and values.size > 1 and values[0] == 0 and values[1] > 0
    if not even or np.ptp(np.diff(values)) > _EVEN * values[1]:
        raise refusal("times", "be evenly spaced from 0 on for an engine", times)
    if values[-1] > duration * (1 + _EVEN):
        raise refusal("times", "lie between 0 and the duration", times)
    return values


def _steps(times: Float[np.ndarray, " T"], longest: float, given: float | None) -> EqualSteps:
    """Return steps of which a whole number fits between two outputs."""
    between = float(times[-1]) / (len(times) - 1)
    if given is None:
        count = int(np.ceil(between / longest))
    else:
        given = require_number("time_step", given, POSITIVE)
        count = round(between / given)
        if count < 1 or abs(count * given / between - 1) > _EVEN:
            must = f"be a whole fraction of the {between:g} s between two outputs"
            raise refusal("time_step", must, given)
    return EqualSteps(between / count, count, len(times) - 1)


def require_range(velocity: Any) -> tuple[float, float] | None:
    """Return the smallest and the largest closing speed, or None. Raises ValueError for others."""
    if velocity is None:
        return None
    ends = as_numbers(velocity, "velocity")
    if ends.shape != (2,) or not (np.isfinite(ends).all() and 0 < ends[0] <= ends[1]):
        must = "be the smallest and the largest closing speed, above 0"
        raise refusal("velocity", must, velocity)
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
    # Adhesion with memory has no instantaneous impacts.
    rigid = not any(law.forgets for law in scene.law.values)
    run = simulate(scene, duration, rtol=1e-6, instantaneous=rigid, progress=False, throw=False)
    speeds = run.impacts.to_dict()["closing_speed"]
    if not len(speeds) or int(run.status) == Ending.INVALID_INPUT:
        return None
    return float(speeds.min()), _MARGIN * float(speeds.max())


def _estimate(model: SceneModel, duration: float) -> float:
    motions = *model.motions.values(), *(wall.motion for wall in (*model.flat, *model.round))
    moving = filter(None, motions)
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


@dataclasses.dataclass(frozen=True, kw_only=True)
class Matched:
    """The contacts of a scene in an engine.

    `exports` has the parameters for each pair of groups. `time_step` in s is the longest with which
    no e changes by more than `tolerance`, that of the steps, at the closing `speeds` in m/s. These
    are the largest one and, if some e depends on speed, the smallest, at which e may be larger.
    `law_error` is the largest error of e with short steps, over all closing speeds.
    """

    exports: Mapping[Pair, Export]
    time_step: float
    law_error: float
    speeds: tuple[float, ...]
    tolerance: float

    def step_error(self, time_step: float) -> float:
        """Return the largest error of e by steps of this length in s.

        Raises ValueError for steps of an engine whose error was measured with shorter ones only.
        """
        if time_step <= self.time_step * (1 + 1e-9):
            return self.tolerance
        first = next(iter(self.exports.values()))
        if first.scheme is None:
            raise ValueError(
                f"Argument `time_step` must be at most {self.time_step:.6g} s for engine "
                f"{first.engine!r}, whose error with longer steps is not known, but is "
                f"{time_step:g}."
            )
        every = itertools.product(_several(self.exports), self.speeds)
        found = [_stepped(x, speed, self.tolerance, time_step) for x, speed in every]
        return max(max(x.high - x.target, x.target - x.low) for x in found)


def matched(
    model: SceneModel, engine: SceneEngine, speeds: np.ndarray, tolerance: float
) -> Matched:
    """Return the parameters of all contacts at these closing speeds in m/s, ascending.

    Raises ValueError for contacts that the engine cannot deliver, and for a tolerance that no step
    keeps.
    """
    exports = {pair: _closest(touch, engine, speeds) for pair, touch in model.touches.items()}
    constant = all(_is_constant(touch, engine) for touch in model.touches.values())
    ends = {float(speeds[-1])} if constant else {float(speeds[0]), float(speeds[-1])}
    law_error = max(float(np.max(np.abs(made.error))) for made in exports.values())
    # The steps get what the law leaves; if that is nothing, the tolerance is missed anyway.
    left = tolerance - law_error if law_error < tolerance else tolerance
    return Matched(
        exports=exports,
        time_step=min(_longest(made, speed, left) for made in _several(exports) for speed in ends),
        law_error=law_error,
        speeds=tuple(ends),
        tolerance=left,
    )


def _is_constant(touch: Touch, engine: SceneEngine) -> bool:
    """Return whether neither e, that of the law and that of the engine, depends on speed."""
    return restitution_is_constant(touch.law, None) and engine.constant


def _closest(touch: Touch, engine: SceneEngine, speeds: np.ndarray) -> Export:
    """Return the export with the smallest error of e among those that the engine offers."""
    # One speed is exact, and enough where neither law depends on it.
    constant = _is_constant(touch, engine)
    at = float(speeds[-1]) if constant or len(speeds) == 1 else speeds
    found, reasons = [], []
    for options in engine.options(touch, constant):
        try:
            found.append(export(touch.law, touch.contact, at, engine=engine.name, **options))
        except ValueError as reason:
            reasons.append(reason)
    if not found:
        raise reasons[0]
    return min(found, key=lambda made: round(float(np.max(np.abs(made.error))), _EQUAL))


def _longest(made: Export, speed: float, tolerance: float) -> float:
    """Return the longest step in s that keeps the e of a contact; ValueError if there is none."""
    if made.scheme is None:
        # Measured with these steps; the error is taken to fall with the step, or faster.
        assert made.steps is not None and made.expected_error is not None
        e = float(np.max(np.asarray(made.delivered)))
        duration = float(impact(made.law, made.contact, speed).duration)
        return duration / made.steps * min(1.0, tolerance / (made.expected_error * e))
    at = _stepped(made, speed, tolerance)
    if not math.isfinite(at.needed):
        raise ValueError(
            f"Argument `tolerance` must be larger for engine {made.engine!r}: no step keeps e "
            f"within {tolerance:g} of {at.target:.4g}."
        )
    return at.time_step * at.duration / at.needed


def _several(exports: Mapping[Pair, Export]) -> Iterable[Export]:
    """Return one export of each kind: with the same law and contact, steps act alike."""
    kinds = {}
    for made in exports.values():
        leaves = jax.tree.leaves((made.law, made.contact))
        kinds.setdefault((made.model, *map(float, leaves)), made)
    return kinds.values()


def _stepped(
    made: Export, speed: float, within: float, time_step: float | None = None
) -> TimeStepRestitution:
    """Return the e of the engine's steps beside that of its own law, at one speed.

    The step is a fiftieth of the contact unless given in s.
    """
    assert made.scheme is not None
    hit = impact(made.law, made.contact, speed)
    duration = float(hit.duration)
    return restitution_in_steps(
        made.law,
        made.contact,
        speed,
        target=float(hit.restitution),
        duration=duration,
        scheme=made.scheme,
        time_step=duration / 50 if time_step is None else time_step,
        within=within,
    )
