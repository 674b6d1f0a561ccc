"""Oblique impacts, run time against error: `python -m benchmarks oblique [GROUP]`.

The table of Maw, Barber and Fawcett beside the same springs in numba; one spring and slider beside
numba by hand, SciPy with events and diffrax; LAMMPS and MuJoCo with the errors that they reach. The
methods of a group run in turn in one process, and the best of several calls counts.
`python -m benchmarks run_time_error --page` puts the result on its page.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Any

from benchmarks.oblique_impacts.groups import GROUPS, SMALL, WHOLE
from benchmarks.oblique_impacts.page import section
from benchmarks.study import Study, machine


def measure(known: dict | None, group: str | None, small: bool) -> Iterator[dict[str, Any]]:
    result = known or {"groups": {}}
    hardware = {key: machine()[key] for key in ("processor", "cores", "commit")}
    for name in [group] if group else GROUPS:
        rows = GROUPS[name](SMALL if small else WHOLE)
        load = round(os.getloadavg()[0], 1) if hasattr(os, "getloadavg") else None
        result["groups"][name] = {"rows": rows, "machine": hardware, "load": load}
        yield result


OPTIONS = {
    "group": {"nargs": "?", "choices": GROUPS, "help": "one group; all by default"},
    "--small": {"action": "store_true", "help": "a few lanes of each group"},
}
STUDY = Study(
    __file__, __doc__, measure, lambda result: "\n".join(section(result)), options=OPTIONS
)
