"""When to use what: who is fastest where, counted from the rows."""

from __future__ import annotations

from .reading import FAMILIES, Row, batches_of, cheapest, problems_of, some
from .sections import SECTIONS

ERRORS = (1e-3, 1e-6, 1e-9, 1e-12)


def fastest(rows: list[Row], error: float) -> dict[str, Row]:
    """The cheapest row of every family within an error, fastest first."""
    families = {
        family: row
        for family in FAMILIES
        if (row := cheapest(some(rows, family=family), error)) is not None
    }
    return dict(sorted(families.items(), key=lambda pair: pair[1]["cost"]))


def when_to_use_what(measured: dict[str, list[Row]]) -> str:
    lines = ["## When to use what", ""]
    for section in SECTIONS:
        rows = measured[section.group]
        if not rows:
            continue
        lines += [f"**{section.title}**: the fastest within an error, and how many times as long"]
        lines += ["the package (or, where it is the fastest, the next one) takes.", ""]
        batches, problems = batches_of(rows), problems_of(rows)
        head = ["batch", "error", *(section.titles[p] for p in problems)]
        lines += ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
        won: dict[str, list[str]] = {}
        for batch in batches:
            for error in ERRORS:
                cells = []
                for problem in problems:
                    found = fastest(some(rows, batch=batch, problem=problem), error)
                    cells.append(_cell(found))
                    if found:
                        where = f"{section.titles[problem]}, batch {batch:,}, {error:g}"
                        won.setdefault(next(iter(found)), []).append(where)
                lines.append("| " + " | ".join([f"{batch:,}", f"{error:g}", *cells]) + " |")
        lines += ["", *_sentences(won, len(batches) * len(ERRORS) * len(problems)), ""]
    lines += _ALWAYS
    return "\n".join(lines) + "\n"


def _cell(found: dict[str, Row]) -> str:
    if not found:
        return "none"
    first, *rest = found
    best = found[first]["cost"]
    other = rest[0] if first == "ours" and rest else "ours"
    told = found[first]["way"]
    if other not in found or other == first:
        return f"{told}; no other" if first == "ours" else f"{told}; jaxcontact does not reach it"
    name = FAMILIES[other] if first != "ours" else found[other]["way"]
    return f"{told}; {name} × {found[other]['cost'] / best:.2g}"


def _sentences(won: dict[str, list[str]], cells: int) -> list[str]:
    return [
        f"- {FAMILIES[family]} is the fastest in {len(where)} of {cells} cells."
        for family, where in sorted(won.items(), key=lambda pair: -len(pair[1]))
    ]


_ALWAYS = [
    "What no time shows: only the package flags a lane that is not right, and gives derivatives",
    "without a line of the user's; SciPy needs no compiler; numba's kernel has to be written, with",
    "its step control, its end and its derivatives, for every kind of motion.",
]
