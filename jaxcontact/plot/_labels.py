"""What stands beside an axis: words and a unit in which its numbers are short."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from .. import _units as units

if TYPE_CHECKING:
    from matplotlib.axis import Axis

_PREFIXES = {-9: "n", -6: "µ", -3: "m", 3: "k", 6: "M", 9: "G"}

_BOTH = "N", "J", "Pa"
_DOWNWARDS = "s", "m", "m/s"
"""Units that take any prefix, and those that people use with small ones alone."""


def put_label(axis: Axis, name: str, words: str | None = None) -> None:
    """Label an axis by the name of its quantity; on a linear one with the prefix that its largest
    number asks for: "time / ms".

    The data stay in SI units, and so do the limits: the numbers at the ticks alone are divided.
    """
    from matplotlib.ticker import FuncFormatter

    power = _power(axis, units.meaning(name)[1])
    if power:
        axis.set_major_formatter(FuncFormatter(lambda x, place: f"{round(x / 10.0**power, 9):g}"))
    axis.set_label_text(units.label(name, words, prefix=_PREFIXES.get(power, "")))


def _power(axis: Axis, unit: str) -> int:
    if unit not in (*_BOTH, *_DOWNWARDS) or axis.get_scale() != "linear":
        return 0
    # All that the axes hold, what was drawn before too.
    ends = np.abs(axis.get_view_interval())
    largest = float(ends.max()) if np.isfinite(ends).all() else 0.0
    if not largest > 0:
        return 0
    # From 0.1 on a number is short without a prefix.
    power = 3 * math.floor(math.log10(largest * 10) / 3) if largest < 0.1 else 0
    if unit in _BOTH and largest >= 1e4:
        power = 3 * math.floor(math.log10(largest) / 3)
    return int(np.clip(power, -9, 9))
