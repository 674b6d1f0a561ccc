"""Measurement of a method on a task, one setting after another, with each row stored at once."""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import json
import math
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Protocol

import jax
import numpy as np

from benchmarks import study
from benchmarks.stability_map.code import fingerprint, without_words
from benchmarks.time_and_error.measure import NotPossibleError, Way, timed
from benchmarks.time_and_error.problems import SEED

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


GOOD = 1e-6
"""The error at which options are compared."""
FAMILY_FILES = {
    "ours": ("impacts.py",),
    "alone": ("impacts.py",),
    "diffrax": ("by_diffrax.py", "../until_event.py"),
    "scipy": ("by_scipy.py", "../until_event.py"),
    "numba": ("by_numba.py",),
    "engines": (),
}


class Task(Protocol):
    """What is solved: a name, a title, numbers of each lane, and the errors of an answer."""

    name: str
    title: str
    whole: bool
    """Whether a row's cost is ms of the whole batch, and not µs a lane."""

    def lanes(self, count: int) -> np.ndarray: ...

    def errors(self, lanes: np.ndarray, answer: Any) -> dict[str, float]: ...


def code(way: Way) -> str:
    return code_of(
        (*FAMILY_FILES[way.family], *way.files),
        way.family in ("ours", "alone"),
        way.family == "engines",
    )


def sweep(store: Store, group: str, task: Task, ways: Iterable[Way], batch: int) -> None:
    """Every option of every way that has some, at the middle of its ladder."""
    asked = [way for way in ways if len(way.variants) > 1]
    for count, way in enumerate(asked, 1):
        middle = dataclasses.replace(way, settings=way.settings[1:4])
        for variant in way.variants:
            head = f"[options {count}/{len(asked)}]"
            measure(store, group, task, middle, variant, batch, head)
        # A process can hold a few hundred programs.
        jax.clear_caches()


def chosen(store: Store, group: str, way: Way) -> str:
    """The options by which a way is fastest at a good error; its default before a sweep."""
    rows = [
        row
        for row in store.group(group).values()
        if row["way"] == way.name and row["options"] in way.variants and "error" in row
    ]
    # If none is that accurate, the fastest of the best.
    bar = max(GOOD, min((row["error"] for row in rows), default=0.0))
    good = [row for row in rows if row["error"] <= bar]
    if not good:
        return next(iter(way.variants))
    return min(good, key=lambda row: row["cost"])["options"]


def named(
    ways: Iterable[Way], only: str, small: Iterable[str] | None = None, some: slice = slice(None)
) -> list[Way]:
    """The ways whose name contains a text. With `small` those named there, with some settings."""
    found = [way for way in ways if only.lower() in way.name.lower()]
    if small is None:
        return found
    return [dataclasses.replace(w, settings=w.settings[some]) for w in found if w.name in small]


def run_cases(
    store: Store, group: str, cases: list[tuple[Task, Way, Iterable[int]]], options: str = ""
) -> None:
    """Measure what the store lacks of tasks and ways, each in its batches, by chosen options."""
    for count, (task, way, batches) in enumerate(cases, 1):
        for batch in batches:
            if way.batches is None or batch in way.batches:
                variant = chosen(store, options, way) if options else ""
                measure(store, group, task, way, variant, batch, f"[{count}/{len(cases)}]")
        # A process can hold a few hundred programs.
        jax.clear_caches()


def measure(
    store: Store, group: str, task: Task, way: Way, variant: str, batch: int, head: str
) -> None:
    """All settings of a way on one batch, those that the store lacks."""
    stem = f"{group}/{task.name}/{batch}/{way.name}/{variant}"
    wanted = {f"{stem}/{setting:g}": setting for setting in way.settings}
    wanted = {key: s for key, s in wanted.items() if store.lacks(key, code(way))}
    lanes = task.lanes(min(batch, way.most))
    base = {
        "group": group, "problem": task.name, "batch": batch, "way": way.name,
        "family": way.family, "options": variant, "measured": len(lanes), "code": code(way),
    }  # fmt: skip
    # A loop over lanes costs the same in every batch, so measured ones are not repeated.
    for key, setting in list(wanted.items()):
        twin = _twin(store, base | {"setting": setting})
        if twin:
            cost = _cost(task, twin["seconds"], batch, len(lanes))
            store.keep(key, twin | base | {"setting": setting, "cost": cost})
            del wanted[key]
    if not wanted:
        return
    title = f"{head} {task.title}, {batch:,} by {way.name}"
    try:
        solve = way.prepared(task, lanes, variant)
    except NotPossibleError as reason:
        for key, setting in wanted.items():
            store.keep(key, base | {"setting": setting, "reason": str(reason)})
        print(f"{title}: {reason}", flush=True)
        return
    unit = "ms" if task.whole else "µs"
    for key, setting in wanted.items():
        try:
            row, answer = timed(lambda s=setting: solve(s), way.compiled)
        except Exception as error:  # a peer may raise anything: report it, go on
            reason = _told(error)
            store.keep(key, base | {"setting": setting, "reason": reason})
            print(f"{title}, {way.word} {setting:g}: {reason}", flush=True)
            continue
        row["load"] = _load()
        row["cost"] = _cost(task, row["seconds"], batch, len(lanes))
        row |= _finite(task.errors(lanes, answer))
        store.keep(key, base | {"setting": setting} | row)
        told = f"{row['error']:.0e}" if "error" in row else row["reason"]
        print(f"{title}, {way.word} {setting:g}: {row['cost']:.3g} {unit}, {told}", flush=True)


@functools.singledispatch
def _told(error: Exception) -> str:
    """The first line of what was raised, and its kind."""
    return f"{type(error).__name__}: {str(error).splitlines()[0] if str(error) else ''}"


@_told.register
def _(reason: NotPossibleError) -> str:
    return str(reason)


def _load() -> float | None:
    """Processes that ran or waited, this one among them, averaged over a minute; None on Windows.

    What is above the threads of a way is the machine's other work, and makes its times longer.
    """
    return round(os.getloadavg()[0], 1) if hasattr(os, "getloadavg") else None


def _cost(task: Task, seconds: float, batch: int, measured: int) -> float:
    """µs a lane; ms of the whole batch where that is what one asks for."""
    cost = 1e3 * seconds * batch / measured if task.whole else 1e6 * seconds / measured
    return float(f"{cost:.4g}")


def _twin(store: Store, base: dict[str, Any]) -> dict[str, Any] | None:
    """The same measurement, made for another batch or for the choice of options."""
    names = ("problem", "way", "options", "measured", "code", "setting")
    for row in store.rows.values():
        same = all(row.get(name) == base[name] for name in names) and "cost" in row
        if same and not store.busy(row):
            return row
    return None


def _finite(errors: dict[str, float]) -> dict[str, Any]:
    """Errors, or the reason why there is no number."""
    if not all(np.isfinite(list(errors.values()))):
        return {"reason": "flagged, or no end found, in some lanes"}
    found = {name: float(f"{error:.3g}") for name, error in errors.items()}
    return {**found, "error": max([*found.values(), 1e-16])}
