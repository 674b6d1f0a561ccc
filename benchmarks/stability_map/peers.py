"""The alternatives of users on a coarse grid: solve_ivp with an event, plain diffrax, Exudyn and
MuJoCo.

All of them solve the scaled problem with m = K = v0 = 1, which favours them, because units cause no
difficulty there.

The sphere of an engine is thrown at the ground at exactly the speed 1 of the scaled problem, and
the push is its weight. The step is a fraction of the shortest of three durations: of this contact,
of it without its push, and of it without damping as well. The reading favours the engines: the end
of a contact is interpolated in its last step. A run of more than `MOST_STEPS` counts as failed.
Exudyn's connector pulls if its damping requires it, so its truth is the law with tension. Missing
engines are left out.
"""

from __future__ import annotations

import functools
import importlib
import itertools
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from scipy.integrate import solve_ivp

from .collocation import Array
from .kinds import KINDS, SEPARATED, SETTLED, Truth
from .motion_oracle import solve

MOST_STEPS = 100_000
INSTALL = "pip install '.[engines]'"
WATCHED = 8
"""Shortest durations after which a contact that should settle, and has not ended, has settled."""
MISSED = (math.nan, math.nan)
SETTLED_HERE = (0.0, math.inf)


@dataclass(frozen=True)
class Way:
    """An engine with its settings; `steps` are those in the shortest duration."""

    engine: str
    kind: str
    exponent: float
    steps: int
    settings: tuple[object, ...]


# Exudyn: 50 steps, with which the export's drops are within .2 %, and its default settings. MuJoCo:
# a tenth of a time constant per step, as in its defaults (.002 s and .02 s), with its default
# impedance of .9 at touch. In a contact it lets 1 - impedance of the push through. Its best setting
# therefore has the smallest impedance that it accepts, its integrator of fourth order, and no
# tolerance. The tolerance would end its solver early where forces are small; ten iterations suffice
# for one contact.
WAYS = {
    "hunt_crossley_tension/Exudyn implicit": Way(
        "exudyn", "hunt_crossley_tension", 1.5, 50, ("GeneralizedAlpha",)
    ),
    "hunt_crossley_tension/Exudyn implicit, step : 100": Way(
        "exudyn", "hunt_crossley_tension", 1.5, 5000, ("GeneralizedAlpha",)
    ),
    "hunt_crossley_tension/Exudyn RK44": Way("exudyn", "hunt_crossley_tension", 1.5, 50, ("RK44",)),
    "hunt_crossley_tension/Exudyn RK44, step : 100": Way(
        "exudyn", "hunt_crossley_tension", 1.5, 5000, ("RK44",)
    ),
    "oscillator_clamped/MuJoCo": Way(
        "mujoco", "oscillator_clamped", 1.0, 31, ("Euler", 0.9, 1e-8, 100)
    ),
    "oscillator_clamped/MuJoCo, step : 100": Way(
        "mujoco", "oscillator_clamped", 1.0, 3100, ("Euler", 0.9, 1e-8, 100)
    ),
    "oscillator_clamped/MuJoCo, finest": Way(
        "mujoco", "oscillator_clamped", 1.0, 3100, ("RK4", 1e-4, 0, 10)
    ),
}


def missing(engine: str) -> bool:
    try:
        importlib.import_module(engine)
    except ImportError:
        return True
    return False


def truth_for(way: Way, damping: Array, push: Array) -> Truth:
    return solve(KINDS[way.kind].problem(damping, np.full(damping.size, way.exponent), push))


def by_engine(way: Way, damping: Array, push: Array, truth: Truth) -> tuple[Array, Array]:
    """e and duration over the grid: NaN where it failed, 0 and infinity where it settled."""
    free = truth_for(way, damping, np.zeros_like(damping)).duration
    undamped = truth_for(way, np.zeros(1), np.zeros(1)).duration[0]
    throw = _THROW[way.engine]
    found = []
    for d, g, end, depth, alone, status in zip(
        damping, push, truth.duration, truth.max_indentation, free, truth.status, strict=True
    ):
        step = float(min(end, alone, undamped)) / way.steps
        ends = status == SEPARATED
        # Half as long again: a contact that has not ended by then is wrong in any case.
        count = math.ceil(1.5 * float(end) / step) + 2 if ends else WATCHED * way.steps
        if count > MOST_STEPS:
            found.append(MISSED)
        else:
            found.append(throw(way, float(d), float(g), step, count, float(depth)))
    return tuple(np.array(found, float).T)


def _exudyn(
    way: Way, alpha: float, push: float, step: float, count: int, depth: float
) -> tuple[float, float]:
    import exudyn as engine
    from exudyn.utilities import (
        MarkerBodyPosition,
        MarkerBodyRigid,
        NodeGenericData,
        ObjectContactSphereSphere,
        SensorBody,
    )

    # It must start apart, because it stores the speed at touch, and so near that the push adds
    # nothing. Its radius is that of the ground, and their centres must not meet.
    radius = 1 + depth
    gap = 1e-6 * step / (1 + abs(push) * step)
    system = engine.SystemContainer().AddSystem()
    ground = system.CreateGround()
    ball = system.CreateMassPoint(
        referencePosition=[0, 0, 2 * radius + gap],
        initialVelocity=[0, 0, -math.sqrt(1 - 2 * push * gap)],
        mass=1,
        gravity=[0, 0, -push],
    )
    memory = NodeGenericData(initialCoordinates=[gap, 0, 0, 0], numberOfDataCoordinates=4)
    system.AddObject(
        ObjectContactSphereSphere(
            markerNumbers=[
                system.AddMarker(MarkerBodyRigid(bodyNumber=ground)),
                system.AddMarker(MarkerBodyPosition(bodyNumber=ball)),
            ],
            nodeNumber=system.AddNode(memory),
            spheresRadii=[radius, radius],
            contactStiffness=1,
            contactStiffnessExponent=way.exponent,
            contactDamping=0,
            impactModel=2,
            restitutionCoefficient=_coefficient(alpha),
        )
    )
    kinds = engine.OutputVariableType
    sensors = [
        system.AddSensor(
            SensorBody(bodyNumber=ball, storeInternal=True, writeToFile=False, outputVariableType=k)
        )
        for k in (kinds.Position, kinds.Velocity)
    ]
    system.Assemble()
    settings = engine.SimulationSettings()
    settings.timeIntegration.endTime = count * step
    settings.timeIntegration.numberOfSteps = count
    # It shortens a step to end at touch; its own shortest step is 1e-8 s.
    settings.timeIntegration.minimumStepSize = 1e-9 * step
    settings.timeIntegration.verboseMode = 0
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = 1e-9 * step
    try:
        system.SolveDynamic(settings, solverType=getattr(engine.DynamicSolverType, way.settings[0]))
    except (engine.SolverError, engine.ExudynArithmeticError):
        # It gives up. An error of this set-up is not an outcome of the engine.
        return MISSED
    (time, _, _, height), (_, _, _, velocity) = (system.GetSensorStoredData(s).T for s in sensors)
    if not (np.isfinite(height).all() and np.isfinite(velocity).all()):
        return MISSED
    inner = 2 * radius - height
    inside = inner > 0
    over = np.flatnonzero(inside[:-1] & ~inside[1:])
    if over.size == 0:
        return SETTLED_HERE
    k = over[0]
    part = inner[k] / (inner[k] - inner[k + 1])
    e = velocity[k] + part * (velocity[k + 1] - velocity[k])
    return e, time[k] + part * (time[k + 1] - time[k]) - gap


def _coefficient(alpha: float) -> float:
    """The restitutionCoefficient with which impactModel 2 has this α.

    Its α is that of Carvalho and Martins above e = 1/3, where 3(1-e)(11-e) = 2α(1+9e), and of
    Gonthier et al. below, where 1 - e² = αe.
    """
    if alpha < 8 / 3:
        half, constant = 6 + 3 * alpha, 11 - 2 * alpha / 3
        return constant / (half + math.sqrt(half**2 - constant))
    return 2 / (alpha + math.sqrt(alpha**2 + 4))


def _mujoco(
    way: Way, zeta: float, push: float, step: float, count: int, depth: float
) -> tuple[float, float]:
    import mujoco as engine
    from mujoco import rollout

    integrator, impedance, tolerance, iterations = way.settings
    contact = (
        f'solref="-1 {-2 * zeta if zeta else -1e-300}" '
        f'solimp="{impedance} {impedance} 0.001 0.5 2" condim="1"'
    )
    # In touch from the start; otherwise it would be up to a step late.
    model = engine.MjModel.from_xml_string(f"""<mujoco>
      <option timestep="{step}" gravity="0 0 {-push}" integrator="{integrator}"
        tolerance="{tolerance}" iterations="{iterations}"/>
      <worldbody><geom type="plane" size="9 9 1" {contact}/>
        <body pos="0 0 {1 - 1e-12}"><joint type="slide" axis="0 0 1"/>
          <geom type="sphere" size="1" mass="1" {contact}/><site name="ball" size="{2 + depth}"/>
        </body>
      </worldbody><sensor><touch site="ball"/></sensor></mujoco>""")
    data = engine.MjData(model)
    data.qvel[0] = -1
    start = np.zeros(engine.mj_stateSize(model, engine.mjtState.mjSTATE_FULLPHYSICS))
    engine.mj_getState(model, data, start, engine.mjtState.mjSTATE_FULLPHYSICS)
    states, force = rollout.rollout(model, data, start[None], nstep=count)
    velocity, force = states[0, :, 2], force[0, :, 0]
    if not np.isfinite(velocity).all() or data.warning.number.any():
        return MISSED
    # A step reports the force at its beginning. The contact ends in the last step with a force,
    # where the line through its last two forces reaches zero.
    over = np.flatnonzero(force[1:] <= 0)
    if over.size == 0:
        return SETTLED_HERE
    k = over[0]
    falls = force[k - 1] - force[k] if k else 0.0
    part = min(1.0, force[k] / falls) if falls > 0 else 1.0
    before = velocity[k - 1] if k else -1.0
    return before + part * (velocity[k] - before), (k + part) * step


_THROW: dict[str, Callable[[Way, float, float, float, int, float], tuple[float, float]]] = {
    "exudyn": _exudyn,
    "mujoco": _mujoco,
}


EXPONENT = 1.5
DAMPINGS = np.array([0.0, *10.0 ** np.arange(-4.0, 6.5)])
PUSHES = np.array([-1e4, -1e2, -1.0, -1e-2, -1e-4, 0.0, 1e-4, 1e-2, 1.0, 1e2, 1e4])
LONGEST = 1e9
"""Scaled time after which a contact that has not ended counts as one that stays."""
MOST_CALLS = 8_000
"""Evaluations of the force after which a solve counts as failed: a hundred times the usual."""
# Its default tolerances, and the finest that it accepts.
SCIPY = {
    "scipy LSODA, default": ("LSODA", 1e-3, 1e-6),
    "scipy LSODA, finest": ("LSODA", 1e-12, 1e-14),
    "scipy DOP853, default": ("DOP853", 1e-3, 1e-6),
    "scipy DOP853, finest": ("DOP853", 1e-13, 1e-15),
}
DIFFRAX = {"diffrax Tsit5, 1e-6": 1e-6, "diffrax Tsit5, 1e-10": 1e-10}
KINDS_ASKED = ("hunt_crossley", "kuwabara_kono")


class TooManyCallsError(RuntimeError):
    """The solve goes nowhere."""


def _force(kind: str) -> Callable[..., Any]:
    n = EXPONENT
    if kind == "hunt_crossley":
        return lambda x, v, c, m: x**n * m.maximum(0.0, 1 + c * v)
    return lambda x, v, c, m: x ** (n - 1) * (x + n * c * v)


def _gap(kind: str, x: Any, v: Any, c: Any, m: Any) -> Any:
    """What vanishes where the contact is over: x, or a force that may not pull."""
    if kind != "hunt_crossley":
        return x
    return m.minimum(x, m.where(v < 0, 1 + c * v, 1.0))


def _grid() -> tuple[Array, Array]:
    damping, push = np.meshgrid(DAMPINGS, PUSHES, indexing="ij")
    return damping.ravel(), push.ravel()


def by_scipy(kind: str, way: str) -> tuple[Array, Array]:
    """e and duration over the grid; NaN where the solve failed.

    The time is infinite where the contact did not end.
    """
    method, rtol, atol = SCIPY[way]
    force = _force(kind)
    found = []
    for damping, push in zip(*_grid(), strict=True):
        calls = itertools.count()

        def rate(t, y, damping=damping, push=push, calls=calls):
            if next(calls) > MOST_CALLS:
                raise TooManyCallsError
            return y[1], push - force(max(y[0], 0.0), y[1], damping, np)

        def apart(t, y, damping=damping):
            return _gap(kind, y[0], y[1], damping, np)

        apart.terminal, apart.direction = True, -1
        try:
            with np.errstate(all="ignore"):
                end = solve_ivp(
                    rate, (0, LONGEST), (0, 1), method, events=apart, rtol=rtol, atol=atol
                )
        except (TooManyCallsError, ValueError):
            found.append((np.nan, np.nan))
            continue
        if end.status == 1:
            found.append((-end.y_events[0][0, 1], end.t_events[0][0]))
        else:
            found.append((0.0, np.inf) if end.status == 0 else (np.nan, np.nan))
    return tuple(np.array(found).T)


def by_diffrax(kind: str, way: str) -> tuple[Array, Array]:
    """The same by a vmapped solve in indentation and velocity."""
    force, tolerance = _force(kind), DIFFRAX[way]

    def one(damping, push):
        def rate(t, y, args):
            # A power has no slope at 0, hence the usual guard.
            x = jnp.where(y[0] > 0, y[0], 1.0)
            pull = jnp.where(y[0] > 0, force(x, y[1], damping, jnp), 0.0)
            return jnp.stack([y[1], push - pull])

        return diffrax.diffeqsolve(
            diffrax.ODETerm(rate),
            diffrax.Tsit5(),
            0.0,
            LONGEST,
            1e-3,
            jnp.array([0.0, 1.0]),
            stepsize_controller=diffrax.PIDController(rtol=tolerance, atol=tolerance),
            event=diffrax.Event(
                lambda t, y, args, **_: _gap(kind, y[0], y[1], damping, jnp),
                optx.Newton(1e-10, 1e-10),
                direction=False,
            ),
            max_steps=16_384,
            throw=False,
        )

    solution = jax.jit(jax.vmap(one))(*map(jnp.asarray, _grid()))
    met = np.asarray(solution.result == diffrax.RESULTS.event_occurred)
    done = np.asarray(solution.result == diffrax.RESULTS.successful)
    e = np.where(met, -np.asarray(solution.ys[:, -1, 1]), np.where(done, 0.0, np.nan))
    duration = np.where(met, np.asarray(solution.ts[:, -1]), np.where(done, np.inf, np.nan))
    return e, duration


def run_all(known: dict[str, Any], only: str = "") -> dict[str, Any]:
    """`known` with the ways whose name contains `only` run again.

    Of every kind and way: error decades (rows: damping, columns: push) and counts.
    """
    damping, push = _grid()
    truths: dict[tuple[str, float], Truth] = {}

    def truth_of(kind: str, n: float) -> Truth:
        if (kind, n) not in truths:
            problem = KINDS[kind].problem(damping, np.full(damping.size, n), push)
            truths[kind, n] = solve(problem)
        return truths[kind, n]

    found = dict(known)

    def add(name: str, truth: Truth, solver: Callable[[], tuple[Array, Array]]) -> None:
        start = time.perf_counter()
        found[name] = _compared(*solver(), truth)
        print(name, found[name]["counts"], f"{time.perf_counter() - start:.0f} s", flush=True)

    ways = dict.fromkeys(SCIPY, by_scipy) | dict.fromkeys(DIFFRAX, by_diffrax)
    for kind, (way, solver) in itertools.product(KINDS_ASKED, ways.items()):
        if _asked(f"{kind}/{way}", only):
            of_way = functools.partial(solver, kind, way)
            add(f"{kind}/{way}", truth_of(kind, EXPONENT), of_way)
    asked = {name: way for name, way in WAYS.items() if _asked(name, only)}
    lacking = sorted({way.engine for way in asked.values() if missing(way.engine)})
    if lacking:
        print(f"left out: {', '.join(lacking)} cannot be imported; {INSTALL}", flush=True)
    for name, way in asked.items():
        if way.engine not in lacking:
            truth = truth_of(way.kind, way.exponent)
            add(name, truth, functools.partial(by_engine, way, damping, push, truth))
    # In the order of the methods, independent of their run.
    order = [f"{kind}/{way}" for kind in KINDS_ASKED for way in ways] + list(WAYS)
    return {name: found[name] for name in order if name in found}


def _asked(name: str, only: str) -> bool:
    return only.lower() in name.lower()


def _compared(e: Array, duration: Array, truth: Truth) -> dict[str, Any]:
    failed = np.isnan(e)
    settles = truth.status == SETTLED
    with np.errstate(all="ignore"):
        error = np.maximum(
            np.abs(e - truth.e) / np.maximum(truth.e, 1e-6), np.abs(duration / truth.duration - 1)
        ).astype(float)
    error = np.where(settles, np.where(np.isinf(duration), 0, 1), error)
    error = np.where(np.isfinite(error), error, 1)
    decade = np.where(failed, -99, np.ceil(np.log10(np.clip(error, 1e-16, 1)))).astype(int)
    shape = (DAMPINGS.size, PUSHES.size)
    counts = {"failed": int(failed.sum())}
    for bound in (1e-8, 1e-3):
        counts[f"within {bound:g}"] = int((~failed & (error <= bound)).sum())
    counts["wrong by more than 1e-3"] = int((~failed & (error > 1e-3)).sum())
    return {
        "counts": counts,
        "decade": decade.reshape(shape).tolist(),
        "flags": failed.astype(int).reshape(shape).tolist(),
        "total": np.ones(shape, int).tolist(),
    }
