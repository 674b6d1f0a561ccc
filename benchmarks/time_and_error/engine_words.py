"""The error of each engine's law beside that of its steps, for the page."""

from __future__ import annotations

from .reading import Row, some, ways_of


def law_and_step(rows: list[Row]) -> list[str]:
    """A table: what the law misses without steps, and what the steps add, from coarse to fine."""
    lines = [
        "**Error of the law, and of the step**",
        "",
        "| engine | law, as its documents say | law, numbers by jaxcontact | step |",
        "|---|---|---|---|",
    ]
    for way in ways_of(some(rows, family="engines")):
        here = [row for row in some(rows, way=way) if "error" in row]
        if not here:
            continue
        laws = [
            max((row["error_law"] for row in some(here, problem=name)), default=None)
            for name in ("asked", "exported")
        ]
        told = [_error(law) if law is not None else "–" for law in laws]
        lines.append("| " + " | ".join([way, *told, _steps(here)]) + " |")
    return [*lines, ""]


def _steps(rows: list[Row]) -> str:
    """The worst at every setting; tolerances fall, steps a contact grow."""
    worst: dict[float, float] = {}
    for row in rows:
        worst[row["setting"]] = max(worst.get(row["setting"], 0.0), row["error_step"])
    falls = max(worst) < 1
    return ", ".join(f"{s:g}: {_error(worst[s])}" for s in sorted(worst, reverse=falls))


def _error(x: float) -> str:
    """What is below the reference's own error is not told."""
    return f"{x:.0e}" if x >= 1e-9 else "below 1e-9"
