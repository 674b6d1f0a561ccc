"""Scenes: the package; SciPy, diffrax and numba from event to event; and billiards."""

from __future__ import annotations

import dataclasses
import functools
import itertools
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import jaxcontact as jc

from . import gases
from . import hard_scenes as hard
from .line_scenes import Fixed, Line, by_diffrax, by_scipy, chain, line, oblique, scene_of
from .measure import NotPossibleError, Solve, Way
from .running import Store, run_cases

REFERENCE = 2.3e-14
"""The tolerance of references by SciPy, the least that it takes."""
LADDER = (1e-6, 1e-8, 1e-10, 1e-12)


@dataclass(frozen=True)
class Scene:
    """`solvers`: by family what answers to a setting; `truth`: what it should be.

    Errors are relative to the largest number of the truth, or of the start.
    """

    name: str
    title: str
    solvers: dict[str, Callable[[float], Any]]
    truth: Callable[[], Any]
    scale: float = 0.0
    once: tuple[str, ...] = field(default=())
    """Solvers whose answer depends on no setting."""
    whole: bool = True

    def lanes(self, count: int) -> np.ndarray:
        return np.zeros(1)

    def errors(self, lanes: np.ndarray, answer: Any) -> dict[str, float]:
        truth = np.asarray(self.truth())
        scale = self.scale or np.max(np.abs(truth))
        return {"error_state": float(np.max(np.abs(np.asarray(answer) - truth)) / scale)}


_BILLIARDS = "billiards is of discs in a plane, elastic, between walls, without gravity"


def _soft(name: str, title: str, made: Line) -> Scene:
    """Spheres in contact that take time: final velocities."""
    fixed = Fixed(made)
    how: dict[str, Any] = {"v0": "touch", "max_cluster": len(made.mass)}

    @functools.partial(jax.jit, static_argnums=1)
    def ours(velocity: jax.Array, rtol: float) -> jax.Array:
        scene = scene_of(made, velocity)
        run = jc.simulate(scene, made.duration, rtol=rtol, max_impacts=ROOM, **how)
        return run.velocity[-1].ravel()

    def plain(rtol: float) -> np.ndarray:
        run = jc.simulate(scene_of(made), made.duration, rtol=rtol, throw=False, **how)
        return np.asarray(run.velocity[-1]).ravel()

    return Scene(
        name,
        title,
        {
            "jitted": lambda rtol: ours(jnp.asarray(made.velocity), rtol),
            "python": plain,
            "diffrax": functools.partial(by_diffrax, fixed, made.longest),
            "scipy": functools.partial(by_scipy, made),
        },
        functools.cache(lambda: by_scipy(made, REFERENCE)),
        float(np.max(np.abs(made.velocity))),
    )


def _gas(name: str, title: str, periodic: bool) -> Scene:
    """Hard discs from impact to impact: final velocities."""
    solvers = {
        "jitted": functools.partial(gases.by_package, periodic),
        "numba": functools.partial(gases.by_numba, periodic),
        **({} if periodic else {"billiards": gases.by_billiards}),
    }
    once = ("jitted", "numba", "billiards")
    truth = functools.partial(gases.truth, periodic)
    return Scene(name, title, solvers, truth, once=once)


ROOM = 48
SCENES = (
    _soft("line", "five unequal balls in a line, apart", line(0.1, 1e9, 15.0)),
    _soft("near", "the same, gaps of 1e-5 m", line(1e-5, 1e9, 0.02)),
    _soft("chain", "ten touching balls", chain(10)),
    *(
        _soft(f"oblique {slowness:g}", f"oblique pair, ε = {slowness:g}", oblique(slowness))
        for slowness in (1e-3, 4e-3, 2e-2)
    ),
    Scene(
        "rest",
        "bouncing to rest",
        {
            "jitted": hard.rest_by_package,
            "diffrax": hard.rest_by_diffrax,
            "scipy": hard.rest_by_scipy,
            "numba": hard.rest_by_numba,
        },
        hard.rest_truth,
    ),
    Scene(
        "table",
        "ball on a shaking table",
        {
            "jitted": hard.table_by_package,
            "diffrax": hard.table_by_diffrax,
            "scipy": hard.table_by_scipy,
            "numba": hard.table_by_numba,
        },
        hard.table_truth,
        once=("jitted", "numba"),
    ),
    *(_gas(*named) for named in (
        ("gas", "gas of 32 balls, periodic", True), ("boxed", "gas of 32 balls in a box", False),
    )),
)  # fmt: skip


def _build(scene: Scene, lanes: np.ndarray, *, solver: str) -> Solve:
    if solver not in scene.solvers:
        otherwise = _BILLIARDS if solver == "billiards" else "nobody wrote it for this scene"
        raise NotPossibleError(otherwise)
    return scene.solvers[solver]


_FILES = ("scenes.py", "line_scenes.py", "hard_scenes.py", "gases.py")
_FILES += ("../until_event.py",)


def _way(name: str, family: str, solver: str, settings: tuple[float, ...], **rest: Any) -> Way:
    build = functools.partial(_build, solver=solver)
    return Way(name, family, build, settings=settings, files=_FILES, **rest)


WAYS = {
    "jitted": _way("jaxcontact, jitted", "ours", "jitted", (1e-9,)),
    "python": _way("jaxcontact, from Python", "ours", "python", (1e-9,)),
    "diffrax": _way("diffrax Dopri8, restarted", "diffrax", "diffrax", LADDER),
    "scipy": _way("scipy DOP853, restarted", "scipy", "scipy", LADDER, compiled=False),
    "numba": _way("numba, by hand", "numba", "numba", LADDER, needs="numba"),
    "billiards": _way("billiards", "engines", "billiards", (0.0,), word="", compiled=False),
}
SMALL = (("rest", "scipy"), ("table", "numba"))


def run(store: Store, only: str = "", small: bool = False) -> None:
    """Measure what the store lacks."""
    cases = []
    for scene, (solver, way) in itertools.product(SCENES, WAYS.items()):
        if only.lower() not in way.name.lower() or (small and (scene.name, solver) not in SMALL):
            continue
        if solver in scene.once or solver not in scene.solvers:
            way = dataclasses.replace(way, settings=(0.0,), word="")
        elif small:
            way = dataclasses.replace(way, settings=way.settings[-1:])
        cases.append((scene, way, (1,)))
    run_cases(store, "scenes", cases)
