"""Ranges of numbers on the command line."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from .options import number

if TYPE_CHECKING:
    import numpy as np


def span(text: str) -> float | np.ndarray:
    """Return a number, or the numbers of FROM:TO:COUNT or FROM:TO:COUNT:log; for argparse."""
    import numpy as np

    parts = text.split(":")
    if len(parts) == 1:
        return number(text)
    if len(parts) not in (3, 4) or (len(parts) == 4 and parts[3] != "log"):
        raise argparse.ArgumentTypeError(
            f"{text!r} is neither a number nor of the form FROM:TO:COUNT or FROM:TO:COUNT:log"
        )
    low, high = number(parts[0]), number(parts[1])
    if not parts[2].isdecimal() or int(parts[2]) < 1:
        raise argparse.ArgumentTypeError(f"{parts[2]!r} in {text!r} is not a count")
    if len(parts) == 3:
        return np.linspace(low, high, int(parts[2]))
    if low <= 0 or high <= 0:
        raise argparse.ArgumentTypeError(f"{text!r} must be positive to be spaced by a factor")
    return np.geomspace(low, high, int(parts[2]))
