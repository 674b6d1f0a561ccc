"""The page put together: its text, its code, uPlot (MIT licence) and the grids, in one file."""

from __future__ import annotations

from pathlib import Path

HERE = Path(__file__).parent
GRIDS = HERE / "grids.json"
"""Sweeps of the package, written by docs/explore.py."""

_PARTS = {
    "UPLOT_CSS": "uPlot.min.css",
    "CSS": "explore.css",
    "GRIDS": "grids.json",
    "LICENSE": "uPlot.LICENSE",
    "UPLOT": "uPlot.iife.min.js",
    "CODE": "explore.js",
}


def page() -> str:
    """The page as HTML that needs no other file and no network."""
    text = (HERE / "explore.html").read_text(encoding="utf-8")
    for mark, name in _PARTS.items():
        # The grids stand in a script, too: no "</" in any of them ends it.
        part = (HERE / name).read_text(encoding="utf-8").replace("</", "<\\/")
        text = text.replace(f"/*{mark}*/", part, 1)
    return text
