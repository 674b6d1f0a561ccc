"""Run time of one impact against its error, for all methods: `python benchmarks/methods.py`.

Only the ratios are meaningful; the times belong to the machine that is printed with them. Compile
time is measured separately. Errors are relative to the closed form, which the tests compare with
40-digit arithmetic.

`--equal LANES` compares at an equal error instead: `event`, plain diffrax and the numba kernel,
each at its coarsest tolerance with e and the duration within 1e-9, for e from 0.2 to 0.99, under a
push and for a user's own law. All ways of a problem are measured in turn.
`NUMBA_NUM_THREADS=1 taskset -c 1` holds them on one core.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

# The truth of the problems comes from the oracle in the tests folder.
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import jax

jax.config.update("jax_enable_x64", True)

import diffrax
import jax.numpy as jnp
import numpy as np

import jaxcontact as jc
from benchmarks.study import machine
from benchmarks.time_and_error import by_diffrax, by_scipy
from benchmarks.time_and_error.ours import OURS
from benchmarks.time_and_error.problems import PROBLEMS, Problem, function_of

CONTACT = jc.Contact(mass=1.0, stiffness=1.4e8)
VELOCITY = 4.2
UNIT = (1.0 * VELOCITY**2 / 1.4e8) ** 0.4 / VELOCITY
REPEATS = 5


def lanes(count: int) -> jax.Array:
    """Restitutions from 0.1 to 1, in an order that mixes them."""
    return jnp.asarray(np.random.default_rng(0).uniform(0.1, 1.0, count))


def scipy_solver(e: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What most people write: solve_ivp with an event, one impact after another, scaled."""
    problem = PROBLEMS["hunt_crossley"]
    run = by_scipy.loop(problem, 1.5 * (1 - e) / e, method="DOP853", atol=1e-3)
    return run(1e-9)


def plain_diffrax(e: jax.Array) -> tuple[jax.Array, jax.Array]:
    """diffrax in (x, v), vmapped: no scaling of the coordinates, no closed form."""
    acceleration = function_of(PROBLEMS["hunt_crossley"].acceleration)

    def one(alpha):
        return by_diffrax.impact(acceleration, (alpha,), 1e-9, diffrax.Tsit5())

    return jax.vmap(one)(1.5 * (1 - e) / e)


def ours(**how) -> Callable:
    """`jc.impact` for e and duration, in scaled units."""

    def solve(e):
        hit = jc.impact(jc.HuGuo(e=e), CONTACT, VELOCITY, **how)
        return hit.restitution, hit.duration / UNIT

    return solve


def summary(e: jax.Array) -> tuple:
    """Everything `jc.impact` knows."""
    hit = jc.impact(jc.HuGuo(e=e), CONTACT, VELOCITY)
    return (hit.restitution, hit.duration / UNIT, hit.max_force, hit.max_indentation)


WAYS: dict[str, tuple[Callable, int, bool]] = {
    # name: (function, lanes, whether it is jitted)
    "scipy DOP853, rtol 1e-9": (scipy_solver, 200, False),
    "diffrax plain, Tsit5 1e-9": (plain_diffrax, 20_000, True),
    "event, rtol 1e-9": (ours(method="event"), 20_000, True),
    "event, diffeqsolve": (ours(method=jc.Event(solver=diffrax.Dopri8())), 20_000, True),
    "phase, 32 steps": (ours(method="phase"), 100_000, True),
    "exact, e and duration": (ours(), 400_000, True),
    "exact, summary": (summary, 400_000, True),
    "restitution alone": (lambda e: (jc.restitution(jc.HuGuo(e=e)), None), 4_000_000, True),
}


def measure(name: str) -> dict:
    """Seconds to compile, microseconds an impact (the fastest repeat), and the worst errors."""
    solve, count, jitted = WAYS[name]
    e = lanes(count)
    compile_time = 0.0
    if jitted:
        start = time.perf_counter()
        solve = jax.jit(solve).lower(e).compile()
        compile_time = time.perf_counter() - start
    else:
        e = np.asarray(e)
    times = []
    for _ in range(REPEATS if jitted else 1):
        start = time.perf_counter()
        result = jax.block_until_ready(solve(e))
        times.append(time.perf_counter() - start)
    true_e, true_duration = jax.jit(ours())(lanes(count))
    duration = result[1]
    return {
        "way": name,
        "lanes": count,
        "compile_s": compile_time,
        "us_per_impact": 1e6 * min(times) / count,
        "error_e": float(np.max(np.abs(result[0] / true_e - 1))),
        "error_duration": None
        if duration is None
        else float(np.max(np.abs(duration / true_duration - 1))),
    }


WITHIN = 1e-9
TOLERANCES = tuple(10.0 ** (-k / 2) for k in range(13, 26))


def ordinary(number: Any) -> Any:
    """Hu and Guo's α of e from 0.99 down to 0.2."""
    e = 0.99 - 0.79 * number
    return 1.5 * (1 - e) / e


def at_equal_error(count: int, only: str) -> list[dict]:
    """The cheapest setting of every way that keeps both errors within `WITHIN`, by problem.

    Ways other than `event` are those whose name and options contain `only`.
    """
    # Numba is wanted here alone.
    from benchmarks.time_and_error.by_numba import NUMBA

    problems = (
        dataclasses.replace(PROBLEMS["hunt_crossley"], number=ordinary),
        PROBLEMS["pushed"],
        PROBLEMS["own"],
    )
    event = next(way for way in OURS if way.name == "event")
    peers = [way for way in by_diffrax.DIFFRAX if way.name.endswith(("Tsit5", "Dopri8"))]
    rows = []
    for problem in problems:
        given = problem.lanes(count)
        runs = []
        for way in (event, *peers, *NUMBA):
            for variant in way.variants:
                if way is not event and only not in f"{way.name}, {variant}":
                    continue
                solve = way.prepared(problem, given, variant)
                row = {"problem": problem.name, "lanes": count, "way": way.name, "options": variant}
                row |= coarsest(problem, given, solve)
                if "rtol" in row:
                    runs.append((solve, row))
        rows += in_turn(runs, count)
    return rows


def coarsest(problem: Problem, given: np.ndarray, solve: Callable) -> dict:
    """The coarsest tolerance that keeps both errors, and these; {} where none does."""
    for rtol in TOLERANCES:
        errors = problem.errors(given, jax.block_until_ready(solve(rtol)))
        if max(errors.values()) <= WITHIN:
            return {"rtol": rtol, **errors}
    return {}


def in_turn(runs: list[tuple[Callable, dict]], count: int) -> list[dict]:
    """Rows with the smallest wall and CPU time, and the ratio to the first row of the same round.

    Every round measures all ways, since the speed of a machine changes within minutes. The ratio is
    the median of the rounds.
    """
    spent = np.empty((REPEATS, len(runs), 2))
    for times in spent:
        for (solve, row), place in zip(runs, times, strict=True):
            start, used = time.perf_counter(), time.process_time()
            jax.block_until_ready(solve(row["rtol"]))
            place[:] = time.perf_counter() - start, time.process_time() - used
    costs = 1e6 * spent.min(0) / count
    ratios = np.median(spent[..., 1] / spent[:, :1, 1], 0)
    for (_, row), (wall, processor), ratio in zip(runs, costs, ratios, strict=True):
        row |= {"us": wall, "processor_us": processor, "times_event": ratio}
        print(
            f"{row['problem']:15}{row['way'] + ', ' + row['options']:75}{row['rtol']:9.1e}"
            f"{wall:9.2f}{processor:9.2f} us{ratio:8.2f} x  {row['error_e']:.0e} "
            f"{row['error_duration']:.0e}",
            flush=True,
        )
    return [row for _, row in runs]


def main() -> None:
    """Print the table; with --out also write it as JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, help="JSON file to write")
    parser.add_argument("--equal", type=int, metavar="LANES", help="compare at an equal error")
    parser.add_argument("--only", default="", help="ways of --equal whose name contains this")
    arguments = parser.parse_args()
    if arguments.equal:
        written(arguments.out, at_equal_error(arguments.equal, arguments.only))
        return
    rows = [measure(name) for name in WAYS]
    slowest = rows[0]["us_per_impact"]
    print(f"{'way':28}{'lanes':>9}{'compile/s':>11}{'us/impact':>12}{'x scipy':>10}  errors e, T")
    for row in rows:
        row["times_scipy"] = slowest / row["us_per_impact"]
        duration = row["error_duration"]
        print(
            f"{row['way']:28}{row['lanes']:9}{row['compile_s']:11.2f}{row['us_per_impact']:12.3f}"
            f"{row['times_scipy']:10.0f}  {row['error_e']:.0e}  "
            f"{'' if duration is None else f'{duration:.0e}'}"
        )
    written(arguments.out, rows)


def written(path: Path | None, rows: list[dict]) -> None:
    """Print the machine, and write it with the rows to a JSON file."""
    print(about := machine())
    if path is not None:
        path.write_text(json.dumps({"machine": about, "rows": rows}, indent=1) + "\n")


if __name__ == "__main__":
    main()
