"""When to use which method: the fastest in each case, counted from the rows."""

from __future__ import annotations

import itertools

from ..study import lines as table
from .reading import FAMILIES, Row, batches_of, busy, cheapest, number, problems_of, some
from .sections import SECTIONS, Section

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
            cells.append(_cell(found) if here else "")
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


def _cell(found: dict[str, Row]) -> str:
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
