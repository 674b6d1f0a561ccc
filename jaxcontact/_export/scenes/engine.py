"""The interface of an engine for whole scenes, and the register of engines."""

from __future__ import annotations

import abc
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, TypeVar

import numpy as np
from jaxtyping import Float

from ..._entry import rendered, require_choice
from ..._friction import AbstractFriction
from ..._laws import AbstractLaw
from ..._laws.surface_adhesion import AbstractAdhesive
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
    e and the material allow. `constant`: whether its e does not depend on speed. `adhesive` has the
    laws with adhesion that the engine has itself.
    """

    name: ClassVar[str]
    output: ClassVar[str] = "run.csv"
    command: ClassVar[str] = "python run.py"
    merges: ClassVar[bool] = False
    constant: ClassVar[bool] = True
    adhesive: ClassVar[tuple[type[AbstractLaw], ...]] = ()

    @abc.abstractmethod
    def refuse(self, model: SceneModel) -> None:
        """Raise ValueError that names what of a scene the engine cannot express."""

    def options(self, touch: Touch, constant: bool) -> Iterable[Mapping[str, Any]]:
        """Return options of `export` for a contact. That with the smallest error is used, the first
        of equal ones. An option that cannot deliver the law is left out if another one can.
        """
        return ({},)

    @abc.abstractmethod
    def files(
        self, model: SceneModel, exports: Mapping[tuple[int, int], Export], steps: EqualSteps
    ) -> dict[str, str]:
        """Return the texts of the files of the model by name."""

    def read(self, path: Path, scene: Scene) -> dict[str, Float[np.ndarray, "T ..."]]:
        """Return `time` and `energy` (T,), `position` and `velocity` (T, N, D), and `spin` with
        friction.

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


def refuse_adhesion(model: SceneModel, engine: SceneEngine) -> None:
    """Raise ValueError if a law pulls in another way than the engine, or beside friction."""
    for law in model.scene.law.values:
        pulls = law.ends_apart or law.forgets or isinstance(law, AbstractAdhesive)
        if pulls and not isinstance(law, engine.adhesive):
            raise ValueError(
                f"Argument `scene` must have laws without adhesion for engine {engine.name!r}, "
                f"whose contacts are matched to e alone, but has {rendered(law)}. `DMT` can be "
                "exported to 'lammps', `Luding` to 'exudyn'."
            )
        if pulls and model.scene.friction is not None:
            raise ValueError(
                "Argument `scene` must have `friction=None` beside adhesion for an engine, whose "
                f"limit of friction is another, but has {rendered(law)}."
            )


def refuse_friction(
    model: SceneModel, engine: str, kind: type[AbstractFriction], why: str = ""
) -> None:
    """Raise ValueError if a scene has friction of another kind than the engine, and `why`."""
    for friction in () if model.scene.friction is None else model.scene.friction.values:
        if not isinstance(friction, kind):
            raise ValueError(
                f"Argument `scene` must have the friction law `{kind.__name__}` for {engine}, but "
                f"has {rendered(friction)}{why}."
            )


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
