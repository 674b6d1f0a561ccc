"""The stored results of a job: counts, the worst lanes, and errors over damping and push."""

from __future__ import annotations

from typing import Any

import numpy as np

from .collocation import Array
from .grid import Job
from .kinds import QUANTITIES
from .verdict import CLASSES, FLAGGED_RIGHTLY, FLAGGED_WITHOUT_NEED, WRONG, Judged

DAMPING_EDGES = np.arange(-9.0, 6.5, 1.0)
PUSH_EDGES = np.array(
    [-np.inf, *(-(10.0 ** np.arange(3, -12, -3))), 0.0, *(10.0 ** np.arange(-9, 6, 3)), np.inf]
)
"""Edges in the push: three decades a column on either side of none."""
WORST = 5


def cells(damping: Array, push: Array) -> tuple[Array, Array]:
    """The row (damping) and column (push) of every lane; row 0 is no damping."""
    with np.errstate(divide="ignore"):
        row = np.digitize(np.log10(damping.astype(float)), DAMPING_EDGES)
    return row, np.digitize(push.astype(float), PUSH_EDGES[1:-1])


def record(job: Job, numbers: tuple[Array, Array, Array], judged: Judged) -> dict[str, Any]:
    damping, n, push = numbers
    counts = np.bincount(judged.klass, minlength=len(CLASSES))
    rows, columns = cells(damping, push)
    shape = (DAMPING_EDGES.size + 1, PUSH_EDGES.size - 1)
    decade, flags, total = np.full(shape, -99), np.zeros(shape, int), np.zeros(shape, int)
    with np.errstate(divide="ignore"):
        size = np.where(
            np.isfinite(judged.error), np.ceil(np.log10(np.maximum(judged.error, 1e-19))), -99
        )
    np.maximum.at(decade, (rows, columns), size.astype(int))
    np.add.at(flags, (rows, columns), judged.status >= 2)
    np.add.at(total, (rows, columns), 1)
    worst = {}
    for klass in (WRONG, FLAGGED_WITHOUT_NEED):
        index = np.flatnonzero(judged.klass == klass)
        index = index[np.argsort(-judged.excess[index], kind="stable")][:WORST]
        worst[CLASSES[klass]] = [
            {
                "damping": float(damping[i]),
                "n": float(n[i]),
                "push": float(push[i]),
                "status": int(judged.status[i]),
                "true status": int(judged.truth.status[i]),
                "true e": float(judged.truth.e[i]),
                "worst": QUANTITIES[judged.worst[i]],
                "error": _plain(judged.error[i]),
                "times allowed": _plain(judged.excess[i]),
            }
            for i in index
        ]
    right = judged.klass < FLAGGED_RIGHTLY
    return {
        "lanes": job.lanes,
        "counts": {name: int(count) for name, count in zip(CLASSES, counts, strict=True)},
        "largest error, times allowed": _plain(judged.excess[right].max(initial=0)),
        "worst": worst,
        "decade": decade.tolist(),
        "flags": flags.tolist(),
        "total": total.tolist(),
    }


def _plain(x: Any) -> float | None:
    return float(f"{float(x):.3g}") if np.isfinite(x) else None
