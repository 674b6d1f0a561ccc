"""The interface of an engine for whole scenes, and the register of engines."""

from __future__ import annotations

import abc
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, TypeVar

import numpy as np
from jaxtyping import Float

from ..._entry import require_choice
from ..._scene import Scene
from ..._scene.bodies.bodies import words
from ..._scene.readout.columns import states_in_csv
from ..result import Export
from .model import SceneModel, Touch

_ENGINES: dict[str, SceneEngine] = {}

Kind = TypeVar("Kind", bound="SceneEngine")


class EqualSteps(NamedTuple):
    """Equal time steps: `length` in s, `between` two outputs, and the number of `outputs` after
    that at time zero.
    """

    length: float
    between: int
    outputs: int


class SceneEngine(abc.ABC):
    """An engine that runs whole scenes.

    `name` is that of `jc.export`, whose parameters it uses. `output` is the file that a run writes,
    `command` runs the model. `merges`: whether one set of parameters serves spheres of any size, if
    e and the material allow. `constant`: whether its e does not depend on speed.
    """

    name: ClassVar[str]
    output: ClassVar[str] = "run.csv"
    command: ClassVar[str] = "python run.py"
    merges: ClassVar[bool] = False
    constant: ClassVar[bool] = True

    @abc.abstractmethod
    def refuse(self, model: SceneModel) -> None:
        """Raise ValueError that names what of a scene the engine cannot express."""

    def options(self, touch: Touch, constant: bool) -> Iterable[Mapping[str, Any]]:
        """Return options of `export` for a contact; the one with the smallest error is used."""
        return ({},)

    @abc.abstractmethod
    def files(
        self, model: SceneModel, exports: Mapping[tuple[int, int], Export], steps: EqualSteps
    ) -> dict[str, str]:
        """Return the texts of the files of the model by name."""

    def read(self, path: Path, scene: Scene) -> dict[str, Float[np.ndarray, "T ..."]]:
        """Return `time` (T,), `position` and `velocity` (T, N, D), and `spin` with friction.

        Raises ValueError for a file with other content, OSError for one that cannot be read.
        """
        return states_in_csv(path)


def register_scene_engine(kind: type[Kind]) -> type[Kind]:
    """Register a `SceneEngine` under its `name` for `export_scene`; a decorator of its class."""
    _ENGINES[kind.name] = kind()
    return kind


def scene_engine(name: str) -> SceneEngine:
    """Return the registered engine of this name. Raises ValueError if there is none."""
    return _ENGINES[require_choice("engine", name, scene_engines())]


def scene_engines() -> list[str]:
    """Return the names of all registered engines."""
    return sorted(_ENGINES)


def spaced(values: Iterable[float]) -> str:
    """Return numbers with all their digits, as engines read them."""
    return " ".join(f"{value:.17g}" for value in values)


def refuse_all(
    model: SceneModel,
    engine: str,
    *,
    shells: bool = False,
    periodic: bool = False,
    motion: bool = False,
) -> None:
    """Raise ValueError if a scene has what the flags name: shells, periodic axes or motions."""
    bodies = model.scene.bodies
    if shells and model.round:
        raise ValueError(
            f"Argument `scene` must have spheres, planes and boxes only for {engine}, but has "
            f"{words(bodies, model.round[0].body)}."
        )
    if periodic and any(length is not None for length in model.periods):
        raise ValueError(
            f"Argument `scene` must have `periodic=None` for {engine}, but has {model.periods}."
        )
    for k, body in enumerate(bodies):
        if motion and body.motion is not None:
            raise ValueError(
                f"Argument `scene` must have fixed bodies at rest for {engine}, but "
                f"{words(bodies, k)} moves."
            )
