"""Run time of whole scenes against their error.

`python benchmarks/scenes.py [--out FILE] [--only GROUP]`

The package is compared with SciPy and plain diffrax, both restarted at events. Each uses the
loosest tolerance that reaches the error. The study then measures the cost of an instantaneous
impact and of a gradient, in steps and in values, the gain by skipping unneeded parts (`--only
skips`), and beds (`--only beds`). Only ratios are meaningful; beds are in CPU time, with compiling.
"""

from __future__ import annotations

import argparse
import functools
import json
import time
from collections.abc import Callable
from pathlib import Path

import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp
import numpy as np
import scene_skips
from scene_costs import best, gradient_cost, impact_cost
from study import machine
from time_and_error.line_scenes import Fixed, Line, by_diffrax, by_scipy, line, oblique, scene_of

import jaxcontact as jc

ERROR = 1e-9
"""Wanted of final velocities, relative to the largest speed at the start."""

REFERENCE = 2.3e-14
"""The tolerance of the reference, the least that SciPy takes."""

LADDER = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12, 1e-13)
BETWEEN = (6.0, 3.0, 2.0)
"""What the first tolerance that reaches the error is multiplied by, to find the loosest one."""


def compared(name: str, line: Line) -> list[dict]:
    """One scene by all ways, each at the loosest tolerance that reaches the error."""
    truth = by_scipy(line, REFERENCE)
    fixed, scale = Fixed(line), np.max(np.abs(line.velocity))
    counted = jc.simulate(scene_of(line), line.duration, v0="touch").impacts
    room = len(counted) + 2

    @functools.partial(jax.jit, static_argnums=1)
    def ours(velocity, rtol):
        run = jc.simulate(
            scene_of(line, velocity), line.duration, rtol=rtol, v0="touch", max_impacts=room
        )
        return run.velocity[-1].ravel()

    given = jnp.asarray(line.velocity)
    ways: dict[str, Callable] = {
        "jaxcontact, jitted": lambda rtol: ours(given, rtol),
        "jaxcontact, from Python": lambda rtol: (
            jc.simulate(scene_of(line), line.duration, rtol=rtol, v0="touch").velocity[-1].ravel()
        ),
        "diffrax Dopri8, restarted": functools.partial(by_diffrax, fixed, line.longest),
        "scipy DOP853, restarted": lambda rtol: by_scipy(line, rtol),
    }
    rows = []
    for way, solve in ways.items():
        row = {"scene": name, "way": way, "impacts": len(counted), "reached": False}

        def tried(rtol: float, solve: Callable = solve) -> dict:
            compile_s, seconds, found = best(functools.partial(solve, rtol), 5)
            error = float(np.max(np.abs(found - truth)) / scale)
            told = {"rtol": rtol, "compile_s": compile_s, "seconds": seconds, "error": error}
            return told | {"reached": error <= ERROR}

        for rtol in LADDER:
            row |= tried(rtol)
            if row["reached"]:
                break
        between = BETWEEN if row["reached"] and row["rtol"] < LADDER[0] else ()
        finer = (tried(factor * row["rtol"]) for factor in between)
        row |= next((found for found in finer if found["reached"]), {})
        rows.append(row)
    # In turn, each for at least a tenth of a second, so that other load affects all of them
    # equally.
    for _ in range(8):
        for row in rows:
            often = max(3, int(0.1 / row["seconds"]))
            seconds = best(functools.partial(ways[row["way"]], row["rtol"]), often)[1]
            row["seconds"] = min(row["seconds"], seconds)
    for row in rows:
        row["times_ours"] = row["seconds"] / rows[0]["seconds"]
        print(
            f"{name:24}{row['way']:28} rtol {row['rtol']:.0e}  error {row['error']:.0e}"
            f"  {1e3 * row['seconds']:10.3f} ms  ({row['compile_s']:.1f} s before)", flush=True
        )  # fmt: skip
    return rows


def beds() -> list[dict]:
    """Balls of 2 cm that settle in a box, in CPU seconds of the first and a later run."""
    rows = []
    for axes, count in ((2, 3), (2, 6), (2, 12), (3, 4), (3, 8)):
        low, high = [0.0] * axes, [0.06] * (axes - 1) + [0.02 * count]
        balls = jc.random_spheres(count, low=low, high=high, radius=0.01, mass=0.01, seed=1)
        law, down = jc.HuGuo(e=0.5), [0.0] * (axes - 1) + [-9.81]
        scene, times = jc.Scene([*balls, jc.Box(low, high)], law, stiffness=1e6, gravity=down), []
        for _ in range(2):
            start = time.process_time()
            run = jc.simulate(scene, 0.2, throw=False, progress=False)
            times.append(time.process_time() - start)
        row = {"axes": axes, "balls": count, "impacts": len(run.impacts), "ok": bool(run.ok)}
        rows.append(row | {"first_s": times[0], "later_s": times[1]})
        print(rows[-1], flush=True)
    return rows


GROUPS: dict[str, Callable[[], list[dict]]] = {
    "runs": lambda: [
        *compared("line, gaps of 0.1 m", line(0.1, 1e9, 15.0)),
        *compared("line, gaps of 1e-5 m", line(1e-5, 1e9, 0.02)),
        *compared("oblique pair, 4e-3", oblique(4e-3)),
    ],
    "impacts": lambda: [impact_cost(2, 4096), impact_cost(128, 2048), impact_cost(2048, 512)],
    "gradients": lambda: [gradient_cost(2, 64), gradient_cost(128, 256)],
    "skips": scene_skips.rows,
    "beds": beds,
}


def main() -> None:
    """Print the tables; with --out also write them as JSON, over those of the same groups."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, help="JSON file to write")
    parser.add_argument("--only", choices=GROUPS, help="one group of rows")
    arguments = parser.parse_args()
    groups = {k: rows() for k, rows in GROUPS.items() if arguments.only in (None, k)}
    print(about := machine())
    if arguments.out:
        known = json.loads(arguments.out.read_text()) if arguments.out.exists() else {}
        table = known | {"machine": about} | groups
        arguments.out.write_text(json.dumps(table, indent=1) + "\n")


if __name__ == "__main__":
    main()
