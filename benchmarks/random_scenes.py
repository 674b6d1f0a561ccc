"""Random scenes compared with Newton's equations: `python -m benchmarks random_scenes`.

Three and four discs in a box under gravity, five laws, at `rtol` 1e-6 and 1e-9. Their final states
come from tests/oracle/random_scenes.py, which is independent of the library and has up to a
thousand scenes. A run magnifies the error of each impact. An error is therefore compared with
`rtol` times the growth of a perturbation, and with the error estimate of the impacts times that
growth.

An interrupted run continues. `--only` runs the given number of scenes and writes nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

import jaxcontact as jc
from benchmarks.study import Study, by_line, table
from tests.oracle.random_scenes import DURATION, GRAVITY, LAWS, RandomScene, answers, drawn

TOLERANCES = 1e-6, 1e-9
MOST = 10
"""Of the error beside what was estimated: beyond, the estimate is wrong."""


def scene_of(given: RandomScene) -> jc.Scene:
    """The scene as a user would write it."""
    discs = [jc.Sphere(b.radius, b.mass, b.position, b.velocity) for b in given.balls]
    number = {"A" if given.law == "kuwabara_kono" else "e": given.number}
    return jc.Scene(
        [*discs, jc.Box([0.0, 0.0], [1.0, 1.0])],
        jc.get_law(given.law, **number),
        stiffness=given.stiffness,
        exponent=given.exponent,
        gravity=list(GRAVITY),
    )


def compared(given: RandomScene, known: dict, rtol: float) -> dict[str, float]:
    """The error of a run in m and m/s, beside `rtol` and beside the estimate, each times the growth
    of a perturbation.
    """
    run = jc.simulate(scene_of(given), DURATION, rtol=rtol, throw=False)
    away = np.abs(np.asarray(run.position[-1]) - known["position"])
    error = max(away.max(), np.abs(np.asarray(run.velocity[-1]) - known["velocity"]).max())
    impacts = run.impacts.to_dict()
    estimate = np.sum(impacts["error_estimate"] * impacts["closing_speed"])
    growth = known["growth"]
    return {
        "completed": bool(run.status == jc.Ending.COMPLETED),
        "touches": len(impacts["time"]),
        "error": float(f"{error / rtol / growth:.3g}"),
        "beside_estimate": float(f"{error / estimate / growth:.3g}"),
    }


COLUMNS: dict[str, Callable[[tuple[str, float, list[dict]]], str]] = {
    "law": lambda of: f"`{of[0]}`",
    "rtol": lambda of: f"{of[1]:g}",
    "runs": lambda of: f"{len(of[2])}",
    "completed": lambda of: f"{sum(row['completed'] for row in of[2])}",
    "touches": lambda of: f"{sum(row['touches'] for row in of[2])}",
    "error / (rtol G), median": lambda of: f"{np.median([row['error'] for row in of[2]]):.2g}",
    "99 %": lambda of: f"{np.percentile([row['error'] for row in of[2]], 99):.2g}",
    "largest": lambda of: f"{max(row['error'] for row in of[2]):.2g}",
    "error / (estimate G), largest": lambda of: f"{max(beside(of[2])):.2g}",
    "above ten": lambda of: f"{sum(not x <= MOST for x in beside(of[2]))}",
}


def beside(rows: list[dict]) -> list[float]:
    return [row["beside_estimate"] for row in rows]


def page(rows: dict[str, dict]) -> str:
    """The table: a line for each law and tolerance."""
    found: dict[tuple[str, float], list[dict]] = {(law, t): [] for law in LAWS for t in TOLERANCES}
    for key, row in rows.items():
        number, rtol = key.split()
        found[LAWS[int(number) % len(LAWS)], float(rtol)].append(row)
    return table(COLUMNS, [(*of, some) for of, some in found.items() if some], "---")


def measure(known: dict | None, only: int | None) -> Iterator[dict[str, dict]]:
    rows, every = known or {}, answers()
    # Scenes that share a program run one after another.
    order = sorted(every, key=lambda k: (int(k) % (2 * len(LAWS)), int(k)))
    for number in order[:only]:
        for rtol in TOLERANCES:
            key = f"{number} {rtol:g}"
            if key not in rows:
                rows[key] = compared(drawn(int(number)), every[number], rtol)
                print(key, rows[key], flush=True)
                yield rows


OPTIONS = {"--only": {"type": int}}
STUDY = Study(__file__, __doc__, measure, page, "scenes_how", OPTIONS, trial="only", text=by_line)
