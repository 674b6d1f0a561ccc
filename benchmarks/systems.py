"""Mechanisms with contacts, run time against error: `python -m benchmarks systems`.

A double pendulum beside a wall, up to its fifth touch, and a slider-crank with clearance in a
joint, up to its fifth. Each method runs at several tolerances. The error is that of the time of the
last touch, relative to the duration; the reference is this package at its finest tolerance, whose
digits `tests/test_system/test_agreement.py` compares with published ones. Compile time is left out.
SciPy and plain diffrax are restarted at every event, as a user would; numba is a Dormand-Prince
method of order 5 by hand, with the Illinois method at events. Then follow the time of a lane among
1,000 slider-cranks, and the price of derivatives 3 and 20 contacts deep. Ratios of times in one run
are what counts.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import jaxcontact as jc
from benchmarks.mechanisms import peers
from benchmarks.mechanisms.problems import Problem, problems
from benchmarks.study import Study, lines
from benchmarks.time_and_error.measure import timed

TOLERANCES = (1e-5, 1e-7, 1e-9, 1e-11)
PEERS_TOO = (1e-13,)
"""A finer tolerance for peers, whose errors are larger at the same one."""


def ours(problem: Problem, rtol: float) -> Callable[[], jax.Array]:
    how = {"rtol": rtol, "v0": "touch"}
    return lambda: (
        jc.simulate(problem.system, problem.duration, **problem.start, **how).contacts.time
    )


def ours_in_jit(problem: Problem, rtol: float) -> Callable[[], jax.Array]:
    @jax.jit
    def touches(start):
        how = {"rtol": rtol, "v0": "touch", "max_impacts": 12, "throw": False}
        return jc.simulate(problem.system, problem.duration, **start, **how).contacts.time

    return lambda: touches(problem.start)


METHODS = {
    "jaxcontact": ours,
    "jaxcontact, in jit": ours_in_jit,
    "SciPy DOP853, restarted": peers.by_scipy,
    "diffrax Dopri8, restarted": peers.by_diffrax,
    "numba, by hand": peers.by_numba,
}


def seconds_of(call: Callable[[], Any]) -> float:
    return timed(call, compiled=True)[0]["seconds"]


def lanes() -> dict[str, float]:
    """Return the times in ms of one slider-crank of 1.6 ms, and of a lane among 1,000."""

    def touches(clearance):
        system, start = jc.systems.slider_crank(clearance)
        run = jc.simulate(system, 1.6e-3, **start, v0="touch", max_impacts=16, throw=False)
        return run.contacts.time

    single, batch = jax.jit(touches), jax.jit(jax.vmap(touches))
    clearances = jnp.linspace(0.4e-3, 0.6e-3, 1000)
    together = batch(clearances)
    alone = single(clearances[500])
    worst = float(jnp.nanmax(jnp.abs(together[500] - alone)))
    return {
        "alone": 1e3 * seconds_of(lambda: single(clearances[500])),
        "lane": seconds_of(lambda: batch(clearances)),
        "difference_s": worst,
    }


def prices() -> list[dict[str, float]]:
    """Return the times of derivatives by e relative to that of the value, by depth in contacts."""
    rows = []
    for duration, depth in ((2.5, 3), (24.0, 20)):

        def last(e, duration=duration, depth=depth):
            system, start = jc.systems.double_pendulum(law=jc.HuGuo(e=e))
            how = {"v0": "touch", "max_impacts": 32, "throw": False}
            return jc.simulate(system, duration, **start, **how).contacts.time[depth - 1]

        def along(e, last=last):
            return jax.jvp(last, (e,), (1.0,))

        calls = [jax.jit(call) for call in (last, along, jax.grad(last))]
        value, forward, reverse = (seconds_of(lambda call=call: call(0.9)) for call in calls)
        rows.append({"depth": depth, "forward": forward / value, "reverse": reverse / value})
    return rows


def measure_rows(only: str) -> list[dict[str, Any]]:
    rows = []
    for name, problem in problems().items():
        exact = np.asarray(ours(problem, 1e-12)())[4]
        for method, solver in METHODS.items():
            finer = () if method.startswith("jaxcontact") else PEERS_TOO
            for rtol in (*TOLERANCES, *finer) if only in method else ():
                row = {"problem": name, "method": method, "rtol": rtol}
                try:
                    took, touches = timed(solver(problem, rtol), compiled=True)
                except (ImportError, RuntimeError, ValueError) as error:
                    rows.append(row | {"failed": str(error)[:80]})
                    continue
                touches = np.asarray(touches)
                touches = touches[np.isfinite(touches)]
                error = (
                    abs(touches[4] - exact) / problem.duration if len(touches) >= 5 else math.inf
                )
                rows.append(row | {"ms": 1e3 * took["seconds"], "error": float(error)})
                print(rows[-1], flush=True)
    return rows


def table(result: dict[str, Any]) -> str:
    cells = []
    for row in result["rows"]:
        numbers = [f"failed: {row.get('failed')}", ""]
        if "failed" not in row:
            numbers = [f"{row['ms']:.3g}", f"{row['error']:.1e}"]
        cells.append([row["problem"], row["method"], f"{row['rtol']:.0e}", *numbers])
    batch = result["lanes"]
    words = [
        f"\nA slider-crank of 1.6 ms alone: {batch['alone']:.3g} ms; one of 1,000 in a batch: "
        f"{batch['lane']:.3g} ms, with touches within {batch['difference_s']:.0e} s of those alone."
    ]
    words += [
        f"The derivative by e, {row['depth']} contacts deep, takes {row['forward']:.2g} times the "
        f"value forward and {row['reverse']:.2g} times in reverse."
        for row in result["prices"]
    ]
    heads = ["mechanism", "method", "rtol", "ms", "error of the fifth touch"]
    return "\n".join([lines(heads, cells, "---"), *words])


def measure(known: dict | None, only: str) -> dict[str, Any]:
    return {"rows": measure_rows(only), "lanes": lanes(), "prices": prices()}


OPTIONS = {"--only": {"default": "", "help": "methods whose name contains this"}}
STUDY = Study(__file__, __doc__, measure, table, options=OPTIONS)
