"""One impact, in batches of 1, 100 and 100,000: five problems by all methods."""

from __future__ import annotations

import itertools

from .by_diffrax import DIFFRAX
from .by_numba import NUMBA
from .by_scipy import SCIPY
from .ours import OURS
from .problems import PROBLEMS
from .running import named, run_cases, sweep
from .store import Store

WAYS = (*OURS, *DIFFRAX, *SCIPY, *NUMBA)
BATCHES = (1, 100, 100_000)
SWEPT = "hunt_crossley"
"""The problem on which a way's options are chosen, in the largest batch."""
SMALL = ("exact", "diffrax Tsit5", "scipy DOP853", "numba 8(5,3), regularised")
SMALL_BATCH = 20


def run(store: Store, only: str = "", small: bool = False) -> None:
    """Measure what the store lacks: the sweep over options first, then every row."""
    if small:
        ways = named(WAYS, "", SMALL, slice(2))
        cases = [(PROBLEMS[SWEPT], way, (SMALL_BATCH,)) for way in ways]
    else:
        cases = [(p, way, BATCHES) for p, way in itertools.product(PROBLEMS.values(), WAYS)]
    cases = [
        (problem, way, batches)
        for problem, way, batches in cases
        if only.lower() in f"{way.name}, {problem.title}".lower()
    ]
    if not small:
        ways = [way for way in WAYS if any(way is each for _, each, _ in cases)]
        sweep(store, "options", PROBLEMS[SWEPT], ways, BATCHES[-1])
    run_cases(store, "impacts", cases, "options")
