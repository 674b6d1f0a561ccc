"""Where the package is right, flagged or wrong: `python benchmarks/stability.py`.

Every kind of law by every method, over damping, exponents, pushes, units and both precisions,
beside oracles in extended precision that share no code with the package. The result is written
after every job to benchmarks/stability.json; a run that was stopped goes on where it was.
`--fresh` starts over, `--lanes` scales the number of lanes, `--only` runs the jobs whose name
contains a text, `--seed` draws other lanes (to benchmarks/stability_seed.json), `--workers` is the
number of processes. Other parts: `--slopes`, first derivatives; `--balance`, a million lanes
without an oracle; `--peers`, what users would write instead, with Exudyn and MuJoCo where they are
installed. `--page` makes the page and the pictures from the files.
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

from stability_map.grid import Job, lanes_of, scaled
from stability_map.jobs import all_jobs
from stability_map.package_lanes import answers
from stability_map.record import record
from stability_map.verdict import judge

HERE = Path(__file__).parent
RESULT, SEEDED = HERE / "stability.json", HERE / "stability_seed.json"
PEERS = HERE / "stability_peers.json"
SLOPES = HERE / "stability_slopes.json"
BALANCE = HERE / "stability_balance.json"


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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fresh", action="store_true", help="forget what was computed before")
    parser.add_argument("--lanes", type=float, default=1.0, help="factor of the number of lanes")
    parser.add_argument("--only", default="", help="jobs whose name contains this")
    parser.add_argument("--seed", type=int, default=0, help="other random lanes")
    parser.add_argument("--workers", type=int, default=2, help="processes")
    parser.add_argument("--page", action="store_true", help="only the page and its pictures")
    parser.add_argument("--peers", action="store_true", help="only what users would write instead")
    parser.add_argument("--slopes", action="store_true", help="only the first derivatives")
    parser.add_argument("--balance", action="store_true", help="only the lanes without an oracle")
    parser.add_argument("--out", type=Path, default=None)
    arguments = parser.parse_args()
    if arguments.page:
        from stability_map.page import write

        paths = {
            "known": RESULT,
            "seeded": SEEDED,
            "peers": PEERS,
            "slopes": SLOPES,
            "balance": BALANCE,
        }
        write(**{name: _read(path) for name, path in paths.items()})
    elif arguments.peers:
        from stability_map.peers import run_all

        PEERS.write_text(_compact(run_all(_read(PEERS), arguments.only)))
    elif arguments.balance:
        from stability_map.balance import balance_jobs

        jobs = balance_jobs(arguments.lanes)
        _run_all(run_balance_of, jobs, arguments.out or BALANCE, arguments)
    elif arguments.slopes:
        from stability_map.slopes import slope_jobs

        _run_all(run_slopes_of, slope_jobs(), arguments.out or SLOPES, arguments)
    else:
        jobs = [
            replace(job, lanes=max(int(job.lanes * arguments.lanes), 256), seed=arguments.seed)
            for job in all_jobs()
        ]
        out = arguments.out or (SEEDED if arguments.seed else RESULT)
        _run_all(run, jobs, out, arguments)


def _run_all(
    run_one: Callable[[Job], dict[str, Any]],
    jobs: list[Job],
    out: Path,
    arguments: argparse.Namespace,
) -> None:
    """Run the jobs that are missing in `out`, which is written after each."""
    known = {} if arguments.fresh else _read(out)
    asked = [job for job in jobs if arguments.only in job.name]
    # A job that was run with other lanes is run again.
    asked = [job for job in asked if known.get(job.name, {}).get("asked") != [job.lanes, job.seed]]
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(arguments.workers, mp_context=context) as pool:
        running = {pool.submit(run_one, job): job for job in asked}
        for number, future in enumerate(as_completed(running), start=1):
            job = running[future]
            known[job.name] = {"asked": [job.lanes, job.seed], **future.result()}
            # In the order of the jobs, whoever was ready first.
            names = [job.name for job in jobs if job.name in known]
            out.write_text(_compact({name: known[name] for name in names}))
            found = known[job.name]
            counts = found.get("counts", found)
            words = ", ".join(
                f"{count} {name}"
                for name, count in counts.items()
                if isinstance(count, int) and count
            )
            print(f"[{number}/{len(asked)}] {job.name}: {words}", flush=True)


def _read(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text()) if path.exists() else {}


def _compact(known: dict[str, Any]) -> str:
    """A job a line: the file stays small, and its changes can be read."""
    return (
        "{\n" + ",\n".join(f"{json.dumps(k)}: {json.dumps(v)}" for k, v in known.items()) + "\n}\n"
    )


if __name__ == "__main__":
    main()
