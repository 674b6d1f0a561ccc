"""When to use which method: the fastest in each case, counted from the rows."""

from __future__ import annotations

import itertools

from .reading import FAMILIES, Row, batches_of, busy, cheapest, number, problems_of, some
from .sections import SECTIONS, Section

ERRORS = (1e-3, 1e-6, 1e-9, 1e-12)
_ALWAYS = """\
What no time shows:

- Only the package flags a lane that is not right, and gives derivatives without a line of the
  user's. SciPy compiles nothing: with a handful of impacts, once, it is done before JAX has
  compiled.
- A kernel in numba has to be written, with its step control, its end and its derivatives, for every
  kind of motion. Where one motion is solved again and again, one at a time, it is worth that.
- Machines, joints, robots, heaps with friction: an engine is the tool, Exudyn where a contact must
  be right (its law is one of this package's, and its explicit steps are the cheapest here), Drake's
  continuous integrators where the error must be controlled. Thousands of grains: LAMMPS. Thousands
  of robots on an accelerator: MJX. What the package has for their users are the numbers by which
  their contacts rebound as they should (`jc.export`).
- Hard discs in a plane, to look at: billiards.
"""


def when_to_use_what(measured: dict[str, list[Row]]) -> str:
    """A table and sentences for every group that has rows."""
    parts = [_verdict(section, measured[section.group]) for section in SECTIONS]
    return "\n".join(["## When to use what\n", *filter(None, parts), _ALWAYS])


def _verdict(section: Section, rows: list[Row]) -> str:
    if not rows:
        return ""
    problems = problems_of(rows)
    head = [section.batch.rstrip(":"), "error", *(section.titles[p] for p in problems)]
    lines = [
        f"**{section.title}**: the fastest within an error, and how many times as long the package "
        "takes, or, where it is the fastest, the next one.",
        "",
        "| " + " | ".join(head) + " |",
        "|" + "---|" * len(head),
    ]
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
        lines.append("| " + " | ".join([f"{batch:,}", f"{error:g}", *cells]) + " |")
    if sum(map(busy, rows)) > len(rows) / 2:
        lines += ["", "Measured in turn on a busy machine: ratios are good to a factor of some."]
    if any("†" in line for line in lines):
        lines += [
            "",
            "† One of the two was measured on a busy machine: it is faster than it seems.",
        ]
    return "\n".join([*lines, "", *_sentences(ratios), ""])


def fastest(rows: list[Row], error: float) -> dict[str, Row]:
    """The cheapest row of every family within an error, fastest first."""
    families = {
        family: row
        for family in FAMILIES
        if (row := cheapest(some(rows, family=family), error)) is not None
    }
    return dict(sorted(families.items(), key=lambda pair: pair[1]["cost"]))


def _against(found: dict[str, Row]) -> tuple[str, str]:
    """The fastest family, and whom it is told beside: the package, or the next one."""
    first, second = list(found)[:2]
    return first, second if first == "ours" else "ours"


def _unequal(found: dict[str, Row]) -> bool:
    """Whether of the two that are compared one alone was measured on a busy machine."""
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
    """For every family where it is the fastest of those that reach the error, and by how much."""
    lines = []
    for family in (family for family in FAMILIES if family in ratios):
        than = "the next one" if family == "ours" else FAMILIES["ours"]
        where = "; ".join(f"{name} {_span(times)}" for name, times in ratios[family].items())
        lines.append(
            f"- {FAMILIES[family]} is the better choice (how many times as fast as {than}): "
            f"{where}."
        )
    return lines


def _span(times: list[float]) -> str:
    low, high = number(min(times)), number(max(times))
    return f"({low})" if low == high else f"({low} to {high})"
