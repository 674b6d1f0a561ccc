"""One impact, in batches of 1, 100 and 100,000: five problems by all methods."""

from __future__ import annotations

import dataclasses
import itertools

import jax

from .by_diffrax import DIFFRAX
from .by_numba import NUMBA
from .by_scipy import SCIPY
from .ours import OURS
from .problems import PROBLEMS
from .running import chosen, measure, sweep
from .stepping import STEPPING
from .store import Store

WAYS = (*OURS, *DIFFRAX, *SCIPY, *NUMBA, *STEPPING)
BATCHES = (1, 100, 100_000)
SWEPT = "hunt_crossley"
"""The problem on which a way's options are chosen, in the largest batch."""
SMALL = ("exact", "diffrax Tsit5", "scipy DOP853", "numba 8(5,3), regularised", "velocity Verlet")
SMALL_BATCH = 20


def run(store: Store, only: str = "", small: bool = False) -> None:
    """Measure what the store lacks: the sweep over options first, then every row."""
    problems = [PROBLEMS[SWEPT]] if small else list(PROBLEMS.values())
    pairs = [
        (problem, way)
        for problem, way in itertools.product(problems, WAYS)
        if only.lower() in f"{way.name}, {problem.title}".lower()
    ]
    ways = [way for way in WAYS if any(way is each for _, each in pairs)]
    batches = (SMALL_BATCH,) if small else BATCHES
    if small:
        pairs = [
            (problem, dataclasses.replace(way, settings=way.settings[:2]))
            for problem, way in pairs
            if way.name in SMALL
        ]
    else:
        sweep(store, "options", PROBLEMS[SWEPT], ways, BATCHES[-1])
    for count, (problem, way) in enumerate(pairs, 1):
        head = f"[{count}/{len(pairs)}]"
        for batch in batches:
            if way.batches is None or batch in way.batches:
                options = chosen(store, "options", way)
                measure(store, "impacts", problem, way, options, batch, head)
        # A process can hold a few hundred programs.
        jax.clear_caches()
