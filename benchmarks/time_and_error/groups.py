"""The groups of the benchmark by name, in the order of the page."""

from __future__ import annotations

from collections.abc import Callable

from . import derivatives, engines, fits, impacts, scenes
from .page import write
from .store import Store

GROUPS: dict[str, Callable[[Store, str, bool], None]] = {
    "impacts": impacts.run,
    "derivatives": derivatives.run,
    "engines": engines.run,
    "scenes": scenes.run,
    "fits": fits.run,
}

__all__ = ["GROUPS", "Store", "write"]
