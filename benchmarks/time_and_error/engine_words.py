"""The error of each engine's law and of its steps, for the page."""

from __future__ import annotations

from typing import Any

from .engines import WAYS
from .reading import Row, some, ways_of
from .rebounds import ASKED, converged
from .way import Way


def _keywords(way: Way) -> dict[str, Any]:
    return getattr(way.build, "keywords", {})


_ENGINE = {way.name: way.build.keywords["engine"] for way in WAYS if "engine" in _keywords(way)}


def law_and_step(rows: list[Row]) -> list[str]:
    """A table: what the law misses without steps, and what the steps add, from coarse to fine."""
    asked = ", ".join(f"{e:g}" for e in ASKED)
    lines = [
        "**Error of the law, and of the step**",
        "",
        f"| engine | what becomes of e = {asked} without steps, as its documents say "
        "| the same, numbers by jaxcontact: relative error | relative error of the step |",
        "|---|---|---|---|",
    ]
    for way in ways_of(some(rows, family="engines")):
        here = [row for row in some(rows, way=way) if "error" in row]
        if here:
            engine = _ENGINE[way]
            becomes = ", ".join(f"{converged(engine, e, False):.3g}" for e in ASKED)
            lines.append("| " + " | ".join([way, becomes, _law(here), _steps(here)]) + " |")
    return [*lines, ""]


def _law(rows: list[Row]) -> str:
    laws = [row["error_law"] for row in some(rows, problem="exported")]
    return _error(max(laws)) if laws else "–"


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
