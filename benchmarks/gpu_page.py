"""The page docs/gpu.md, from the rows of benchmarks/gpu.py."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from benchmarks.study import lines

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
