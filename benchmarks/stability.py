"""Where the package is right, flagged or wrong: `python benchmarks/stability.py`.

Every kind of law by every method, over damping, exponents, pushes, units and both precisions,
beside oracles in extended precision that share no code with the package. The result is written
after every job to benchmarks/stability.json; a run that was stopped goes on where it was.
`--fresh` starts over, `--lanes` scales the number of lanes, `--only` runs the jobs whose name
contains a text; `--page` makes the page and the pictures from the file.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import jax

jax.config.update("jax_enable_x64", True)

from stability_map.grid import Job, lanes_of, scaled
from stability_map.jobs import all_jobs
from stability_map.package_lanes import answers
from stability_map.record import record
from stability_map.verdict import CLASSES, judge

HERE = Path(__file__).parent
RESULT = HERE / "stability.json"
PEERS = HERE / "stability_peers.json"
SLOPES = HERE / "stability_slopes.json"


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
    parser.add_argument(
        "--page", action="store_true", help="only make docs/stability.md and pictures"
    )
    parser.add_argument("--peers", action="store_true", help="only what users would write instead")
    parser.add_argument("--slopes", action="store_true", help="only the first derivatives")
    parser.add_argument("--out", type=Path, default=RESULT)
    arguments = parser.parse_args()
    if arguments.page:
        from stability_map.page import write

        read = [json.loads(p.read_text()) for p in (arguments.out, PEERS, SLOPES) if p.exists()]
        write(*read)
        return
    if arguments.peers:
        from stability_map.peers import run_all

        PEERS.write_text(_compact(run_all()))
        return
    if arguments.slopes:
        _slopes(arguments.only, arguments.fresh)
        return
    known = {}
    if arguments.out.exists() and not arguments.fresh:
        known = json.loads(arguments.out.read_text())
    jobs = [job for job in all_jobs() if arguments.only in job.name]
    for number, job in enumerate(jobs, start=1):
        lanes = max(int(job.lanes * arguments.lanes), 256)
        job = Job(job.kind, job.exponent, job.pushed, job.method, job.precision, lanes)
        if known.get(job.name, {}).get("lanes") == lanes:
            continue
        known[job.name] = run(job)
        arguments.out.write_text(_compact(known))
        counts = known[job.name]["counts"]
        words = ", ".join(f"{counts[name]} {name}" for name in CLASSES if counts[name])
        print(
            f"[{number}/{len(jobs)}] {job.name}: {words}; {known[job.name]['seconds']} s",
            flush=True,
        )


def _slopes(only: str, fresh: bool) -> None:
    from stability_map.slopes import run_slopes, slope_jobs

    known = json.loads(SLOPES.read_text()) if SLOPES.exists() and not fresh else {}
    for job in slope_jobs():
        if only in job.name and job.name not in known:
            known[job.name] = run_slopes(job)
            SLOPES.write_text(_compact(known))
            print(job.name, {k: v for k, v in known[job.name].items() if k != "worst"}, flush=True)


def _compact(known: dict[str, Any]) -> str:
    """A job a line: the file stays small, and its changes can be read."""
    return (
        "{\n" + ",\n".join(f"{json.dumps(k)}: {json.dumps(v)}" for k, v in known.items()) + "\n}\n"
    )


if __name__ == "__main__":
    main()
