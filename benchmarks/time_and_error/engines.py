"""Engines: the wanted rebound, by each one's own contact, and its cost."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import jaxcontact as jc

from . import by_simulators
from .measure import NotPossibleError, Solve, Way
from .rebounds import MASS, SPEED, STIFFNESS, Rebound, converged, drops
from .running import Store, named, run_cases, sweep

BALLS = (5, 500)
"""In one call: one of each e, and a hundred."""
STEPS = (10, 30, 100, 300, 1000)
ACCURACIES = (1e-2, 1e-4, 1e-6, 1e-8)
TASKS = (Rebound(False), Rebound(True))


def needs(library: str) -> None:
    try:
        version(library)
    except PackageNotFoundError:
        raise NotPossibleError(f"{library} is not installed") from None


def _thrown(
    task: Rebound,
    asked: np.ndarray,
    *,
    engine: str,
    build: Callable[..., Any],
    library: str,
    **how: Any,
) -> Solve:
    needs(library)
    law = np.array([converged(engine, float(e), task.exported) for e in asked])
    own = {"engine": engine} if build is by_simulators.solver else {}
    run = build(drops(engine, asked, task.exported), **own, **how)
    return lambda setting: (run(setting), law)


def _ours(task: Rebound, asked: np.ndarray, *, method: Callable[[float], Any]) -> Solve:
    """`jc.impact` with the law that delivers the e it is given."""
    contact = jc.Contact(MASS, STIFFNESS)

    def solve(e: jax.Array, setting: float) -> jax.Array:
        return jc.impact(
            jc.ExactRestitution(e=e), contact, SPEED, method=method(setting)
        ).restitution

    run = jax.jit(solve, static_argnums=1)
    e = jnp.asarray(asked)
    return lambda setting: (run(e, setting), asked)


_FILES = ("engines.py", "rebounds.py", "by_simulators.py")
_FILES += ("../../tests/engines/test_export/drops.py",)


def _way(name: str, engine: str, build: Callable[..., Any], library: str, **rest: Any) -> Way:
    thrown = functools.partial(_thrown, engine=engine, build=build, library=library)
    return Way(name, "engines", thrown, files=_FILES, **rest)


def _named(option: str, *values: str) -> dict[str, dict[str, Any]]:
    return {value: {option: value} for value in values}


_FIXED: dict[str, Any] = {"settings": STEPS, "word": "steps a contact"}
WAYS = (
    Way(
        "ExactRestitution, exact",
        "ours",
        functools.partial(_ours, method=lambda _: "exact"),
        settings=(0.0,),
        word="",
        files=_FILES,
    ),
    Way(
        "ExactRestitution, event",
        "ours",
        functools.partial(_ours, method=lambda rtol: jc.Event(rtol=rtol)),
        settings=(1e-6, 1e-9),
        files=_FILES,
    ),
    _way(
        "Exudyn, explicit", "exudyn", by_simulators.solver, "exudyn",
        variants=_named("scheme", "RK44", "VelocityVerlet", "ExplicitMidpoint", "DOPRI5"),
        most=5, **_FIXED,
    ),
    _way(
        "Exudyn, implicit", "exudyn", by_simulators.solver, "exudyn",
        variants=_named("scheme", "TrapezoidalIndex2", "GeneralizedAlpha"), most=5, **_FIXED,
    ),
    _way(
        "Drake, discrete", "drake", by_simulators.solver, "drake",
        variants=_named("approximation", "lagged", "similar"), most=5, **_FIXED,
    ),
    _way(
        "Drake, continuous, explicit", "drake", by_simulators.solver, "drake",
        variants=_named("scheme", "runge_kutta3", "runge_kutta5", "bogacki_shampine3"),
        most=5, settings=ACCURACIES, word="accuracy",
    ),
    _way(
        "Drake, continuous, implicit", "drake", by_simulators.solver, "drake",
        variants=_named("scheme", "radau3", "implicit_euler"),
        most=5, settings=ACCURACIES[:3], word="accuracy",
    ),
    _way(
        "MuJoCo", "mujoco", by_simulators.solver, "mujoco",
        variants=_named("integrator", "Euler", "implicitfast", "RK4"), most=5, **_FIXED,
    ),
    _way(
        "MJX", "mujoco", by_simulators.by_mjx, "mujoco-mjx",
        variants=_named("integrator", "Euler", "RK4"), most=500, **_FIXED,
    ),
    _way(
        "JaxSim", "jaxsim", by_simulators.by_jaxsim, "jaxsim",
        variants=_named("integrator", "RungeKutta4", "SemiImplicitEuler"), most=500, **_FIXED,
    ),
)  # fmt: skip
SMALL = ("ExactRestitution, exact", "Exudyn, explicit", "MuJoCo")


def run(store: Store, only: str = "", small: bool = False) -> None:
    """Measure what the store lacks, options first."""
    ways = named(WAYS, only, SMALL if small else None, slice(1))
    if not small:
        sweep(store, "engine options", TASKS[-1], ways, BALLS[0])
    balls = BALLS[:1] if small else BALLS
    cases = [(task, way, balls) for way, task in itertools.product(ways, TASKS)]
    run_cases(store, "engines", cases, "engine options")
