"""The public function `read_run`: the output of an engine as a run."""

from __future__ import annotations

import os

import numpy as np

from ..._entry import require_kind, require_path
from ..._scene import EngineRun, Scene
from .engine import scene_engine
from .model import SceneModel, scene_model


def read_run(file: str | os.PathLike[str], engine: str, scene: Scene) -> EngineRun:
    """Read what an engine wrote for a scene of `export_scene`: run.dump of LAMMPS, else run.csv.

    `scene` is the exported one; its masses and gravity give the energy. Returns an `EngineRun`,
    with the columns of `Run`. Raises ValueError for a file with other content or another number of
    spheres, and for an unknown engine; OSError for a file that cannot be read.
    """
    path = require_path("file", file)
    model = scene_model(require_kind("scene", scene, Scene, "a `Scene`"), merges=True)
    source = scene_engine(engine)
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
    spin = states.get("spin")
    return EngineRun(
        engine=engine,
        time=states["time"],
        position=states["position"],
        velocity=states["velocity"],
        spin=spin,
        energy=energy_of(model, states["position"], states["velocity"], spin),
        scene=scene,
    )


def energy_of(
    model: SceneModel, position: np.ndarray, velocity: np.ndarray, spin: np.ndarray | None
) -> np.ndarray:
    """Return the kinetic and gravitational energy (T,) in J of spheres that are not fixed."""
    free = np.isfinite(model.mass)
    mass, gravity = model.mass[free], model.gravity[: model.dimensions]
    squares = np.sum(velocity[:, free] ** 2, axis=-1) / 2
    energy = (squares - position[:, free] @ gravity) @ mass
    if spin is not None:
        turning = spin[:, free].reshape(len(spin), len(mass), -1)
        energy += np.sum(turning**2, axis=-1) @ model.inertia[free] / 2
    return energy
