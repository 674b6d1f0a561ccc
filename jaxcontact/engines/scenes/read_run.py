"""The public function `read_run`: the output of an engine as a run."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from ... import EngineRun, Scene
from ...extend import POSITIVE, require_kind, require_number, require_path, words
from .engine import scene_engine
from .model import SceneModel, scene_model

_MISSING = 1.95
"""Steps between two outputs, in the usual ones, from which some are missing. Those of Exudyn may be
late by less than one of its steps.
"""

_LATE = 0.5, 0.02
"""Deviation of the last time that counts as none, in steps between outputs and relative to it.
Exudyn may be late by less than one of its steps.
"""

_SAME = 1e-5
"""Relative deviation of a start or an energy that counts as the same; float32 rounds to 1e-7."""


def read_run(
    file: str | os.PathLike[str], engine: str, scene: Scene, *, duration: float | None = None
) -> EngineRun:
    """Read what an engine wrote for a scene of `export_scene`: run.dump of LAMMPS, else run.csv.

    `scene` is the exported one; its masses and gravity give the energy. `duration` in s is the last
    output time of the export: its own `duration`, or the last of `times`. Without it, a run that
    stopped early is not noticed; `SceneExport.read` gives it. Returns an `EngineRun`, with the
    columns of `Run`.

    Raises ValueError for an unknown engine, a file with other content, and one that ends at another
    time. Raises it, too, for the output of another scene, with other spheres, another start, or
    another energy by its masses and gravity. Laws, friction and walls leave no mark in a file, so
    that others are not noticed. Raises OSError for a file that cannot be read.
    """
    path = require_path("file", file)
    model = scene_model(require_kind("scene", scene, Scene, "a `Scene`"), merges=True)
    source = scene_engine(engine)
    duration = None if duration is None else require_number("duration", duration, POSITIVE)
    with path.open("rb") as raw:
        raw.seek(max(raw.seek(0, os.SEEK_END) - 1, 0))
        whole = raw.read() == b"\n"
    try:
        states = source.read(path, scene)
        whole = whole and all(np.isfinite(x).all() for x in states.values())
    except (ValueError, IndexError, StopIteration) as error:
        raise ValueError(f"{path} must be the output of {engine!r}, but {error}.") from error
    if not whole or len(states["time"]) == 0:
        raise ValueError(f"{path} must be the whole output of {engine!r}, but is cut or has NaN.")
    if ("spin" in states) != (scene.friction is not None):
        raise ValueError(f"{path} must have the spins of `scene`, and none without friction.")
    count = len(model.radius), model.dimensions
    if states["position"].shape[1:] != count:
        raise ValueError(
            f"{path} must have {count[0]} spheres in {count[1]}D, as `scene` has, but has the "
            f"shape {states['position'].shape[1:]}."
        )
    _require_order(path, states["time"])
    if duration is not None:
        _require_end(path, states["time"], duration)
    _require_start(path, model, states)
    spin = states.get("spin")
    return EngineRun(
        engine=engine,
        time=states["time"],
        position=states["position"],
        velocity=states["velocity"],
        spin=spin,
        energy=_same_energy(path, model, states),
        scene=scene,
    )


def _require_order(path: Path, time: np.ndarray) -> None:
    """Raise ValueError unless outputs follow each other, and none is missing."""
    between = np.diff(time)
    typical = np.median(between) if between.size else 0.0
    wrong = (between <= 0) | (between > _MISSING * typical)
    if wrong.any():
        k = int(np.argmax(wrong))
        raise ValueError(
            f"{path} must have all outputs in order, but has {time[k + 1]:.6g} s after "
            f"{time[k]:.6g} s."
        )


def _require_end(path: Path, time: np.ndarray, duration: float) -> None:
    """Raise ValueError unless the last output is that at `duration`."""
    spacing = duration / max(len(time) - 1, 1)
    if abs(time[-1] - duration) > min(_LATE[0] * spacing, _LATE[1] * duration):
        raise ValueError(
            f"{path} must have the states until `duration`, {duration:.6g} s, but ends at "
            f"{time[-1]:.6g} s."
        )


def _require_start(path: Path, model: SceneModel, states: dict[str, np.ndarray]) -> None:
    """Raise ValueError unless the first output is the start of the scene."""
    if states["time"][0] != 0:
        raise ValueError(f"{path} must begin at 0 s, but begins at {states['time'][0]:.6g} s.")
    axes, free = model.dimensions, np.isfinite(model.mass)
    position, velocity = model.position[:, :axes], model.velocity[:, :axes]
    size = float(model.radius.max())
    # A fixed sphere may have the speed of its motion.
    compared = [("position", "m", position, size, np.ones_like(free))]
    compared.append(("velocity", "m/s", velocity, 0.0, free))
    if "spin" in states:
        spin = model.spin if axes == 3 else model.spin[:, 2]
        compared.append(("spin", "rad/s", spin, 0.0, free))
    for name, unit, own, least, rows in compared:
        found = states[name][0]
        within = _SAME * max(float(np.abs(own).max()), least)
        other = np.abs(found - own).reshape(len(own), -1).max(axis=1) > within
        if (other & rows).any():
            k = int(np.flatnonzero(other & rows)[0])
            raise ValueError(
                f"{path} must be the output for `scene`, where the {name} of "
                f"{words(model.scene.bodies, int(model.body[k]))} is {own[k]} {unit} at the start, "
                f"but has {found[k]} {unit}."
            )


def _same_energy(path: Path, model: SceneModel, states: dict[str, np.ndarray]) -> np.ndarray:
    """Return the kinetic and gravitational energy (T,) in J of spheres that are not fixed.

    Raises ValueError if the engine has written others.
    """
    free = np.isfinite(model.mass)
    mass, gravity = model.mass[free], model.gravity[: model.dimensions]
    kinetic = np.sum(states["velocity"][:, free] ** 2, axis=-1) @ mass / 2
    height = -(states["position"][:, free] @ gravity)
    if "spin" in states:
        turning = states["spin"][:, free].reshape(len(kinetic), len(mass), -1)
        kinetic += np.sum(turning**2, axis=-1) @ model.inertia[free] / 2
    energy = kinetic + height @ mass
    apart = np.abs(energy - states["energy"])
    row = int(np.argmax(apart))
    if apart[row] > _SAME * float(np.max(kinetic + np.abs(height) @ mass)):
        raise ValueError(
            f"{path} must be the output for `scene`, whose masses, inertia and gravity make an "
            f"energy of {energy[row]:.6g} J at {states['time'][row]:.6g} s, but has "
            f"{states['energy'][row]:.6g} J."
        )
    return energy
