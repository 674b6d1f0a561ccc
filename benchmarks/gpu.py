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
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np

from benchmarks import weight
from benchmarks.gpu_tasks import TASKS, Task
from benchmarks.study import Study, lines, put, with_machine
from benchmarks.time_and_error import running

Row = dict[str, Any]
MECHANISMS = "slider-crank, 1.6 ms", "double pendulum, 2.5 s"

HEAD = """# On a GPU

Page made by `python -m benchmarks gpu` from [gpu.json](../benchmarks/gpu.json).

"""
HOW = """
## Run it

<!-- not run: needs a GPU -->
```bash
pip install 'jaxcontact[cuda,benchmarks]'
XLA_PYTHON_CLIENT_PREALLOCATE=false python -m benchmarks gpu --limit 280
```

- **Times** are the best of three calls on data that are on the device; a sweep includes the
  transfer.
- **× CPU** divides the rate by the best rate of the CPU at any size. **Cores** is how many of them
  the CPU kept busy.
- **Errors** are relative. Free impacts are compared with the closed form in every lane and with 40
  digits in 17 lanes, pushed ones with 40 digits in 17 lanes. Gradients are compared with those of
  the closed form, oblique pairs with SciPy, and fits with `jc.fit`, in standard errors. Scenes and
  mechanisms show the largest difference from the CPU.
- **Tolerances**: event solves in float64 and plain diffrax use the coarsest power of ten that keeps
  1e-9 on a CPU, gradients 1e-9. In float32 an event solve uses its default, 1e-5.
- **Compile times** are of programs that compile side by side. First calls run in fresh processes,
  up to four at a time.
"""
OF_FRICTION = """Errors of ψ2 are absolute, of 17 lanes. The table is compared with springs whose
slip is followed by its fronts, a spring and slider with SciPy.

"""

PEERS = """
## Published peers

- Brax states millions of physics steps per second on a TPU
  ([its README](https://github.com/google/brax)).
- MJX states 950,000 steps per second of one humanoid on an A100, in a batch of 8,192
  ([its manual](https://mujoco.readthedocs.io/en/stable/mjx.html)).

Both count time steps, of which an impact needs many. Neither reports an error of its impacts, so
these rates are not comparable with the tables above. [Run time against error](run_time_error.md)
runs MJX and other engines beside an error, on a CPU.
"""


def page(result: dict[str, Any]) -> str:
    """The whole page."""
    rows, machine = result["rows"], result["machine"]
    parts = [HEAD, *findings(rows, machine), "\n", about(machine), HOW]
    for group in dict.fromkeys(row["group"] for row in rows):
        title = group[0].upper() + group[1:]
        of_it = [row for row in rows if row["group"] == group]
        parts += [
            f"\n## {title}\n\n",
            OF_FRICTION if group == "friction" else "",
            first_table(of_it) if "size" not in of_it[0] else table(of_it),
        ]
    return "".join([*parts, PEERS])


def about(machine: Row) -> str:
    """The hardware and the versions."""
    card = machine.get("card") or "no GPU"
    driver = f", driver {machine['driver']}" if machine.get("driver") else ""
    host = f"{machine.get('processor', 'CPU')}, {machine.get('cores')} cores"
    names = ("jax", "jaxlib", "numpy", "diffrax")
    libraries = ", ".join(f"{name} {machine[name]}" for name in names if machine.get(name))
    return f"Measured on {machine['date']}: {card}{driver}; beside it {host}; {libraries}.\n"


def findings(rows: list[Row], machine: Row) -> Iterable[str]:
    """Sentences, each from numbers that were measured."""
    best = {
        row["what"]: row
        for row in sorted(done(rows, platform="gpu", precision="float64"), key=lambda r: r["rate"])
    }
    if not best:
        yield "**This result has no rows of a GPU**: it is the short form, on a CPU.\n"
        return
    both = "table of Maw, Barber and Fawcett", "spring and slider"
    said = [
        of_runs("Impacts in float64", ("exact", "event", "event, with a push"), best, rows, True),
        of_runs("Oblique impacts with friction, ψ2(ψ1)", both, best, rows, True),
        of_runs("Scenes of three discs and a plane", ("instantaneous", "soft"), best, rows),
        of_runs("Mechanisms", MECHANISMS, best, rows),
        of_first_calls(rows),
    ]
    yield from (f"- {sentence}\n" for sentence in said if sentence)
    if failures := sum("failed" in row for row in rows):
        yield f"- {failures} of {len(rows)} rows failed or did not start; they state why.\n"


def of_runs(
    title: str,
    names: tuple[str, ...],
    best: dict[str, Row],
    rows: list[Row],
    errors: bool = False,
) -> str:
    told = [
        f"{what} {count(row['rate'])} a second{times_cpu(row, rows)}"
        + (f", error {row['error']:.0e}" if errors else "")
        for what in names
        if (row := best.get(what))
    ]
    return f"{title}: {'; '.join(told)}." if told else ""


def of_first_calls(rows: list[Row]) -> str:
    spent = {
        name: [row["first_s"] for row in rows if row["group"] == "first calls"
               and row["platform"] == name and "first_s" in row]
        for name in ("gpu", "cpu")
    }  # fmt: skip
    if not all(spent.values()):
        return ""
    between = {name: f"{min(all):.2g} to {max(all):.2g} s" for name, all in spent.items()}
    pays = min(
        (r["size"] for r in done(rows, platform="gpu", what="event", precision="float64")
         if (times := ratio(r, rows)) is not None and times > 1),
        default=None,
    )  # fmt: skip
    after = f" Event solves gain from {pays:,} lanes on." if pays else ""
    return f"First calls take {between['gpu']} on the GPU and {between['cpu']} on the CPU.{after}"


def done(rows: list[Row], **asked: Any) -> list[Row]:
    """The rows with a rate and with these entries."""
    return [
        row
        for row in rows
        if "rate" in row and all(row.get(name) == value for name, value in asked.items())
    ]


def ratio(row: Row, rows: list[Row]) -> float | None:
    """The rate of a row over the best rate of the CPU."""
    alike = {name: row[name] for name in ("group", "what", "precision")}
    known = [other["rate"] for other in done(rows, platform="cpu", **alike)]
    return row["rate"] / max(known) if known and "rate" in row else None


def times_cpu(row: Row, rows: list[Row]) -> str:
    times = ratio(row, rows)
    # Two digits, never as a power of ten.
    return "" if times is None else f" ({float(format(times, '.2g')):.3g} times the CPU)"


def count(x: float) -> str:
    """A rate in words."""
    for size, word in ((1e9, "billion"), (1e6, "million")):
        if x >= size:
            return f"{x / size:.3g} {word}"
    return f"{x:,.0f}" if x >= 100 else f"{x:.2g}"


def table(rows: list[Row]) -> str:
    """The rows of a group, those of a CPU below those of the GPU."""
    unit = rows[0]["unit"]
    head = ["what", unit, "precision", "device", "time", f"{unit}/s", "× CPU", "error", "compile"]
    return lines([*head, "cores"], [cells(row, rows) for row in rows]) + "\n"


def cells(row: Row, rows: list[Row]) -> list[str]:
    start = [row["what"], f"{row['size']:,}", row["precision"], row["platform"].upper()]
    if "seconds" not in row:
        return [*start, escaped(row.get("failed", "")), *[""] * 5]
    times = ratio(row, rows) if row["platform"] == "gpu" else None
    compiling = row["trace_s"] + row["compile_s"] if "compile_s" in row else row["first_s"]
    return [
        *start,
        duration(row["seconds"]),
        count(row["rate"]),
        "" if times is None else f"{times:.3g}",
        error(row),
        f"{compiling:.2g} s",
        f"{row['cores']:.1f}" if row["platform"] == "cpu" else "",
    ]


def error(row: Row) -> str:
    if "failed" in row:
        return escaped(row["failed"])
    found = row.get("error", row.get("from_cpu"))
    return "" if found is None else f"{found:.0e}"


def escaped(words: str) -> str:
    """Words of an error, which may hold anything."""
    return "`" + words[:100].replace("|", "/").replace("`", "'") + "`"


def first_table(rows: list[Row]) -> str:
    """A line for each call."""

    def of(what: str, platform: str) -> str:
        found = [row for row in rows if row["what"] == what and row["platform"] == platform]
        if not found:
            return ""
        return (
            f"{found[0]['first_s']:.2g} s" if "first_s" in found[0] else escaped(found[0]["failed"])
        )

    calls = dict.fromkeys(row["what"] for row in rows)
    found = [[call, of(call, "gpu"), of(call, "cpu")] for call in calls]
    return lines(["call", "GPU", "CPU"], found) + "\n"


def duration(seconds: float) -> str:
    for unit, size in (("s", 1.0), ("ms", 1e-3)):
        if seconds >= size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds / 1e-6:.3g} µs"


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
