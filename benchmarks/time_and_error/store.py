"""Rows in a JSON file, each written as soon as it is measured, with the data of the machine."""

from __future__ import annotations

import functools
import hashlib
import json
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from .. import study
from ..stability_map.code import fingerprint, without_words
from .problems import SEED

HERE = Path(__file__).parent


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
        """Write all rows."""
        self.rows[key] = row
        self.machine = machine()
        study.put(self.path, study.with_machine(self.machine, self.rows))

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


def machine() -> dict[str, Any]:
    """Hardware, versions, commit, seed."""
    return study.machine() | {"seed": SEED}
