"""Engines for whole scenes: their interface, and the parts of their scripts."""

from __future__ import annotations

import abc
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np
from jaxtyping import Float

from ... import DMT, JKR, AbstractFriction, AbstractLaw, Scene
from ...extend import rendered, require_choice, states_in_csv, words
from ..engine import Engine, engine_of, engines
from ..result import Export
from .model import SceneModel, Touch


class EqualSteps(NamedTuple):
    """Equal time steps: `length` in s, `between` two outputs, and the number of `outputs` after
    that at time zero.
    """

    length: float
    between: int
    outputs: int


class SceneEngine(Engine):
    """An engine that runs whole scenes.

    A contact has the parameters of its `draft`. `output` is the file that a run writes,
    `command` runs the model. `merges`: whether one set of parameters serves spheres of any size, if
    e and the material allow. `constant`: whether its e does not depend on speed. `adhesive` has the
    laws with adhesion that the engine has itself.
    """

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


def scene_engine(name: str) -> SceneEngine:
    """Return the registered engine of this name. Raises ValueError if there is none."""
    return scene_engines()[require_choice("engine", name, list(scene_engines()))]


def scene_engines() -> dict[str, SceneEngine]:
    """Return all registered engines that run whole scenes, by name."""
    return {x.name: x for x in map(engine_of, engines()) if isinstance(x, SceneEngine)}


def refuse_adhesion(model: SceneModel, engine: SceneEngine) -> None:
    """Raise ValueError if a law pulls in another way than the engine, or beside friction."""
    for law in model.scene.law.values:
        pulls = law.ends_apart or law.forgets or isinstance(law, DMT | JKR)
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


_RECORD = '''
class Table:
    """Collect states and write them with the columns of `Run.to_csv`."""

    def __init__(self):
        self.rows = []

    def add(self, time, position, velocity, spin=None):
        """Add a state; rows of N spheres, of which the first axes are written."""
        x = numpy.reshape(position, (len(MASS), -1))[:, :AXES]
        v = numpy.reshape(velocity, (len(MASS), -1))[:, :AXES]
        free = numpy.isfinite(MASS)
        energy = (numpy.sum(v**2, axis=1) / 2 - x @ GRAVITY)[free] @ MASS[free]
        row = [time, energy, *x.ravel(), *v.ravel()]
        if SPINS:
            w = numpy.reshape(spin, (len(MASS), -1))
            row[1] += numpy.sum(w**2, axis=1)[free] @ INERTIA[free] / 2
            row += [*w.ravel()]
        self.rows.append(row)

    def write(self, file="run.csv"):
        """Write the table."""
        places = [f"[{k},{d}]" for k in range(len(MASS)) for d in range(AXES)]
        heads = ["time", "energy", *("position" + p for p in places)]
        heads += ["velocity" + p for p in places]
        if SPINS:
            turns = range(3) if AXES == 3 else [None]
            for k in range(len(MASS)):
                heads += [f"spin[{k}]" if d is None else f"spin[{k},{d}]" for d in turns]
        with open(file, "w", newline="") as out:
            writer = csv.writer(out, lineterminator="\\n")
            writer.writerow(heads)
            writer.writerows([[repr(float(x)) for x in row] for row in self.rows])
'''


def script(
    title: str,
    imports: Sequence[str],
    numbers: dict[str, Any],
    body: str,
    model: SceneModel,
    steps: EqualSteps,
) -> str:
    """Return a script: imports, numbers in SI units as constants, `Table`, and the body.

    Arrays become NumPy arrays. Every script has `STEP` in s, `BETWEEN`, `OUTPUTS` and those of
    `Table`.
    """
    own = {
        "STEP": steps.length,
        "BETWEEN": steps.between,
        "OUTPUTS": steps.outputs,
        "AXES": model.dimensions,
        "SPINS": model.scene.friction is not None,
        "GRAVITY": model.gravity[: model.dimensions],
        "MASS": model.mass,
        "INERTIA": model.inertia,
        **numbers,
    }
    lines = [f'"""{title}"""', "", "import csv", "", "import numpy", *imports, ""]
    lines += [f"{name} = {_literal(value)}" for name, value in own.items()]
    return "\n".join(lines) + "\n\n" + _RECORD + "\n\n" + body.strip() + "\n"


def _literal(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"numpy.array({_literal(value.tolist())})".replace("inf", "numpy.inf")
    return repr(value)
