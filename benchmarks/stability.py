"""Map of right, flagged and wrong results of the package: `python -m benchmarks stability`.

It covers every kind of law by every method, over damping, exponents, pushes, units and both
precisions. The oracles use extended precision and share no code with the package. Two seeds are
drawn, which share compiled programs and tables. Results are written after every group of jobs that
share them, to benchmarks/stability.json and benchmarks/stability_seed.json. An interrupted run
continues; a job answered by other code or with other lanes is run again.

Other parts: `--part slopes`, first derivatives; `laws`, every law of the registry by its own class;
`peers`, the alternatives of users.
"""

from __future__ import annotations

import json
import multiprocessing
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from pathlib import Path
from typing import Any

import jax

from benchmarks.stability_map.code import fingerprint
from benchmarks.stability_map.grid import Job, all_jobs, answers, by_table, lanes_of, scaled
from benchmarks.stability_map.verdict import judge, record
from benchmarks.study import HERE, Study, by_line, put

SEED = 1
PARTS = ("", "seed", "laws", "slopes", "peers")
"""The results of the first and the second seed, and of the other parts."""


def file_of(part: str, folder: Path = HERE) -> Path:
    return folder / f"stability{'_' if part else ''}{part}.json"


def read(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text()) if path.exists() else {}


def shown(known: dict[str, Any]) -> str:
    from benchmarks.stability_map import page

    return page.tables(known, *(read(file_of(part)) for part in PARTS[1:]))


def draw(known: dict[str, Any], docs: Path) -> None:
    from benchmarks.stability_map import page

    page.draw(known, *(read(file_of(part)) for part in PARTS[1:]), docs)


def run_group(run_one: Callable[[Job], dict[str, Any]], jobs: list[Job]) -> list[dict[str, Any]]:
    """Jobs one after another in one process, whose tables and programs they share."""
    # A worker begins without.
    jax.config.update("jax_enable_x64", True)
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


def measure(
    path: Path, fresh: bool, lanes: float, only: str, one_seed: bool, workers: int, part: str
) -> None:
    """Run the jobs missing in the file of their seed, which is written after each group."""
    from benchmarks.stability_map import peers, public_laws, slopes

    seeds = {0: part} if part or one_seed else {0: "", SEED: "seed"}
    outs = {seed: file_of(name, path.parent) for seed, name in seeds.items()}
    known = {seed: {} if fresh else read(out) for seed, out in outs.items()}
    if part == "peers":
        put(outs[0], by_line(peers.run_all(known[0], only)))
        return
    if part == "laws":
        run_one, groups = public_laws.run_law, [[each] for each in public_laws.law_jobs()]
    elif part == "slopes":
        run_one, groups = slopes.run_slopes, [[job] for job in slopes.slope_jobs()]
    else:
        run_one, groups = (
            run,
            [
                [
                    replace(job, lanes=max(int(job.lanes * lanes), 256), seed=seed)
                    for job in group
                    for seed in seeds
                ]
                for group in by_table(all_jobs())
            ],
        )
    code = fingerprint()

    def missing(job: Job) -> bool:
        # Jobs answered by other code or with other lanes are run again.
        found = known[job.seed].get(job.name, {})
        same = found.get("asked") == [job.lanes, job.seed] and found.get("code") == code
        return only in job.name and not same

    asked = [found for group in groups if (found := [job for job in group if missing(job)])]
    count, left = 0, sum(map(len, asked))
    # In the order of the jobs, independent of their completion.
    order = list(dict.fromkeys(job.name for group in groups for job in group))
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, context) as pool:
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


OPTIONS = {
    "--lanes": {"type": float, "default": 1.0, "help": "factor of the number of lanes"},
    "--only": {"default": "", "help": "jobs whose name contains this"},
    "--one-seed": {"action": "store_true", "help": "no second seed"},
    "--workers": {"type": int, "default": 2, "help": "processes"},
    "--part": {"default": "", "choices": PARTS[2:], "help": "only this part"},
}
STUDY = Study(__file__, __doc__, measure, shown, "stability_tables", OPTIONS, draw=draw, keeps=True)
