"""Classification of a lane into four classes, and the stored results of a job: counts, the worst
lanes, and errors over damping and push.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .collocation import EXTENDED, Array
from .free_table import TABLE_TOLERANCE, free
from .grid import Job
from .kinds import KINDS, QUANTITIES, SEPARATED, UNANSWERED, Truth
from .motion_oracle import TOLERANCE, solve

RIGHT, FLAGGED_RIGHTLY, FLAGGED_WITHOUT_NEED, WRONG, NO_TRUTH = range(5)
CLASSES = ("right", "flagged, rightly", "flagged without need", "wrong without a flag", "no truth")

SMALLEST_E = 1e-6
"""README's bounds hold for e from 1 to this; below, the error of e counts in units of this."""
HOPELESS = 1e-3
"""Where ten roundings of the input change an outcome by this much, a flag is right."""
STEP = 1e-4
"""Relative step of the differences for condition numbers, which need two digits."""
WEAK = 1e-7
"""A push below this is no part of the condition: the outcome is that of the free impact."""
TABLED = 1000
"""Fewer lanes are solved each by itself: a table takes 18 solves for every panel they meet."""

# Accuracy stated in README, by method: restitution, and all other results.
_BOUNDS = {
    ("exact", "float64"): (1e-13, 1e-12),
    ("event", "float64"): (1e-8, 1e-8),
    ("phase", "float64"): (1e-9, 1e-9),
    ("exact", "float32"): (1e-5, 1e-4),
    ("event", "float32"): (1e-5, 1e-4),
    ("phase", "float32"): (1e-5, 1e-4),
}
# The phase method for oscillator laws, with its tolerance where README states nothing.
_PHASE_OSCILLATOR, _PHASE_TOLERANCE = 5e-8, 1e-6
_RTOL = {
    ("exact", "float64"): 2.3e-16,
    ("event", "float64"): 1e-9,
    ("phase", "float64"): 1e-9,
    ("exact", "float32"): 1.2e-7,
    ("event", "float32"): 1e-5,
    ("phase", "float32"): 1e-5,
}


@dataclass
class Judged:
    """The class of every lane, its worst error (relative) and that in units of what is allowed."""

    klass: Array
    error: Array
    excess: Array
    worst: Array
    truth: Truth
    status: Array


def truth_of(job: Job, damping: Array, n: Array, push: Array) -> Truth:
    """From the table where many impacts are free and depend on damping alone, else by motion."""
    kind = KINDS[job.kind]
    if job.pushed or not kind.has_table(job.exponent) or damping.size < TABLED:
        finer = job.method == "exact"
        return solve(kind.problem(damping, n, push), TABLE_TOLERANCE if finer else TOLERANCE)
    table = free(job.kind, damping, n if job.exponent is None else job.exponent)
    found = Truth.empty(damping.size)
    for q in QUANTITIES:
        setattr(found, q, table.value[q])
    found.status[:] = SEPARATED
    return found


def bounds_of(job: Job, e: Array) -> dict[str, Array]:
    """What is documented for every quantity of every lane."""
    of_e, of_rest = _BOUNDS[job.method, job.precision]
    bounds = {q: np.full(e.shape, of_e if q == "e" else of_rest) for q in QUANTITIES}
    if job.method == "phase" and job.precision == "float64":
        inside = documented_for_phase(job, e)
        wide = _PHASE_OSCILLATOR if KINDS[job.kind].family == "oscillator" else of_rest
        for q in QUANTITIES:
            bounds[q] = np.where(inside, wide, _PHASE_TOLERANCE)
    return bounds


def documented_for_phase(job: Job, e: Array) -> Array:
    """Where README says that the phase method is right."""
    least = {"hunt_crossley": 0.1, "oscillator": 0.73}.get(KINDS[job.kind].family, 2.0)
    return (e >= least) & (job.exponent == 1.5)


def judge(
    job: Job, numbers: tuple[Array, Array, Array], status: Array, got: dict[str, Array]
) -> Judged:
    """Compare with the truth; condition numbers are computed only where they could matter."""
    damping, n, push = numbers
    truth = truth_of(job, damping, n, push)
    bounds = bounds_of(job, truth.e)
    rtol = _RTOL[job.method, job.precision]
    errors = {q: _error(q, got[q], truth) for q in QUANTITIES}
    flagged = status >= 2
    mismatch = ~flagged & (status != truth.status)
    units = np.stack([errors[q] / bounds[q] for q in QUANTITIES])
    excused = (truth.e < SMALLEST_E) & (truth.status == SEPARATED)
    if job.method == "phase":
        excused |= ~documented_for_phase(job, truth.e)
    doubtful = np.where(flagged, ~excused, mismatch | ~(units.max(0) <= 1))
    doubtful &= truth.status != UNANSWERED
    condition = {q: np.zeros(damping.size) for q in QUANTITIES}
    near = np.zeros(damping.size, bool)
    k = np.flatnonzero(doubtful)
    if k.size:
        found, close, turns = _condition(job, damping[k], n[k], push[k], truth, k, rtol)
        for q in QUANTITIES:
            condition[q][k] = found[q]
        near[k] = close
        # Near a creep to rest, which has no turn, the time of a turn is arbitrary.
        errors["compression_time"][k] = np.where(turns, 0, errors["compression_time"][k])
    allowed = {q: np.maximum(bounds[q], 10 * rtol * condition[q]) for q in QUANTITIES}
    excess = np.stack([errors[q] / allowed[q] for q in QUANTITIES])
    # On the other side of such a close threshold, the results of that side apply.
    excess = np.where(mismatch & near, 0, np.where(mismatch, np.inf, excess))
    excess = np.where(np.isnan(excess), np.inf, excess)
    hardest = np.max(np.stack([condition[q] for q in ("e", "duration")]), 0)
    rightly = excused | near | (10 * rtol * hardest >= HOPELESS)
    klass = np.where(excess.max(0) <= 1, RIGHT, WRONG)
    klass = np.where(flagged, np.where(rightly, FLAGGED_RIGHTLY, FLAGGED_WITHOUT_NEED), klass)
    klass = np.where(truth.status == UNANSWERED, NO_TRUTH, klass)
    error = np.where(flagged, np.nan, np.stack(list(errors.values())).max(0)).astype(float)
    return Judged(klass, error, excess.max(0).astype(float), excess.argmax(0), truth, status)


def _error(q: str, got: Array, truth: Truth, k: Array | slice = slice(None)) -> Array:
    want = getattr(truth, q)[k]
    scale = np.maximum(np.abs(want), SMALLEST_E if q == "e" else 0)
    both_infinite = np.isinf(got) & np.isinf(want)
    with np.errstate(invalid="ignore"):
        error = np.abs(got - want) / np.where(scale > 0, scale, 1)
    return np.where(both_infinite, 0, np.where(np.isnan(error) & ~np.isnan(got), np.inf, error))


def _condition(job: Job, damping, n, push, truth: Truth, k: Array, rtol: float):
    """Σ |∂ ln Q/∂ ln θ| over damping, push and n, and two flags.

    They say whether the status changes nearby, and whether nearby bodies turn that creep here, or
    the reverse.
    """
    kind = KINDS[job.kind]
    total = {q: np.zeros(k.size) for q in QUANTITIES}
    near, creeps = np.zeros(k.size, bool), np.zeros(k.size, bool)

    def moved(name: str, by: float) -> Truth:
        numbers = {"damping": damping, "n": n, "push": push}
        numbers[name] = numbers[name] * (1 + EXTENDED(by))
        if name == "n":
            numbers["n"] = np.where(n == 1, n, numbers["n"])
        return solve(kind.problem(numbers["damping"], numbers["n"], numbers["push"]))

    names = ["damping"] + (["push"] if job.pushed else []) + (["n"] if job.exponent is None else [])
    status = truth.status[k]
    nearby = {q: np.zeros(k.size) for q in QUANTITIES}
    for name in names:
        up, down = moved(name, STEP), moved(name, -STEP)
        for q in QUANTITIES:
            a, b, centre = getattr(up, q), getattr(down, q), getattr(truth, q)[k]
            scale = np.maximum(np.abs(centre), SMALLEST_E if q == "e" else 0)
            with np.errstate(invalid="ignore"):
                slope = np.abs(a - b) / (2 * STEP * scale)
                one_sided = np.maximum(np.abs(a - centre), np.abs(b - centre)) / (STEP * scale)
            slope = np.where(
                np.isfinite(slope), np.maximum(slope, np.minimum(one_sided, 10 * slope)), 0
            )
            total[q] += np.asarray(slope, float)
        for by in (10 * rtol, -10 * rtol):
            there = moved(name, by)
            near |= there.status != status
            for q in QUANTITIES:
                change = np.abs(_error(q, getattr(there, q), truth, k))
                nearby[q] = np.maximum(nearby[q], np.where(np.isfinite(change), change, 0))
            creeps |= np.isinf(there.compression_time) != np.isinf(truth.compression_time[k])
    # Near a corner slopes underestimate; the effect of ten tolerances counts as well.
    for q in QUANTITIES:
        total[q] = np.maximum(total[q], nearby[q] / (10 * rtol))
    return total, near, creeps


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
