"""Map of right, flagged and wrong results of the package: `python benchmarks/stability.py`.

It covers every kind of law by every method, over damping, exponents, pushes, units and both
precisions. The oracles use extended precision and share no code with the package. Two seeds are
drawn, which share compiled programs and tables. Results are written after every group of jobs that
share them, to benchmarks/stability.json and benchmarks/stability_seed.json. An interrupted run
continues; a job answered by other code or with other lanes is run again. `--fresh` starts over,
`--lanes` scales the number of lanes, `--only` runs the jobs whose name contains a text.
`--one-seed` draws the first only, `--workers` is the number of processes, `--into` selects another
folder for the results.

Other parts: `--slopes`, first derivatives; `--laws`, every law of the registry by its own
class; `--peers`, the alternatives of users. `--page` writes the tables and the pictures.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from pathlib import Path
from typing import Any

import jax

jax.config.update("jax_enable_x64", True)

# Works from another folder too.
sys.path.insert(0, str(Path(__file__).parents[1]))

from benchmarks.stability_map.code import fingerprint
from benchmarks.stability_map.grid import Job, all_jobs, by_table, lanes_of, scaled
from benchmarks.stability_map.package_lanes import answers
from benchmarks.stability_map.verdict import judge, record
from benchmarks.study import HERE, by_line, put

SEED = 1
FILES = {
    name: HERE / f"stability{'_' if name else ''}{name}.json"
    for name in ("", "seed", "laws", "slopes", "peers")
}
"""The results of the first and the second seed, and of the other parts."""


def run_group(run_one: Callable[[Job], dict[str, Any]], jobs: list[Job]) -> list[dict[str, Any]]:
    """Jobs one after another in one process, whose tables and programs they share."""
    found = [run_one(job) for job in jobs]
    # A process can hold a few hundred programs.
    jax.clear_caches()
    return found


def run(job: Job) -> dict[str, Any]:
    lanes = lanes_of(job)
    start = time.perf_counter()
    status, got = answers(job, lanes)
    package = time.perf_counter() - start
    numbers = scaled(job, lanes)
    found = record(job, numbers, judge(job, numbers, status, got))
    found["seconds"] = [round(package, 1), round(time.perf_counter() - start - package, 1)]
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fresh", action="store_true", help="forget what was computed before")
    parser.add_argument("--lanes", type=float, default=1.0, help="factor of the number of lanes")
    parser.add_argument("--only", default="", help="jobs whose name contains this")
    parser.add_argument("--one-seed", action="store_true", help="no second seed")
    parser.add_argument("--workers", type=int, default=2, help="processes")
    parser.add_argument("--page", action="store_true", help="only the page and its pictures")
    for part in ("slopes", "laws", "peers"):
        how = {"action": "store_const", "const": part, "help": "only this part"}
        parser.add_argument(f"--{part}", dest="part", **how)
    parser.add_argument("--into", type=Path, default=HERE, help="folder of the results")
    arguments = parser.parse_args()
    from benchmarks.stability_map import page, peers, public_laws, slopes

    if arguments.page:
        page.write(**{name or "known": _read(path) for name, path in FILES.items()})
    elif arguments.part == "peers":
        put(FILES["peers"], by_line(peers.run_all(_read(FILES["peers"]), arguments.only)))
    elif arguments.part == "laws":
        groups = [[question] for question in public_laws.law_jobs()]
        _run_all(public_laws.run_law, groups, {0: FILES["laws"]}, arguments)
    elif arguments.part == "slopes":
        groups = [[job] for job in slopes.slope_jobs()]
        _run_all(slopes.run_slopes, groups, {0: FILES["slopes"]}, arguments)
    else:
        outs = {0: FILES[""]} if arguments.one_seed else {0: FILES[""], SEED: FILES["seed"]}
        groups = [
            [
                replace(job, lanes=max(int(job.lanes * arguments.lanes), 256), seed=seed)
                for job in group
                for seed in outs
            ]
            for group in by_table(all_jobs())
        ]
        _run_all(run, groups, outs, arguments)


def _run_all(
    run_one: Callable[[Job], dict[str, Any]],
    groups: list[list[Job]],
    outs: dict[int, Path],
    arguments: argparse.Namespace,
) -> None:
    """Run the jobs missing in the file of their seed, which is written after each group."""
    outs = {seed: arguments.into / out.name for seed, out in outs.items()}
    known = {seed: {} if arguments.fresh else _read(out) for seed, out in outs.items()}
    code = fingerprint()

    def missing(job: Job) -> bool:
        # Jobs answered by other code or with other lanes are run again.
        found = known[job.seed].get(job.name, {})
        same = found.get("asked") == [job.lanes, job.seed] and found.get("code") == code
        return arguments.only in job.name and not same

    asked = [found for group in groups if (found := [job for job in group if missing(job)])]
    count, left = 0, sum(map(len, asked))
    # In the order of the jobs, independent of their completion.
    order = list(dict.fromkeys(job.name for group in groups for job in group))
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(arguments.workers, mp_context=context) as pool:
        running = {pool.submit(run_group, run_one, group): group for group in asked}
        for future in as_completed(running):
            for job, found in zip(running[future], future.result(), strict=True):
                count += 1
                head = {"asked": [job.lanes, job.seed], "code": code}
                known[job.seed][job.name] = {**head, **found}
                counts = found.get("counts", found)
                words = ", ".join(
                    f"{count} {name}"
                    for name, count in counts.items()
                    if isinstance(count, int) and count
                )
                seed = f", seed {job.seed}" if job.seed else ""
                print(f"[{count}/{left}] {job.name}{seed}: {words}", flush=True)
            for seed, out in outs.items():
                names = [name for name in order if name in known[seed]]
                put(out, by_line({name: known[seed][name] for name in names}))


def _read(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text()) if path.exists() else {}


if __name__ == "__main__":
    main()
