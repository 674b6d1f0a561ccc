"""Random scenes compared with Newton's equations: `python benchmarks/random_scenes.py`.

Three and four discs in a box under gravity, five laws, at `rtol` 1e-6 and 1e-9. Their final states
come from tests/oracle/random_scenes.py, which is independent of the library and has up to a
thousand scenes. A run magnifies the error of each impact. An error is therefore compared with
`rtol` times the growth of a perturbation, and with the error estimate of the impacts times that
growth.

The result is written after every scene to benchmarks/random_scenes.json, and an interrupted run
continues; `--fresh` starts over. `--only` runs the given number of scenes and writes nothing,
`--page` writes the table of docs/scenes_how.md.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np

# Works from another folder too.
sys.path.insert(0, str(Path(__file__).parents[1]))

import jaxcontact as jc
from tests.oracle.random_scenes import DURATION, GRAVITY, LAWS, RandomScene, answers, drawn

HERE = Path(__file__).parent
RESULT, PAGE = HERE / "random_scenes.json", HERE.parent / "docs" / "scenes_how.md"
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


def page(rows: dict[str, dict]) -> str:
    """The table: a line for each law and tolerance."""
    lines = [
        "| law | rtol | runs | completed | touches | error / (rtol G), median | 99 % | largest "
        "| error / (estimate G), largest | above ten |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for law in LAWS:
        for rtol in TOLERANCES:
            of_it = [
                row
                for key, row in rows.items()
                if key.endswith(f" {rtol:g}") and LAWS[int(key.split()[0]) % len(LAWS)] == law
            ]
            if not of_it:
                continue
            error = np.array([row["error"] for row in of_it])
            beside = np.array([row["beside_estimate"] for row in of_it])
            counted = [len(of_it), sum(row["completed"] for row in of_it)]
            counted.append(sum(row["touches"] for row in of_it))
            shown = [f"{x:.2g}" for x in (*np.percentile(error, [50, 99]), error.max())]
            shown += [f"{beside.max():.2g}", str(int(np.sum(~(beside <= MOST))))]
            lines.append(f"| `{law}` | {rtol:g} | {' | '.join([*map(str, counted), *shown])} |")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fresh", action="store_true")
    parser.add_argument("--only", type=int)
    parser.add_argument("--page", action="store_true")
    arguments = parser.parse_args()
    rows = json.loads(RESULT.read_text()) if RESULT.exists() and not arguments.fresh else {}
    if arguments.page:
        begin, end = "<!-- table of benchmarks/random_scenes.py -->", "<!-- end of table -->"
        before, _, rest = PAGE.read_text().partition(begin)
        PAGE.write_text(f"{before}{begin}\n{page(rows)}\n{end}{rest.partition(end)[2]}")
        return
    known = answers()
    # Scenes that share a program run one after another.
    order = sorted(known, key=lambda k: (int(k) % (2 * len(LAWS)), int(k)))
    for number in order[: arguments.only]:
        for rtol in TOLERANCES:
            key = f"{number} {rtol:g}"
            if key in rows:
                continue
            rows[key] = compared(drawn(int(number)), known[number], rtol)
            print(key, rows[key], flush=True)
        if not arguments.only:
            lines = (f'"{key}": {json.dumps(row)}' for key, row in rows.items())
            RESULT.write_text("{\n" + ",\n".join(lines) + "\n}\n")


if __name__ == "__main__":
    main()
