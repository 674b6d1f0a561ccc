"""Map of right, flagged and wrong results of the package: `python benchmarks/stability.py`.

It covers every kind of law by every method, over damping, exponents, pushes, units and both
precisions. The oracles use extended precision and share no code with the package. Two seeds are
drawn, which share compiled programs and tables. Results are written after every group of jobs that
share them, to benchmarks/stability.json and benchmarks/stability_seed.json. An interrupted run
continues; a job answered by other code or with other lanes is run again. `--fresh` starts over,
`--lanes` scales the number of lanes, `--only` runs the jobs whose name contains a text.
`--one-seed` draws the first only, `--workers` is the number of processes, `--into` selects another
folder for the results.

Other parts: `--slopes`, first derivatives; `--balance`, a million lanes without an oracle;
`--laws`, every law of the registry by its own class; `--peers`, the alternatives of users, with
Exudyn and MuJoCo if installed. `--page` writes the page and the pictures from the files.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from pathlib import Path
from typing import Any

import jax

jax.config.update("jax_enable_x64", True)

from stability_map.code import fingerprint
from stability_map.grid import Job, all_jobs, by_table, lanes_of, scaled
from stability_map.package_lanes import answers
from stability_map.verdict import judge, record

HERE = Path(__file__).parent
SEED = 1
RESULT, SEEDED = HERE / "stability.json", HERE / "stability_seed.json"
PEERS = HERE / "stability_peers.json"
SLOPES = HERE / "stability_slopes.json"
BALANCE = HERE / "stability_balance.json"
LAWS = HERE / "stability_laws.json"


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


def run_slopes_of(job: Job) -> dict[str, Any]:
    from stability_map.slopes import run_slopes

    return run_slopes(job)


def run_balance_of(job: Job) -> dict[str, Any]:
    from stability_map.balance import run_balance

    return run_balance(job)


def run_law_of(question: Any) -> dict[str, Any]:
    from stability_map.public_laws import run_law

    return run_law(question)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fresh", action="store_true", help="forget what was computed before")
    parser.add_argument("--lanes", type=float, default=1.0, help="factor of the number of lanes")
    parser.add_argument("--only", default="", help="jobs whose name contains this")
    parser.add_argument("--one-seed", action="store_true", help="no second seed")
    parser.add_argument("--workers", type=int, default=2, help="processes")
    parser.add_argument("--page", action="store_true", help="only the page and its pictures")
    parser.add_argument("--peers", action="store_true", help="only what users would write instead")
    parser.add_argument("--slopes", action="store_true", help="only the first derivatives")
    parser.add_argument("--balance", action="store_true", help="only the lanes without an oracle")
    parser.add_argument("--laws", action="store_true", help="only the laws by their own classes")
    parser.add_argument("--into", type=Path, default=HERE, help="folder of the results")
    arguments = parser.parse_args()
    if arguments.page:
        from stability_map.page import write

        paths = {
            "known": RESULT,
            "seeded": SEEDED,
            "peers": PEERS,
            "slopes": SLOPES,
            "balance": BALANCE,
            "laws": LAWS,
        }
        write(**{name: _read(path) for name, path in paths.items()})
    elif arguments.peers:
        from stability_map.peers import run_all

        PEERS.write_text(_compact(run_all(_read(PEERS), arguments.only)))
    elif arguments.laws:
        from stability_map.public_laws import law_jobs

        _run_all(run_law_of, [[question] for question in law_jobs()], {0: LAWS}, arguments)
    elif arguments.balance:
        from stability_map.balance import balance_jobs

        groups = [[job] for job in balance_jobs(arguments.lanes)]
        _run_all(run_balance_of, groups, {groups[0][0].seed: BALANCE}, arguments)
    elif arguments.slopes:
        from stability_map.slopes import slope_jobs

        _run_all(run_slopes_of, [[job] for job in slope_jobs()], {0: SLOPES}, arguments)
    else:
        outs = {0: RESULT} if arguments.one_seed else {0: RESULT, SEED: SEEDED}
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
                out.write_text(_compact({name: known[seed][name] for name in names}))


def _read(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text()) if path.exists() else {}


def _compact(known: dict[str, Any]) -> str:
    """A job a line: the file stays small, and its changes can be read."""
    return (
        "{\n" + ",\n".join(f"{json.dumps(k)}: {json.dumps(v)}" for k, v in known.items()) + "\n}\n"
    )


if __name__ == "__main__":
    main()
