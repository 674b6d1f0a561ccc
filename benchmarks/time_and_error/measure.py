"""One row: best time, time of the first call, memory."""

from __future__ import annotations

import ctypes
import gc
import importlib.util
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import jax
import numpy as np

Solve = Callable[[float], Any]
"""From a setting (a tolerance, a number of steps) to the answer for all lanes."""
LADDER = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12)


@dataclass(frozen=True)
class Way:
    """`build(task, lanes, **options)` prepares a batch and returns its solver.

    `family`: who answers ("ours", "diffrax", "scipy", "numba", "engines"). `settings`: the ladder,
    named by `word`. `variants`: its options by name, of which a sweep chooses; the first one is the
    default. `most`: lanes of a batch that are measured; a larger batch is scaled from them.
    `needs`: a library it cannot do without. `compiled`: whether a first call compiles.
    """

    name: str
    family: str
    build: Callable[..., Solve]
    settings: tuple[float, ...] = LADDER
    word: str = "rtol"
    variants: dict[str, dict[str, Any]] = field(default_factory=lambda: {"": {}})
    most: int = 100_000
    needs: str = ""
    compiled: bool = True
    batches: tuple[int, ...] | None = None
    """Batches it is meant for; None for all."""
    files: tuple[str, ...] = ()
    """Files of its own, beside those of its family."""

    def prepared(self, task: Any, lanes: np.ndarray, variant: str) -> Solve:
        """The solver of a batch; NotPossibleError with the reason where there is none."""
        if self.needs and importlib.util.find_spec(self.needs) is None:
            raise NotPossibleError(f"{self.needs} is not installed")
        try:
            return self.build(task, lanes, **self.variants[variant])
        except ValueError as error:
            # The package states what a law or a motion lacks.
            raise NotPossibleError(str(error).split(": ", 1)[-1]) from error


ENOUGH = 0.15
"""Seconds of repeats after which the best counts."""
MOST, FEWEST = 500, 3
SLOW = 4.0
"""Seconds from which a call is not repeated, nor its memory measured."""


class NotPossibleError(Exception):
    """A way that a row cannot be had by, with the reason that the table gives."""


def timed(call: Callable[[], Any], compiled: bool) -> tuple[dict[str, Any], Any]:
    """Best seconds of several calls, those of compiling before, MiB at the peak; and the answer.

    `compiled`: whether the first call compiles, and so does not count.
    """
    start = time.perf_counter()
    answer = jax.block_until_ready(call())
    first = time.perf_counter() - start
    times = [] if compiled else [first]
    spent = 0.0
    while len(times) < MOST and (len(times) < FEWEST or spent < ENOUGH):
        if times and min(times) > SLOW:
            break
        start = time.perf_counter()
        answer = jax.block_until_ready(call())
        times.append(time.perf_counter() - start)
        spent += times[-1]
    best = min(times)
    return {
        "seconds": _short(best),
        "calls": len(times),
        "compile_s": _short(max(first - best, 0)) if compiled else 0.0,
        "peak_mib": _peak(call) if best < SLOW else None,
    }, answer


def _short(x: float) -> float:
    return float(f"{x:.4g}")


def _peak(call: Callable[[], Any]) -> float | None:
    """MiB by which a call raises the memory of the process, at its highest; Linux only.

    What the allocator holds back is given up before, and Linux forgets the mark it had.
    """
    if sys.platform != "linux":
        return None
    gc.collect()
    try:
        ctypes.CDLL("libc.so.6").malloc_trim(0)
        Path("/proc/self/clear_refs").write_text("5")
    except OSError:
        return None
    before = _status("VmRSS")
    jax.block_until_ready(call())
    return round(max(_status("VmHWM") - before, 0) / 1024, 2)


def _status(name: str) -> int:
    """KiB by Linux's count."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(name + ":"))
