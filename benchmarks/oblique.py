"""Oblique impacts, run time against error: `python benchmarks/oblique.py [GROUP]`.

The table of Maw, Barber and Fawcett beside the same springs in numba; one spring and slider beside
numba by hand, SciPy with events and diffrax; LAMMPS and MuJoCo with the errors that they reach. The
methods of a group run in turn in one process, and the best of several calls counts. Writes
benchmarks/oblique.json, which `python benchmarks/run_time_error.py --page` puts on its page.
`--small` is the form for tests.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

import jax

jax.config.update("jax_enable_x64", True)

from benchmarks.oblique_impacts.groups import GROUPS, SMALL, WHOLE
from benchmarks.oblique_impacts.page import section
from benchmarks.time_and_error.store import machine

RESULT = Path(__file__).with_suffix(".json")


def main(words: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("group", nargs="?", choices=GROUPS, help="one group; all by default")
    parser.add_argument("--small", action="store_true", help="a few lanes of each group")
    parser.add_argument("--out", type=Path, default=RESULT, help="the JSON file")
    arguments = parser.parse_args(words)
    out = arguments.out
    result = json.loads(out.read_text()) if out.exists() else {"groups": {}}
    for name in [arguments.group] if arguments.group else GROUPS:
        rows = GROUPS[name](SMALL if arguments.small else WHOLE)
        known = machine()
        hardware = {key: known[key] for key in ("processor", "cores", "commit")}
        load = round(os.getloadavg()[0], 1) if hasattr(os, "getloadavg") else None
        result["groups"][name] = {"rows": rows, "machine": hardware, "load": load}
        out.write_text(json.dumps(result, indent=1, ensure_ascii=False) + "\n")
    print("\n".join(section(result)))


if __name__ == "__main__":
    main()
