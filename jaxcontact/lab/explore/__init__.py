"""The interactive page that shows each law for a chosen e: one file, without a network.

It is assembled from its text, its code, uPlot (MIT licence) and the grids.
"""

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
    """Return the page as HTML that needs no other file and no network."""
    text = (HERE / "explore.html").read_text(encoding="utf-8")
    for mark, name in _PARTS.items():
        # The grids are part of a script too, so no part may contain "</", which would end it.
        part = (HERE / name).read_text(encoding="utf-8").replace("</", "<\\/")
        text = text.replace(f"/*{mark}*/", part, 1)
    return text
