"""Calls measured in turn, so that other work of the machine falls on all of them."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import jax

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
