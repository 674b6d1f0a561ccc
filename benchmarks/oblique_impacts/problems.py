"""Batches of oblique impacts in scaled numbers, and how errors are stated.

ψ = κu/(μ v0) of the slip speed u, χ = λκ/2, α of the normal force x^1.5 (1 + αx').

Calls are measured in turn, so that other work of the machine falls on all of them.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np

import jaxcontact as jc

CHI = 49 / 34
"""Solid spheres of one material with ν = 0.3."""
MU = 0.3
MOBILITY = 3.5
TARGET = 1e-9


class Lanes(NamedTuple):
    """ψ1, χ, e and α of each impact."""

    psi: np.ndarray
    chi: np.ndarray
    e: np.ndarray
    alpha: np.ndarray

    def first(self, count: int) -> Lanes:
        return Lanes(*(x[:count] for x in self))


def spheres(count: int) -> Lanes:
    """Impacts of unequal spheres: every lane has its own ψ1, χ and e."""
    draw = np.random.default_rng(0)
    psi, chi = draw.uniform(0, 6, count), draw.uniform(1.1, 1.75, count)
    e = draw.uniform(0.84, 1, count)
    return Lanes(psi, chi, e, np.asarray(jc.exact_damping_factor(e)))


def elastic(count: int) -> np.ndarray:
    """ψ1 of elastic impacts of one kind of spheres: 16 % of them slide throughout."""
    return np.random.default_rng(1).uniform(0, 4.764706 / 0.84, count)


def errors(found: np.ndarray, exact: np.ndarray) -> dict[str, float]:
    """The worst and the median error of ψ2, the share of lanes above the target, and of failed."""
    wrong = np.abs(np.asarray(found) - exact)
    failed = ~np.isfinite(wrong)
    there = wrong[~failed] if not failed.all() else np.ones(1)
    return {
        "error": float(there.max()),
        "median": float(np.median(there)),
        "above": float(np.mean(failed | (wrong > TARGET))),
        "failed": float(np.mean(failed)),
    }


ROUNDS = 7
LONG = 1.0
"""Seconds from which a call is made twice only."""
SHORT = 0.1
"""Seconds that a turn of a shorter call is filled up to."""


class Method(NamedTuple):
    """A method on some lanes: its name, setting, call, lanes, and errors of what it returns."""

    name: str
    setting: str
    call: Callable[[], Any]
    lanes: int
    errors: Callable[[Any], dict[str, float]] = lambda answer: {}


def side_by_side(case: str, methods: list[Method]) -> list[dict[str, Any]]:
    """Return a row for each method: µs a lane, the best by the clock and the mean of the processor.

    The first call, which compiles, does not count. The processor's time sums over threads; some
    systems count it in ticks of 10 ms, so that the least of short turns would be too small.
    """
    answers = [jax.block_until_ready(method.call()) for method in methods]
    wall, used = [float("inf")] * len(methods), [(0.0, 0)] * len(methods)
    for turn in range(ROUNDS):
        for k, method in enumerate(methods):
            if turn > 1 and wall[k] > LONG:
                continue
            calls = 1 if turn == 0 else max(1, int(SHORT / wall[k]))
            start, before = time.perf_counter(), time.process_time()
            for _ in range(calls):
                jax.block_until_ready(method.call())
            used[k] = used[k][0] + time.process_time() - before, used[k][1] + calls
            wall[k] = min(wall[k], (time.perf_counter() - start) / calls)
    rows = []
    for k, method in enumerate(methods):
        row = {"case": case, "method": method.name, "setting": method.setting}
        row |= {"lanes": method.lanes, "us": _short(1e6 * wall[k] / method.lanes)}
        row["cpu_us"] = _short(1e6 * used[k][0] / used[k][1] / method.lanes)
        rows.append(row | {name: _short(x) for name, x in method.errors(answers[k]).items()})
        print(rows[-1], flush=True)
    return rows


def _short(x: float) -> float:
    return float(f"{x:.3g}")
