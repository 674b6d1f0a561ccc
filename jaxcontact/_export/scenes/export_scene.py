"""The public function `export_scene`: from a scene to the model of an engine."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping

import jax
import numpy as np
from jaxtyping import ArrayLike, Float

from ..._entry import (
    FRACTION,
    POSITIVE,
    as_numbers,
    refuses_unknown,
    rendered,
    require_kind,
    require_number,
    require_path,
)
from ..._scene import EngineRun, Scene
from ..._text.files import write_all
from ..._text.table import text_table
from ..result import Export
from .engine import EqualSteps, refuse_adhesion, scene_engine
from .matched import matched
from .model import scene_model
from .read_run import read_run
from .speeds import closing_speeds, require_range

_EVEN = 1e-6
"""Largest deviation of output times from even spacing, relative to it."""


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
    tolerance = require_number("tolerance", tolerance, FRACTION)
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
        raise ValueError(
            "Argument `times` must be evenly spaced from 0 on for an engine, but is "
            f"{rendered(times)}."
        )
    if values[-1] > duration * (1 + _EVEN):
        raise ValueError(
            f"Argument `times` must lie between 0 and the duration, but is {rendered(times)}."
        )
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
            raise ValueError(
                f"Argument `time_step` must be a whole fraction of the {between:g} s between two "
                f"outputs, but is {rendered(given)}."
            )
    return EqualSteps(between / count, count, len(times) - 1)
