"""docs/stability.md and its pictures, from the results."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from .pictures import NAMES, draw_free, draw_peers, draw_pushed
from .verdict import CLASSES

DOCS = Path(__file__).parents[2] / "docs"
_MARK = "<!-- results: made by benchmarks/stability.py --page -->"


def write(known: dict[str, Any], peers: dict[str, Any], slopes: dict[str, Any]) -> None:
    """The pictures, and the part of the page below the mark; the words above it are kept."""
    for precision in ("float64", "float32"):
        draw_pushed(known, DOCS / f"stability_pushed_{precision}.png", precision)
        draw_free(known, DOCS / f"stability_free_{precision}.png", precision)
    draw_peers(peers, DOCS / "stability_peers.png")
    page = DOCS / "stability.md"
    above = page.read_text().split(_MARK)[0] if page.exists() else "# The stability map\n\n"
    page.write_text(
        above + _MARK + "\n\n" + "\n".join((tables(known), slope_table(slopes), peer_table(peers)))
    )


def tables(known: dict[str, Any]) -> str:
    lines = [
        "## Counts",
        "",
        "| kind | motion | method | precision | lanes | " + " | ".join(CLASSES) + " |",
    ]
    lines.append("|" + "---|" * (5 + len(CLASSES)))
    groups: dict[tuple[str, ...], list[dict[str, Any]]] = {}
    for name, job in known.items():
        kind, _, motion, method, precision = name.split("/")
        groups.setdefault((kind, motion, method, precision), []).append(job)
    sums = dict.fromkeys(CLASSES, 0)
    for (kind, *rest), jobs in groups.items():
        counts = {c: sum(job["counts"][c] for job in jobs) for c in CLASSES}
        sums = {c: sums[c] + counts[c] for c in CLASSES}
        cells = [NAMES[kind], *rest, f"{sum(job['lanes'] for job in jobs):,}"]
        lines.append("| " + " | ".join([*cells, *(f"{counts[c]:,}" for c in CLASSES)]) + " |")
    total = sum(sums.values())
    cells = ["all", "", "", "", f"{total:,}", *(f"{sums[c]:,}" for c in CLASSES)]
    lines += ["| " + " | ".join(cells) + " |", ""]
    lines += [
        "## Worst lanes",
        "",
        "The largest misses of every job, in units of what is allowed.",
        "",
    ]
    lines.append("| job | class | damping | n | push | true e | quantity | times allowed |")
    lines.append("|" + "---|" * 8)
    for name, job in known.items():
        for klass, worst in job["worst"].items():
            for lane in worst[:1]:
                values = [lane["damping"], lane["n"], lane["push"], lane["true e"]]
                numbers = " | ".join(f"{v:.3g}" for v in values)
                lines.append(
                    f"| {name} | {klass} | {numbers} | {lane['worst']} | {lane['times allowed']} |"
                )
    return "\n".join(lines) + "\n"


def slope_table(slopes: dict[str, Any]) -> str:
    """First derivatives of restitution and duration."""
    lines = [
        "## First derivatives",
        "",
        "| job | lanes | right | flagged | wrong | median error | worst |",
    ]
    lines.append("|" + "---|" * 7)
    for name, job in slopes.items():
        worst = job["worst"][0]["times allowed"] if job["worst"] else ""
        counts = [job[k] for k in ("lanes", "right", "flagged", "wrong")]
        lines.append(
            f"| {name} | " + " | ".join(map(str, [*counts, job["median error"], worst])) + " |"
        )
    return "\n".join(lines) + "\n"


def peer_table(peers: dict[str, Any]) -> str:
    """What users would write instead."""
    if not peers:
        return ""
    names = list(next(iter(peers.values()))["counts"])
    lines = [
        "## What users would write instead",
        "",
        "| force and way | " + " | ".join(names) + " |",
    ]
    lines.append("|" + "---|" * (1 + len(names)))
    for name, way in peers.items():
        lines.append(f"| {name} | " + " | ".join(str(way["counts"][n]) for n in names) + " |")
    lines += ["", "![Errors of scipy and of plain diffrax](stability_peers.png)"]
    return "\n".join(lines) + "\n"
