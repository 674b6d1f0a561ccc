"""Run times on a GPU beside those of the CPU: `python -m benchmarks gpu [--limit SECONDS]`.

Batches of impacts, gradients, sweeps, scenes by `vmap`, oblique pairs, fits and first calls, each
with its error. Without a GPU the rows of the CPU are measured alone. A row that fails is recorded
with the reason, and the others go on. The result is written after every row, and the page
docs/gpu.md at the end.

    XLA_PYTHON_CLIENT_PREALLOCATE=false python -m benchmarks gpu --limit 280
"""

from __future__ import annotations

import concurrent.futures
import contextlib
import datetime
import json
import os
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np

from benchmarks import weight
from benchmarks.gpu_page import page
from benchmarks.gpu_tasks import TASKS, Task
from benchmarks.study import Study, put, with_machine
from benchmarks.time_and_error import running

REPEATS = 3
SLOW = 4.0
"""Seconds from which a call is not repeated."""
AT_ONCE = 4
"""Programs that are compiled, and first calls that run, at a time; at most one for each core."""
CALLS = (
    *("impact, exact", "impact, event", "impact, event: gradient"),
    *(f"scene of 3 discs and a plane, {kind}" for kind in ("instantaneous", "soft")),
)
"""First calls, as `weight.py` writes them."""
FIRST = "first calls"
GROUPS = (*dict.fromkeys(task.group for task in TASKS), FIRST)

Row = dict[str, Any]


class Clock:
    """The time that is left; no row starts after it."""

    def __init__(self, limit: float):
        self.start, self.limit = time.monotonic(), limit

    def left(self) -> float:
        return self.start + self.limit - time.monotonic()

    def check(self) -> None:
        if self.left() <= 0:
            raise TimeoutError(f"not started within {self.limit:g} s")


class Result:
    """Rows, written whole after each one. Those of other groups stay, if they are of this card."""

    def __init__(self, path: Path, groups: Sequence[str]):
        self.path, self.machine = path, machine()
        self.rows: list[Row] = []
        known = json.loads(path.read_text()) if path.exists() else {"machine": {}, "rows": []}
        if all(known["machine"].get(name) == self.machine.get(name) for name in ("card", "jax")):
            self.rows += [row for row in known["rows"] if row["group"] not in groups]

    def keep(self, row: Row) -> None:
        self.rows.append(row)
        print(json.dumps(row), flush=True)
        put(self.path, with_machine(self.machine, self.rows))


def devices() -> dict[str, jax.Device]:
    """The CPU, and the GPU if JAX has one, by name."""
    found = {"cpu": jax.devices("cpu")[0]}
    if jax.default_backend() != "cpu":
        found["gpu"] = jax.devices()[0]
    return found


def machine() -> Row:
    """The card, its driver, the host, the versions and the date."""
    try:
        host = dict(running.machine())
    except OSError:
        # Without git.
        host = {"jax": jax.__version__, "cores": os.cpu_count()}
    for name in ("engines", "precision", "numba", "lmfit"):
        host.pop(name, None)
    return {
        "card": devices()["gpu"].device_kind if "gpu" in devices() else None,
        "driver": driver(),
        "date": datetime.datetime.now(datetime.UTC).date().isoformat(),
        **host,
    }


def driver() -> str | None:
    """The version of NVIDIA's driver."""
    command = ["nvidia-smi", "--query-gpu=driver_version", "--format=csv,noheader"]
    try:
        told = subprocess.run(command, capture_output=True, text=True, check=True, timeout=20)
    except (OSError, subprocess.SubprocessError):
        return None
    return told.stdout.split("\n")[0].strip() or None


def failed(error: BaseException) -> Row:
    """A row without numbers: the kind of error, and the first of its words."""
    words = " ".join(str(error).split())[:300]
    return {"failed": f"{type(error).__name__}: {words}" if words else type(error).__name__}


class Prepared:
    """A task of one size, precision and platform, whose program is compiled in the background."""

    def __init__(self, task: Task, precision: str, size: int, platform: str):
        self.task, self.precision, self.size, self.platform = task, precision, size, platform
        self.row: Row = {
            "group": task.group,
            "what": task.what,
            "unit": task.unit,
            "size": size,
            "precision": precision,
            "platform": platform,
        }
        self.call: Callable[[], Any] | None = None
        self.compiling: concurrent.futures.Future | None = None
        self.given: Any = ()

    def settings(self) -> contextlib.ExitStack:
        """The precision and the device, for this thread."""
        stack = contextlib.ExitStack()
        stack.enter_context(jax.enable_x64(self.precision == "float64"))
        stack.enter_context(jax.default_device(devices()[self.platform]))
        return stack

    def begin(self, pool: concurrent.futures.Executor) -> None:
        """Trace here, one after another, and compile in the pool."""
        with self.settings():
            function, given = self.task.make(self.size, self.precision, self.platform)
            if self.task.whole:
                self.call = function
                return
            self.given = jax.device_put(given, devices()[self.platform])
            start = time.perf_counter()
            lowered = jax.jit(function).lower(*self.given)
            self.row["trace_s"] = short(time.perf_counter() - start)
        self.compiling = pool.submit(self.compiled, lowered)

    def compiled(self, lowered: Any) -> Any:
        start = time.perf_counter()
        with self.settings():
            done = lowered.compile()
        self.row["compile_s"] = short(time.perf_counter() - start)
        return done

    def measure(self) -> Any:
        """Fill in the row: best seconds, rate, cores in use; return the answer."""
        if self.compiling is not None:
            program = self.compiling.result()
            self.call = lambda: program(*self.given)
        with self.settings():
            start = time.perf_counter()
            answer = jax.block_until_ready(self.call())
            self.row["first_s"] = short(time.perf_counter() - start)
            best, used = np.inf, 0.0
            for _ in range(REPEATS):
                start, processor = time.perf_counter(), time.process_time()
                answer = jax.block_until_ready(self.call())
                spent = time.perf_counter() - start
                if spent < best:
                    best, used = spent, time.process_time() - processor
                if spent > SLOW:
                    break
        rate = self.size / best
        self.row |= {"seconds": short(best), "rate": short(rate), "cores": short(used / best)}
        return jax.tree.map(np.asarray, answer)


def short(x: float) -> float:
    return float(f"{x:.4g}")


def difference(answer: Any, known: Any) -> float:
    """The largest difference of two answers, relative to the largest number of each array."""
    found = [0.0]
    for got, want in zip(jax.tree.leaves(answer), jax.tree.leaves(known), strict=True):
        count = min(len(got), len(want))
        miss = np.max(np.abs(got[:count] - want[:count]))
        found.append(float(miss / max(np.max(np.abs(want[:count])), 1.0)))
    return max(found) if np.isfinite(found).all() else np.inf


def tasks(group: str, quick: bool) -> Iterator[Prepared]:
    """Yield the rows of a group in their order."""
    for task in TASKS:
        if task.group == group:
            for row in task.rows(tuple(devices()), quick):
                yield Prepared(task, *row)


def measure_group(group: str, quick: bool, clock: Clock, result: Result) -> None:
    """Compile all programs of a group, and only then measure them, so that nothing else runs."""
    every = list(tasks(group, quick))
    answers: dict[tuple[str, str], Any] = {}
    pool = concurrent.futures.ThreadPoolExecutor(min(2 * AT_ONCE, os.cpu_count() or 1))
    broken: dict[int, Row] = {}
    for number, one in enumerate(every):
        try:
            clock.check()
            one.begin(pool)
        except Exception as error:  # a row that fails is recorded, and the others go on
            broken[number] = failed(error)
    waiting = [one.compiling for one in every if one.compiling is not None]
    late = concurrent.futures.wait(waiting, max(clock.left(), 0)).not_done
    for number, one in enumerate(every):
        try:
            if number not in broken:
                if one.compiling in late:
                    raise TimeoutError("not compiled in time")
                clock.check()
                answer = one.measure()
                one.row |= judged(one, answer, answers)
        except Exception as error:  # likewise: out of memory, or late
            broken[number] = failed(error)
        # The largest inputs take a gigabyte.
        one.given, one.call, one.compiling = (), None, None
        result.keep(one.row | broken.get(number, {}))
    pool.shutdown(wait=False, cancel_futures=True)


def judged(one: Prepared, answer: Any, answers: dict[tuple[str, str], Any]) -> Row:
    """The error beside the truth, or else the difference from the CPU's answer."""
    key = one.task.what, one.precision
    if one.task.error is not None:
        return {"error": short(one.task.error(one.size, one.precision, answer))}
    if one.platform == "cpu":
        answers[key] = answer
        return {}
    return {"from_cpu": short(difference(answer, answers[key]))} if key in answers else {}


def first_calls(quick: bool, clock: Clock, result: Result) -> None:
    """The seconds of first calls, each in a fresh process that stores no program."""
    wanted = [(call, name) for call in CALLS[: 1 if quick else None] for name in devices()]
    # JAX names NVIDIA's platform so; the flag leaves memory for processes beside this one.
    platform = {"cpu": "cpu", "gpu": "cuda"}

    def measured(call: str, name: str) -> Row:
        row = {"group": FIRST, "what": call, "platform": name}
        try:
            clock.check()
            spent, _ = weight.times_of(
                weight.PROGRAMS[call],
                "perf_counter",
                max(clock.left(), 1.0),
                JAX_PLATFORMS=platform[name],
                XLA_PYTHON_CLIENT_PREALLOCATE="false",
            )
            return row | {"first_s": short(spent)}
        except Exception as error:  # likewise: whatever the process says
            return row | failed(error)

    with concurrent.futures.ThreadPoolExecutor(min(AT_ONCE, os.cpu_count() or 1)) as pool:
        for row in pool.map(lambda both: measured(*both), wanted):
            result.keep(row)


def run(path: Path, fresh: bool, limit: float, quick: bool, only: Sequence[str]) -> None:
    clock, result = Clock(limit), Result(path, GROUPS if fresh else only)
    for group in only:
        if group == FIRST:
            first_calls(quick, clock, result)
        else:
            measure_group(group, quick, clock, result)


OPTIONS = {
    "--limit": {"type": float, "default": 3600.0, "help": "seconds; then no row starts"},
    "--quick": {"action": "store_true", "help": "small sizes"},
    "--only": {"nargs": "+", "choices": GROUPS, "default": GROUPS, "help": "groups"},
}
STUDY = Study(__file__, __doc__, run, page, "gpu", OPTIONS, keeps=True, whole=True)
