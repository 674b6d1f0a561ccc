"""One impact, in batches of 1, 100 and 100,000: five problems by all ways."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator
from typing import Any

import jax
import numpy as np

from .by_diffrax import DIFFRAX
from .by_numba import NUMBA
from .by_scipy import SCIPY
from .measure import NotPossibleError, timed
from .ours import OURS
from .problems import CHECKED, PROBLEMS, Problem, truth, worst
from .stepping import STEPPING
from .store import Store, code_of
from .way import Way

WAYS = {way.name: way for way in (*OURS, *DIFFRAX, *SCIPY, *NUMBA, *STEPPING)}
BATCHES = (1, 100, 100_000)
SWEPT = "hunt_crossley"
"""The problem on which a way's options are chosen, in the largest batch."""
GOOD = 1e-6
"""The error at which options are compared."""
_FILES = {
    "ours": ("ours.py",),
    "diffrax": ("by_diffrax.py",),
    "scipy": ("by_scipy.py",),
    "numba": ("by_numba.py", "pairs.py"),
    "stepping": ("stepping.py",),
}
SMALL = ("exact", "diffrax Tsit5", "scipy DOP853", "numba Dormand-Prince 5(4)", "velocity Verlet")
SMALL_BATCH = 20


def code(way: Way) -> str:
    return code_of(("way.py", *_FILES[way.family]), way.family == "ours")


def run(store: Store, only: str = "", small: bool = False) -> None:
    """Measure what the store lacks: the sweep over options first, then every row."""
    ways = [way for way in WAYS.values() if only.lower() in way.name.lower()]
    problems = [PROBLEMS[SWEPT]] if small else list(PROBLEMS.values())
    batches = (SMALL_BATCH,) if small else BATCHES
    if small:
        ways = [dataclasses.replace(w, settings=w.settings[:2]) for w in ways if w.name in SMALL]
    else:
        _sweep(store, ways)
    for count, (problem, way) in enumerate(itertools.product(problems, ways), 1):
        for batch in batches:
            if way.batches is None or batch in way.batches:
                head = f"[{count}/{len(problems) * len(ways)}]"
                _measure(store, "impacts", problem, way, chosen(store, way), batch, head)
        # A process has room for a few hundred programs.
        jax.clear_caches()


def _sweep(store: Store, ways: list[Way]) -> None:
    """Every option of every way that has some."""
    asked = [way for way in ways if len(way.variants) > 1]
    for count, way in enumerate(asked, 1):
        middle = dataclasses.replace(way, settings=way.settings[1:4])
        for variant in way.variants:
            head = f"[options {count}/{len(asked)}]"
            _measure(store, "options", PROBLEMS[SWEPT], middle, variant, BATCHES[-1], head)
        jax.clear_caches()


def chosen(store: Store, way: Way) -> str:
    """The options by which a way is fastest at a good error; its default before a sweep."""
    rows = [
        row
        for row in store.group("options").values()
        if row["way"] == way.name and row["options"] in way.variants and "error" in row
    ]
    # Where none is that good, the fastest of the best.
    bar = max(GOOD, min((row["error"] for row in rows), default=0.0))
    good = [row for row in rows if row["error"] <= bar]
    if not good:
        return next(iter(way.variants))
    return min(good, key=lambda row: row["us_per_impact"])["options"]


def _rows(way: Way, stem: str) -> Iterator[tuple[str, float]]:
    for setting in way.settings:
        yield f"{stem}/{setting:g}", setting


def _measure(
    store: Store, group: str, problem: Problem, way: Way, variant: str, batch: int, head: str
) -> None:
    """All settings of a way on one batch."""
    stem = f"{group}/{problem.name}/{batch}/{way.name}/{variant}"
    wanted = [pair for pair in _rows(way, stem) if store.lacks(pair[0], code(way))]
    if not wanted:
        return
    lanes = problem.lanes(min(batch, way.most))
    base = {
        "group": group, "problem": problem.name, "batch": batch, "way": way.name,
        "family": way.family, "options": variant, "measured": lanes.size, "code": code(way),
    }  # fmt: skip
    title = f"{head} {problem.title}, {batch:,} by {way.name}"
    # A loop over lanes costs the same in every batch: what was measured is not measured again.
    for key, setting in wanted:
        twin = _twin(store, base | {"setting": setting})
        if twin:
            store.keep(key, twin | base | {"setting": setting})
    wanted = [pair for pair in wanted if store.lacks(pair[0], code(way))]
    if not wanted:
        return
    try:
        solve = way.prepared(problem, lanes, variant)
    except NotPossibleError as reason:
        for key, setting in wanted:
            store.keep(key, base | {"setting": setting, "reason": str(reason)})
        print(f"{title}: {reason}", flush=True)
        return
    want = truth(problem.name, tuple(lanes[:CHECKED].tolist()))
    for key, setting in wanted:
        row, (e, duration) = timed(lambda s=setting: solve(s), way.compiled)
        errors = {"error_e": worst(e, want[0]), "error_duration": worst(duration, want[1])}
        row |= {"us_per_impact": 1e6 * row["seconds"] / lanes.size, **_finite(errors)}
        store.keep(key, base | {"setting": setting} | row)
        told = f"{row['error']:.0e}" if "error" in row else row["reason"]
        print(f"{title}, {way.word} {setting:g}: {row['us_per_impact']:.3g} µs, {told}", flush=True)


def _twin(store: Store, base: dict[str, Any]) -> dict[str, Any] | None:
    """The same measurement, made for another batch or for the choice of options."""
    names = ("problem", "way", "options", "measured", "code", "setting")
    for row in store.rows.values():
        if row["group"] in ("impacts", "options") and all(row.get(k) == base[k] for k in names):
            return row
    return None


def _finite(errors: dict[str, float]) -> dict[str, Any]:
    """Errors, or the reason why there is no number."""
    if not all(np.isfinite(list(errors.values()))):
        return {"reason": "flagged, or no end found, in some lanes"}
    return {**errors, "error": max(*errors.values(), 1e-16)}
