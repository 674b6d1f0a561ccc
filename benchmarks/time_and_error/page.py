"""docs/run_time_error.md and its figures, from the rows; all numbers are generated."""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import Any

from benchmarks.oblique_impacts.page import section as oblique_section
from benchmarks.study import HERE
from benchmarks.study import lines as table
from benchmarks.time_and_error.impacts import BATCHES
from benchmarks.time_and_error.pictures import draw as draw_rows
from benchmarks.time_and_error.reading import (
    FAMILIES,
    QUIET,
    Row,
    batches_of,
    busy,
    cheapest,
    closest,
    number,
    problems_of,
    some,
    ways_of,
)
from benchmarks.time_and_error.running import GOOD
from benchmarks.time_and_error.sections import SECTIONS, Section

ERRORS = (1e-3, 1e-6, 1e-9, 1e-12)
_ALWAYS = """\
**Other criteria**

- Only **jaxcontact** flags wrong lanes and gives derivatives without user code.
- **SciPy** does not compile. For a few impacts, once, it finishes before JAX has compiled.
- **numba** needs a kernel with step control, end and derivatives for every kind of motion. It is
  worth that if one motion is solved again and again, one at a time.
- **Engines** are for machines, joints, robots, and heaps with friction. Use Exudyn if a contact
  must be right: its law is one of this package's, and its explicit steps are the cheapest here. Use
  Drake's continuous integrators if the error must be controlled, LAMMPS for thousands of grains,
  and MJX for thousands of robots on an accelerator. `jc.export` gives the parameters with which
  their contacts rebound at the right e.
- **billiards** is for watching hard discs in a plane.
"""


def when_to_use_what(measured: dict[str, list[Row]]) -> str:
    """Return a table and sentences for every group that has rows."""
    parts = [_verdict(section, measured[section.group]) for section in SECTIONS]
    return "\n".join(["## When to use what\n", *filter(None, parts), _ALWAYS])


def _verdict(section: Section, rows: list[Row]) -> str:
    if not rows:
        return ""
    problems = problems_of(rows)
    head = [section.batch.rstrip(":"), "error", *(section.titles[p] for p in problems)]
    every = []
    ratios: dict[str, dict[str, list[float]]] = {}
    for batch, error in itertools.product(batches_of(rows), ERRORS):
        cells = []
        for problem in problems:
            here = some(rows, batch=batch, problem=problem)
            found = fastest(here, error)
            cells.append(_first_of(found) if here else "")
            if len(found) > 1 and "ours" in found and not _unequal(found):
                where = section.titles[problem]
                if len(batches_of(some(rows, problem=problem))) > 1:
                    where += f", {section.batch} {batch:,}"
                first, other = _against(found)
                times = found[other]["cost"] / found[first]["cost"]
                ratios.setdefault(first, {}).setdefault(where, []).append(times)
        every.append([f"{batch:,}", f"{error:g}", *cells])
    shown = table(head, every, "---")
    lines = [
        '<details markdown="1"><summary>Fastest method for each error, and the time ratio of '
        "jaxcontact (or of the next one)</summary>",
        "",
        shown,
    ]
    if sum(map(busy, rows)) > len(rows) / 2:
        lines += ["", "Measured on a busy machine: ratios are uncertain by a factor of several."]
    if "†" in shown:
        lines += [
            "",
            "† One of the two was measured on a busy machine and is faster than shown.",
        ]
    lines += ["", "</details>", ""]
    return "\n".join([f"**{section.title}**", "", *_sentences(ratios), "", *lines])


def fastest(rows: list[Row], error: float) -> dict[str, Row]:
    """Return the cheapest row of every family within an error, fastest first."""
    families = {
        family: row
        for family in FAMILIES
        if (row := cheapest(some(rows, family=family), error)) is not None
    }
    return dict(sorted(families.items(), key=lambda pair: pair[1]["cost"]))


def _against(found: dict[str, Row]) -> tuple[str, str]:
    """Return the fastest family and the one it is compared with: the package, or the next one."""
    first, second = list(found)[:2]
    return first, second if first == "ours" else "ours"


def _unequal(found: dict[str, Row]) -> bool:
    """Return whether only one of the two compared was measured on a busy machine."""
    first, other = _against(found)
    return busy(found[first]) != busy(found[other])


def _first_of(found: dict[str, Row]) -> str:
    if not found:
        return "none"
    told = next(iter(found.values()))["way"]
    if "ours" not in found:
        return f"{told}; jaxcontact does not reach it"
    if len(found) == 1:
        return f"{told}; no other"
    first, other = _against(found)
    name = found[other]["way"] if first == "ours" else FAMILIES["ours"]
    ratio = number(found[other]["cost"] / found[first]["cost"])
    return f"{told}; {name} × {ratio}{' †' if _unequal(found) else ''}"


def _sentences(ratios: dict[str, dict[str, list[float]]]) -> list[str]:
    """Return for every family where it is the fastest that reaches the error, and by how much."""
    lines = []
    for family in (family for family in FAMILIES if family in ratios):
        than = "the next one" if family == "ours" else FAMILIES["ours"]
        where = "; ".join(f"{name} {_span(times)}" for name, times in ratios[family].items())
        lines.append(f"- **{FAMILIES[family]}** is fastest (speed ratio to {than}): {where}.")
    return lines


def _span(times: list[float]) -> str:
    low, high = number(min(times)), number(max(times))
    return f"({low})" if low == high else f"({low} to {high})"


_HEAD = """\
# Run time against error

Lower and further to the left is better; compare ratios. [The terms](#reading-the-tables) are below.

![Run time against error of one in 100,000 impacts](run_time_error.png)
"""
_TERMS = """\
## Reading the tables

Page made by `python -m benchmarks run_time_error` from
[run_time_error.json](../benchmarks/run_time_error.json). {machine}

- **Times** are the best of several calls, in float64, on all cores that a method can use. Compile
  time has its own column: the first call less the best, the largest of a group.
- **Errors** are relative, and the worst over the lanes whose truth is known to 40 digits
  (`tests/oracle`).
- **Memory** is the peak that a call adds to the process, by Linux's count. It is measured for the
  number of lanes in the last column, the largest of a ladder.
- **Cells** have a time for every error asked for. Brackets hold the smallest error of a method that
  does not reach the last ones, and its time. A dash means not available; the reason stands below.
"""


FIRST = ("hunt_crossley", "own")


def _group(known: dict[str, Any], name: str) -> list[Row]:
    return some(known["rows"].values(), group=name)


def written(known: dict[str, Any]) -> str:
    measured = {s.group: _group(known, s.group) for s in SECTIONS}
    terms = _TERMS.format(machine=_machine(known["machine"]))
    parts = [_HEAD, when_to_use_what(measured), terms]
    for section in SECTIONS:
        rows = measured[section.group]
        if rows:
            parts.append(_section(section, rows, _group(known, section.options)))
        else:
            parts.append(f"## {section.title}\n\nNot measured yet.\n")
    for name, section_of in (("systems", _mechanisms), ("oblique", oblique_section)):
        parts.append("\n".join(section_of(json.loads((HERE / f"{name}.json").read_text()))))
    return "\n".join(parts)


def draw(known: dict[str, Any], docs: Path) -> None:
    """A figure for every group that has rows, and the diagram of the README: a law with a formula
    and one without, in the largest batch.
    """
    titles: dict[str, str] = {}
    for section in SECTIONS:
        titles |= section.titles
        if rows := _group(known, section.group):
            path = docs / _picture(section)
            draw_rows(rows, section.titles, path, section.unit, section.title, section.batch)
    batch = some(_group(known, "impacts"), batch=BATCHES[-1])
    if rows := [row for name in FIRST for row in some(batch, problem=name)]:
        head = f"One of {BATCHES[-1]:,} impacts"
        draw_rows(rows, titles, docs / "run_time_error.png", "µs an impact", head)


def _picture(section: Section) -> str:
    return f"run_time_error_{section.group}.png"


def _mechanisms(measured: dict[str, Any]) -> list[str]:
    """The rows of `benchmarks/systems.py`, of a run of its own."""
    rows = [
        {"way": row["method"], "problem": row["problem"], "cost": row["ms"], "error": row["error"]}
        for row in measured["rows"]
        if "ms" in row
    ]
    problems = problems_of(rows)
    cells = []
    for way in ways_of(rows):
        ours = [some(rows, way=way, problem=problem) for problem in problems]
        cells.append([way, *(_cell(each, (1e-6, 1e-9, 1e-12)) for each in ours)])
    heads = ["way: ms within an error of 1e-6 / 1e-9 / 1e-12", *problems]
    return [
        "## Mechanisms",
        "",
        "The time until the fifth touch of a double pendulum beside a wall and of a slider-crank",
        "with clearance, in ms without compilation. The error is that of the time of that touch,",
        "relative to the duration. All methods are of one run of `benchmarks/systems.py`; numba is",
        "written by hand for each mechanism. [Mechanisms](systems.md) has ratios and derivatives.",
        "",
        table(heads, cells, "---"),
        "",
    ]


def _machine(known: dict[str, Any]) -> str:
    libraries = ", ".join(
        f"{k} {known[k]}"
        for k in ("python", "numpy", "scipy", "jax", "diffrax", "numba", "lmfit")
        if known[k]
    )
    there = known.get("engines", {})
    libraries += "".join(f", {k} {v}" for k, v in there.items() if v)
    return (
        f"{known['processor']}, {known['cores']} cores, {known['memory_gib']} GiB, "
        f"{known['system']}; {libraries}; commit {known['commit']}, seed {known['seed']}."
    )


def _section(section: Section, rows: list[Row], options: list[Row]) -> str:
    lines = [
        f"## {section.title}",
        "",
        section.words,
        "",
        f"![{section.title}]({_picture(section)})",
        "",
    ]
    caption = _caption(section, rows, options)
    lines += [_busy(rows), ""]
    lines += _folded("Options of each method", [caption]) if caption else []
    asked = " / ".join(f"{error:g}" for error in section.errors)
    for batch in batches_of(rows):
        here = some(rows, batch=batch)
        what = f"{section.unit}, within an error of {asked}"
        several = f"{section.batch} {batch:,}: " if len(batches_of(rows)) > 1 else "time: "
        lines += _folded(_capital(several + what), [_table(section, here, [*rows, *options])])
    lines += section.more(rows)
    reasons = _reasons(section, rows)
    if reasons:
        lines += ["Not available:", "", *reasons, ""]
    missing = _missing(section, rows)
    if missing:
        lines += [f"Not measured yet: {'; '.join(missing)}.", ""]
    return "\n".join(lines)


def _folded(title: str, lines: list[str]) -> list[str]:
    """Return lines that the page shows on a click."""
    head = f'<details markdown="1"><summary>{title}</summary>'
    return [head, "", *lines, "", "</details>", ""]


def _busy(rows: list[Row]) -> str:
    """Return the load of the machine while a group was measured, and its effect."""
    times = [row for row in rows if "cost" in row]
    loads = sorted(row["load"] for row in times if row.get("load") is not None)
    told = []
    if loads:
        middle = loads[len(loads) // 2]
        told.append(
            f"Load average while {len(loads)} rows were measured: {loads[0]:g} to {loads[-1]:g}, "
            f"median {middle:g}, on the cores named above; this run alone makes 1 to 2."
        )
        if middle > QUIET:
            told.append(
                "**The machine was busy with other work**: the best of several calls that take "
                "less than some milliseconds is still right. Longer calls were interrupted and may "
                "be several times too long. Errors are not affected. "
                f"`--busiest {QUIET:g}` measures such rows again."
            )
    return " ".join(told)


def _missing(section: Section, rows: list[Row]) -> list[str]:
    """Return the methods that lack a row for some problem."""
    found = []
    for way in section.ways:
        there = problems_of(some(rows, way=way))
        absent = [title for problem, title in section.titles.items() if problem not in there]
        where = "" if len(absent) == len(section.titles) else f" ({', '.join(absent)})"
        found += [way + where] if absent else []
    return found


def _capital(words: str) -> str:
    return words[0].upper() + words[1:]


def _caption(section: Section, rows: list[Row], options: list[Row]) -> str:
    """Return the options of each peer, and what the other options cost."""
    told = []
    for way in ways_of(rows):
        used = {row["options"] for row in some(rows, way=way)} - {""}
        if not used:
            continue
        variants = list(dict.fromkeys(row["options"] for row in some(options, way=way)))
        others = []
        for variant in variants:
            others.append(f"{variant} {_reached(some(options, way=way, options=variant))}")
        unit = section.unit.split()[0]
        among = f" ({unit} at an error of {GOOD:g}: {'; '.join(others)})" if len(others) > 1 else ""
        told.append(f"{way}: {', '.join(sorted(used))}{among}")
    if not told:
        return ""
    chosen = "\n".join(f"- {words}" for words in told)
    return f"Options were chosen by a sweep ({section.swept}).\n\n{chosen}"


def _reached(rows: list[Row]) -> str:
    """Return the time to a good error; if none is that good, the least error and its time."""
    good, best = cheapest(rows, GOOD), closest(rows)
    if good:
        return number(good["cost"])
    return f"{number(best['cost'])} at {best['error']:.0e}" if best else "failed"


def _table(section: Section, rows: list[Row], everywhere: list[Row]) -> str:
    """Return a line per method; a cell has the time for every error asked for."""
    problems = problems_of(rows)
    cells = []
    for way in ways_of(rows):
        ours = some(rows, way=way)
        times = [_cell(some(ours, problem=p), section.errors) for p in problems]
        cells.append([way, *times, *_costs(ours, some(everywhere, way=way))])
    names = [section.titles[p] for p in problems]
    return table(["way", *names, "compile/s", "peak/MiB", "measured"], cells, "---")


def _cell(rows: list[Row], errors: tuple[float, ...]) -> str:
    """Return times; in brackets, once, the least error if it exceeds what is asked for."""
    best = closest(rows)
    if best is None:
        return "–"
    found = [cheapest(rows, error) for error in errors]
    words = [number(row["cost"]) for row in found if row]
    if len(words) < len(errors):
        words.append(f"({best['error']:.0e}: {number(best['cost'])})")
    return " / ".join(words)


def _costs(rows: list[Row], everywhere: list[Row]) -> list[str]:
    """Compile time, memory and lanes of a way.

    Compile time from wherever it was: numba's code of one batch serves the next.
    """
    compiles = [row["compile_s"] for row in everywhere if "compile_s" in row]
    peaks = [row["peak_mib"] for row in rows if row.get("peak_mib") is not None]
    lanes = max(row["measured"] for row in rows)
    return [
        f"{max(compiles):.1f}" if compiles else "–",
        f"{max(peaks):.1f}" if peaks else "–",
        f"{lanes:,}",
    ]


def _reasons(section: Section, rows: list[Row]) -> list[str]:
    """Why rows are missing, each reason once."""
    found: dict[tuple[str, str], dict[str, Any]] = {}
    for row in rows:
        if "reason" in row:
            where = found.setdefault((row["way"], row["reason"]), {})
            where.setdefault(section.titles[row["problem"]], set()).add(row["setting"])
    lines = []
    for (way, reason), where in found.items():
        settings = {s for settings in where.values() for s in settings}
        # A method without settings is placed at 0.
        whole = settings >= {row["setting"] for row in some(rows, way=way)} or settings == {0.0}
        at = "" if whole else f" at {', '.join(f'{s:g}' for s in sorted(settings))}"
        lines.append(f"- {way}, {', '.join(where)}{at}: {reason}")
    return lines
