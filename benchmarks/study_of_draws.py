"""Studies of simulated recordings: draws in groups, intervals that hold the truth, and medians."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.study import Columns, Study, parts, table

SURE = 1.959964
_ONLY = {"--only": {"type": int, "help": "so many draws, and write nothing"}}

Row = dict[str, Any]


def inside(value: float, error: float, truth: float, quantile: float = SURE) -> bool:
    """Whether the 95 % interval holds the truth."""
    return bool(abs(value - truth) <= quantile * error)


def share(values: Sequence[Any]) -> float | None:
    return sum(map(bool, values)) / len(values) if values else None


def middle(values: Sequence[float]) -> float | None:
    return float(np.median(values)) if values else None


def grouped(
    seed: int,
    one_of: Callable[..., Row],
    summary: Callable[[list[Row]], Row],
    groups: Mapping[str, Callable[[Row], bool]],
    others: Mapping[str, Mapping[str, Any]],
    draws: int,
    each: int,
    only: int | None,
) -> dict[str, Any]:
    """Draw recordings and sum them up: all, by group, and those of other kinds.

    Every recording has a generator of its own.
    """
    if only:
        draws, each = only, max(only // 10, 5)
    rows = [one_of(np.random.default_rng([seed, k])) for k in range(draws)]
    found: dict[str, Any] = {"seed": seed, "all": summary(rows)}
    found |= {name: summary([r for r in rows if group(r)]) for name, group in groups.items()}
    for k, (name, how) in enumerate(others.items(), 1):
        some = (np.random.default_rng([seed, k, j]) for j in range(each))
        found[name] = summary([one_of(random, **how) for random in some])
    return found


def study_of(file: str, words: str | None, measure: Callable[..., Any], columns: Columns) -> Study:
    """Return the study, whose page has its name."""

    def shown(result: Any) -> str:
        return table(columns, parts(result), "---:")

    return Study(file, words, measure, shown, Path(file).stem, _ONLY, trial="only")
