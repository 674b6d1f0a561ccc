"""The tables of docs/stability_tables.md and the pictures of the stability map, from the results.

In a picture colour is the decade of the largest error; hatched: flagged.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import BoundaryNorm

from ..study import lines
from .collocation import Array
from .verdict import CLASSES, DAMPING_EDGES, FLAGGED_WITHOUT_NEED, WRONG

DECADES = np.arange(-16, 2)
NAMES = {
    "hunt_crossley": "Hunt-Crossley",
    "hunt_crossley_tension": "Hunt-Crossley, tension",
    "kuwabara_kono": "Kuwabara-Kono",
    "kuwabara_kono_clamped": "Kuwabara-Kono, clamped",
    "oscillator": "oscillator laws",
    "oscillator_clamped": "oscillator laws, clamped",
    "oscillator_approach": "Jankowski",
}


def pooled(jobs: Iterable[dict[str, Any]]) -> tuple[Array, Array, Array]:
    """The largest decade, flagged lanes and all lanes of several jobs, cell by cell."""
    jobs = list(jobs)
    decade = np.max([np.array(job["decade"]) for job in jobs], axis=0)
    flags = np.sum([np.array(job["flags"]) for job in jobs], axis=0)
    total = np.sum([np.array(job["total"]) for job in jobs], axis=0)
    return decade, flags, total


def _select(known: dict[str, Any], *parts: str) -> list[dict[str, Any]]:
    return [job for name, job in known.items() if all(part in name.split("/") for part in parts)]


def panel(
    ax: Any, decade: Array, flags: Array, total: Array, title: str, ticks: Iterable[str]
) -> Any:
    colours = plt.get_cmap("viridis_r").copy()
    colours.set_bad("0.9")
    shown = np.ma.masked_where((decade < -90) | (total == 0), np.clip(decade, -16, 0))
    image = ax.imshow(
        shown, origin="lower", aspect="auto", cmap=colours, norm=BoundaryNorm(DECADES, 256)
    )
    share = flags / np.maximum(total, 1)
    for row, column in zip(*np.nonzero(share > 0), strict=True):
        dense = 4 if share[row, column] > 0.5 else 2
        box = (column - 0.5, row - 0.5)
        ax.add_patch(plt.Rectangle(box, 1, 1, fill=False, lw=0, hatch="/" * dense, ec="tab:red"))
    ax.set_title(title, fontsize=8)
    ticks = list(ticks)
    ax.set_xticks(range(len(ticks)), ticks, fontsize=7)
    rows = [0, *range(2, DAMPING_EDGES.size + 1, 3)]
    words = ["0" if r == 0 else f"$10^{{{int(DAMPING_EDGES[r - 1])}}}$" for r in rows]
    ax.set_yticks(rows, words, fontsize=7)
    return image


def draw_pushed(known: dict[str, Any], path: Path, precision: str) -> None:
    """One panel a kind: damping against push, all exponents together, by event."""
    fig, axes = plt.subplots(2, 4, figsize=(9.8, 5.4), layout="constrained")
    ticks = ["-1e4", "", "", "-1e-6", "", "", "0", "", "1e-6", "", "", "1e4"]
    image = None
    for ax, (kind, name) in zip(axes.flat, NAMES.items(), strict=False):
        jobs = _select(known, kind, "pushed", precision)
        if jobs:
            decade, flags, total = pooled(jobs)
            words = ticks if decade.shape[1] == len(ticks) else _push_words(decade.shape[1])
            image = panel(ax, decade, flags, total, name, words)
            ax.set_xlabel("push Γ", fontsize=8)
            ax.set_ylabel("damping", fontsize=8)
    _finish(fig, axes, image, path, f"method event, {precision}")


def _push_words(count: int) -> list[str]:
    middle = count // 2
    return [{0: "-1e4", middle: "±0", count - 1: "1e4"}.get(k, "") for k in range(count)]


def draw_free(known: dict[str, Any], path: Path, precision: str) -> None:
    """One panel a kind and method: damping against exponent, free impacts."""
    kinds = [kind for kind in NAMES if kind != "hunt_crossley_tension"]
    methods = ("exact", "event", "phase")
    fig, axes = plt.subplots(3, len(kinds), figsize=(9.5, 6.6), layout="constrained", squeeze=False)
    image = None
    for row, method in zip(axes, methods, strict=True):
        row[0].set_ylabel("damping", fontsize=8)
        for ax, kind in zip(row, kinds, strict=True):
            columns = []
            for n in ("n=1", "n=1.5", "n=2", "n=3", "n=traced"):
                jobs = _select(known, kind, "free", method, precision, n)
                parts = (
                    [a.max(1) if k == 0 else a.sum(1) for k, a in enumerate(pooled(jobs))]
                    if jobs
                    else None
                )
                columns.append(parts)
            if not any(columns):
                continue
            size = next(c for c in columns if c)[0].size
            blank = [np.full(size, -99), np.zeros(size, int), np.zeros(size, int)]
            stacked = [np.stack([(c or blank)[k] for c in columns], 1) for k in range(3)]
            title = f"{NAMES[kind]}\n{method}"
            image = panel(ax, *stacked, title, ("1", "3/2", "2", "3", "any"))
            ax.set_xlabel("exponent n", fontsize=8)
    _finish(fig, axes, image, path, f"free impacts, {precision}")


def draw_peers(known: dict[str, Any], path: Path) -> None:
    """One panel a way, a row for every force: damping against push."""
    rows: dict[str, dict[str, dict[str, Any]]] = {}
    for name, result in known.items():
        kind, way = name.split("/", 1)
        rows.setdefault(kind, {})[f"{way}\n{NAMES[kind]}"] = result
    across = max(len(ways) for ways in rows.values())
    size = 1.6 * across, 2.7 * len(rows)
    fig, axes = plt.subplots(len(rows), across, figsize=size, layout="constrained", squeeze=False)
    image = None
    for line, ways in zip(axes, rows.values(), strict=True):
        for ax, (title, way) in zip(line, ways.items(), strict=False):
            decade, flags, total = (np.array(way[k]) for k in ("decade", "flags", "total"))
            image = panel(ax, decade, flags, total, title, _push_words(decade.shape[1]))
            levels = range(0, decade.shape[0], 3)
            ax.set_yticks(levels, ["0" if r == 0 else f"$10^{{{r - 5}}}$" for r in levels])
            # The ticks of the other pictures reach farther.
            ax.set_ylim(-0.5, decade.shape[0] - 0.5)
            ax.tick_params(labelsize=7)
        line[0].set_ylabel("damping", fontsize=8)
    for ax in axes[-1]:
        ax.set_xlabel("push Γ", fontsize=8)
    title = "Other solvers, n = 3/2"
    _finish(fig, axes, image, path, title, flagged="failed")


def _finish(
    fig: Any, axes: Any, image: Any, path: Path, title: str, flagged: str = "flagged"
) -> None:
    for ax in axes.flat:
        if not ax.images:
            ax.set_axis_off()
    if image is not None:
        bar = fig.colorbar(image, ax=axes, shrink=0.7, ticks=DECADES[::3])
        bar.set_label("largest relative error, $\\log_{10}$", fontsize=8)
        bar.ax.tick_params(labelsize=8)
    dense = " (dense: most lanes)" if flagged == "flagged" else ""
    fig.suptitle(f"{title}; hatched: {flagged}{dense}; grey: no lanes", fontsize=10)
    fig.savefig(path, dpi=90)
    plt.close(fig)


DEFECTS = (CLASSES[WRONG], CLASSES[FLAGGED_WITHOUT_NEED])


def draw(
    known: dict[str, Any],
    seed: dict[str, Any],
    laws: dict[str, Any],
    slopes: dict[str, Any],
    peers: dict[str, Any],
    docs: Path,
) -> None:
    for precision in ("float64", "float32"):
        draw_pushed(known, docs / f"stability_pushed_{precision}.png", precision)
        draw_free(known, docs / f"stability_free_{precision}.png", precision)
    draw_peers(peers, docs / "stability_peers.png")


def tables(
    known: dict[str, Any],
    seed: dict[str, Any],
    laws: dict[str, Any],
    slopes: dict[str, Any],
    peers: dict[str, Any],
) -> str:
    seeds = sorted({job["asked"][1] for job in seed.values()})
    named = f" (seed {seeds[0]})" if len(seeds) == 1 else ""
    parts = [
        "## Counts",
        _answered_by(known),
        _counts(known, all_groups=True),
        *_worst(known),
        "## On a second seed",
        f"{len(seed):,} jobs with other random lanes{named}. Groups without a row have no wrong "
        "lane and no\nlane flagged without need.",
        _answered_by(seed),
        _counts(seed, all_groups=False),
        "## Every law by its own class",
        "Laws with their own parameters, in SI units. The formulas were written again from the "
        "publications,\nwithout the package.",
        _answered_by(laws),
        _of_laws(laws),
        "## First derivatives",
        _of_slopes(slopes),
        "## General solvers",
        _of_peers(peers),
        "![Errors of general solvers](stability_peers.png)",
    ]
    return "\n" + "\n\n".join(parts)


def _table(heads: Iterable[str], rows: Iterable[Iterable[Any]]) -> str:
    shown = ([f"{c:,}" if isinstance(c, int) else str(c) for c in row] for row in rows)
    return lines(heads, shown, "---")


def _answered_by(known: dict[str, Any]) -> str:
    """Which code has answered how many jobs."""
    codes = Counter(job.get("code", "older code") for job in known.values())
    return (
        f"Jobs by version of the code: {', '.join(f'{n} by {c}' for c, n in codes.most_common())}."
    )


def _sum(jobs: Iterable[dict[str, Any]]) -> list[int]:
    """The lanes of some jobs, and those of each class."""
    counts = [sum(job["counts"][c] for job in jobs) for c in CLASSES]
    return [sum(job["lanes"] for job in jobs), *counts]


def _of_laws(laws: dict[str, Any]) -> str:
    rows = []
    for name, job in laws.items():
        law, motion = name.rsplit(", ", 1)
        rows.append([f"`{law}`", motion, *_sum([job])])
    rows.append(["all", "", *_sum(laws.values())])
    return _table(["law", "motion", "lanes", *CLASSES], rows)


def _counts(known: dict[str, Any], *, all_groups: bool) -> str:
    """A row for every group of jobs, or for those with a defect, and the sum."""
    rows = []
    for (kind, *rest), jobs in _groups(known).items():
        if all_groups or any(job["counts"][c] for job in jobs.values() for c in DEFECTS):
            rows.append([NAMES[kind], *rest, *_sum(jobs.values())])
    rows.append(["all", "", "", "", *_sum(known.values())])
    return _table(["kind", "motion", "method", "precision", "lanes", *CLASSES], rows)


def _worst(known: dict[str, Any]) -> list[str]:
    """The worst defect of every group of jobs; nothing where there is none."""
    rows = []
    for jobs in _groups(known).values():
        for klass in DEFECTS:
            lanes = [(name, lane) for name, job in jobs.items() for lane in job["worst"][klass][:1]]
            if lanes:
                name, lane = max(lanes, key=lambda pair: _size(pair[1]["times allowed"]))
                numbers = [_short(lane[name]) for name in ("damping", "n", "push", "true e")]
                told = [lane["worst"], _times(lane)] if klass == CLASSES[WRONG] else ["", ""]
                rows.append([name, klass, *numbers, *told])
    if not rows:
        return []
    heads = ["job", "class", "damping", "n", "push", "true e", "quantity", "times allowed"]
    words = "The largest error of every row of the counts, in units of the allowed error."
    return ["## Worst lanes", words, _table(heads, rows)]


def _groups(known: dict[str, Any]) -> dict[tuple[str, ...], dict[str, dict[str, Any]]]:
    """Jobs by kind, motion, method and precision: all exponents together."""
    groups: dict[tuple[str, ...], dict[str, dict[str, Any]]] = {}
    for name, job in known.items():
        kind, _, motion, method, precision = name.split("/")
        groups.setdefault((kind, motion, method, precision), {})[name] = job
    return groups


def _short(x: float | None) -> str:
    return "" if x is None else f"{x:.3g}"


def _size(times: float | None) -> float:
    return math.inf if times is None else times


def _times(lane: dict[str, Any]) -> str:
    """None stands for another status, or a number that is not finite."""
    return "∞" if lane["times allowed"] is None else _short(lane["times allowed"])


def _of_slopes(slopes: dict[str, Any]) -> str:
    names = ("lanes", "right", "flagged", "wrong", "median error")
    rows = [
        [name, *(job[k] for k in names), _times(job["worst"][0]) if job["worst"] else ""]
        for name, job in slopes.items()
    ]
    return _table(["job", *names, "worst"], rows)


def _of_peers(peers: dict[str, Any]) -> str:
    """What users would write instead."""
    names = list(next(iter(peers.values()))["counts"])
    rows = [[name, *(way["counts"][n] for n in names)] for name, way in peers.items()]
    return _table(["force and way", *names], rows)
