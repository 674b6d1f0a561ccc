"""Fits: the package, and least squares by SciPy and lmfit over solve_ivp and over numba."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from typing import Any

import numpy as np
from scipy import optimize

import jaxcontact as jc
from benchmarks.time_and_error import by_scipy
from benchmarks.time_and_error.by_numba import EIGHTH, FAST, in_parallel, kernel, step_source
from benchmarks.time_and_error.fit_tasks import MASS, SPEED, STIFFNESS, UNIT, Found, Record, Table
from benchmarks.time_and_error.measure import Solve, Way
from benchmarks.time_and_error.problems import PROBLEMS, function_of
from benchmarks.time_and_error.running import Store, named, run_cases, sweep
from benchmarks.until_event import contact

_CODE = """
def rate(x, v, p):
    x = max(x, 0.0)
    return v, -x * sqrt(x) * (1 + p * v)

{step}

def sampled(since, alpha, rtol):
    force = zeros(len(since))
    x, v, t = 0.0, 1.0, 0.0
    xk0, vk0 = rate(x, v, alpha)
    h = 0.01
    for i in range(len(since)):
        if since[i] <= 0:
            continue
        while t < since[i]:
            left = since[i] - t
            last = h >= left
            length = left if last else h
            xn, vn, xk, vk, size = step(x, v, xk0, vk0, length, rtol, rtol, alpha)
            if size <= 1:
                x, v, xk0, vk0 = xn, vn, xk, vk
                t = since[i] if last else t + length
            # A step that a sample cut short says nothing against a longer one.
            if size > 1 or not last:
                h = length * min(5.0, max(0.2, 0.9 * size ** -0.125)) if size > 0 else 5 * length
            elif size < 0.1:
                h = max(h, 2 * length)
        if x <= 0:
            break
        force[i] = x * sqrt(x) * (1 + alpha * v)
    return force
"""


@functools.cache
def sampler() -> Any:
    """`sampled(since, alpha, rtol)`: scaled force at scaled times, zero outside the contact."""
    import numba

    scope: dict[str, Any] = {"sqrt": math.sqrt, "zeros": np.zeros}
    exec(_CODE.format(step=step_source(EIGHTH, "x v", "p")), scope)
    for name in ("rate", "step", "sampled"):
        scope[name] = numba.njit(fastmath=FAST)(scope[name])
    return scope["sampled"]


START = 0.7
"""What fits start from, in parts of the truth or of what is known."""
_LAW = PROBLEMS["hunt_crossley"].acceleration


def ours_of_table(task: Table, speeds: np.ndarray) -> Solve:
    e, contact = task.data(speeds), jc.Contact(mass=MASS, stiffness=STIFFNESS)
    return lambda setting: float(jc.fit_damping(contact, speeds, e).params["c"])


def ours_of_record(task: Record, times: np.ndarray) -> Solve:
    force = task.data(times)
    law = jc.ConstantDamping(c=START * 2e7)
    contact = jc.Contact(mass=MASS, stiffness=START * STIFFNESS)

    def run(setting: float) -> Found:
        fixed = ("mass", "velocity")
        found = jc.fit_record(law, contact, times, SPEED, force=force, fixed=fixed).params
        numbers = found.law.c, found.contact.stiffness, found.start_time
        return Found(*map(float, numbers))

    return run


def table_by_scipy(alphas: np.ndarray, rtol: float) -> np.ndarray:
    acceleration = function_of(_LAW)
    return np.array([by_scipy.impact(acceleration, (a,), rtol, "DOP853")[0] for a in alphas])


def table_by_numba(alphas: np.ndarray, rtol: float) -> np.ndarray:
    run = kernel(_LAW, "p", "eighth", True, in_parallel(alphas), True)
    return run(alphas[:, None], rtol)[0]


def record_by_scipy(since: np.ndarray, alpha: float, rtol: float) -> np.ndarray:
    """Scaled force at scaled times, from SciPy's dense output."""
    inside = since > 0
    x, v = contact(
        lambda x, v: -x * math.sqrt(x) * (1 + alpha * v), rtol, stop=since[-1], t_eval=since[inside]
    ).y
    x = np.maximum(x, 0)
    force = np.zeros(since.size)
    # Readings omitted after the end have no force.
    force[np.flatnonzero(inside)[: x.size]] = x * np.sqrt(x) * (1 + alpha * v)
    return force


def record_by_numba(since: np.ndarray, alpha: float, rtol: float) -> np.ndarray:
    return sampler()(since, alpha, rtol)


TABLES = {"scipy": table_by_scipy, "numba": table_by_numba}
RECORDS = {"scipy": record_by_scipy, "numba": record_by_numba}


def _residual(task: Any, x: np.ndarray, model: Any, rtol: float) -> tuple[Any, np.ndarray, Any]:
    """Residuals of scaled unknowns, where to start, and what the unknowns mean."""
    data = task.data(x)
    if task.name == Table.name:
        typical = 2e7
        return (
            lambda p: model(p[0] * typical * x / STIFFNESS, rtol) - data,
            np.array([START]),
            lambda p: p[0] * typical,
        )
    top = np.max(data)
    touch = x[np.argmax(data > 0.05 * top)]
    # Unknown are K and c relative to a guess, the touch in units of time, and the zero relative to
    # the largest force.

    def residual(p):
        stiffness = p[0] * STIFFNESS
        length = (MASS * SPEED**2 / stiffness) ** 0.4
        since = (x - touch - p[2] * UNIT) * (SPEED / length)
        alpha = p[1] * 2e7 * SPEED / stiffness
        force = stiffness * length**1.5 * model(since, alpha, rtol)
        return force / top + p[3] - data / top

    return (
        residual,
        np.array([START, START, 0.0, 0.0]),
        lambda p: Found(p[1] * 2e7, p[0] * STIFFNESS, touch + p[2] * UNIT),
    )


_TIGHT = {"xtol": 1e-14, "ftol": 1e-14, "gtol": 1e-14}


def by_least_squares(
    task: Any, x: np.ndarray, *, model: str, method: str = "trf", jac: str = "2-point"
) -> Solve:
    models = TABLES if task.name == Table.name else RECORDS

    def run(rtol: float) -> Any:
        residual, start, meaning = _residual(task, x, models[model], rtol)
        # The tolerance must not affect differences.
        step = max(rtol, 1e-13) ** (1 / 2 if jac == "2-point" else 1 / 3)
        found = optimize.least_squares(
            residual, start, jac, method=method, diff_step=step, **_TIGHT
        )
        return meaning(found.x)

    return run


def by_lmfit(task: Any, x: np.ndarray, *, model: str) -> Solve:
    import lmfit

    models = TABLES if task.name == Table.name else RECORDS

    def run(rtol: float) -> Any:
        residual, start, meaning = _residual(task, x, models[model], rtol)
        names = [f"p{k}" for k in range(start.size)]
        unknown = lmfit.Parameters()
        for name, value in zip(names, start, strict=True):
            unknown.add(name, value=float(value))
        found = lmfit.minimize(
            lambda p: residual(np.array([p[name].value for name in names])),
            unknown,
            epsfcn=max(rtol, 1e-13),
            **_TIGHT,
        )
        return meaning([found.params[name].value for name in names])

    return run


_METHODS = {
    "trf, two points": {},
    "lm, two points": {"method": "lm"},
    "lm, three points": {"method": "lm", "jac": "3-point"},
}
_FILES = ("fits.py", "fit_tasks.py")
_OURS = {"table": ours_of_table, "record": ours_of_record}


def _ours(task: Any, x: np.ndarray) -> Solve:
    return _OURS[task.name](task, x)


_SETTINGS = {"scipy": (1e-6, 1e-8, 1e-10, 1e-12), "numba": (1e-6, 1e-8, 1e-10, 1e-12)}
WAYS = (
    Way("jc.fit_damping, jc.fit_record", "ours", _ours, (0.0,), "", most=2000, files=_FILES),
    *(
        way
        for family, name in (("scipy", "solve_ivp"), ("numba", "numba"))
        for way in (
            Way(
                f"least_squares over {name}",
                family,
                functools.partial(by_least_squares, model=family),
                settings=_SETTINGS[family],
                variants=_METHODS,
                most=2000,
                needs="numba" if family == "numba" else "",
                compiled=family == "numba",
                files=_FILES,
            ),
            Way(
                f"lmfit over {name}",
                family,
                functools.partial(by_lmfit, model=family),
                settings=_SETTINGS[family],
                most=2000,
                needs="lmfit",
                compiled=family == "numba",
                files=_FILES,
            ),
        )
    ),
)
# A complete fit by SciPy, point after point in Python, is extrapolated from fewer points.
FEWER = {"scipy": 20}
TASKS = ((Table(), 20), (Table(), 1000), (Record(), 2000))
"""Tasks with their numbers of points."""


def run(store: Store, only: str = "", small: bool = False) -> None:
    """Measure what the store lacks, options first."""
    ways = named(WAYS, only, SMALL if small else None, slice(-1, None))
    if not small:
        sweep(store, "fit options", Table(), ways, 20)
    cases = []
    for (task, points), way in itertools.product(((Table(), 5),) if small else TASKS, ways):
        if task.name == Table.name and way.family in FEWER:
            way = dataclasses.replace(way, most=FEWER[way.family])
        cases.append((task, way, (points,)))
    run_cases(store, "fits", cases, "fit options")


SMALL = ("jc.fit_damping, jc.fit_record", "lmfit over numba")
