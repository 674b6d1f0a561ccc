"""What a measured restitution may be."""

from __future__ import annotations

import math

import numpy as np

from .._flight import Floats
from .._parameter import Range

MEASURED_RESTITUTION = Range(low=0.0, high=1.2, low_open=True, inside=0.5)
"""Of a measured e, which noise may bring above 1."""
MEASURED_RESTITUTION_FROM_ZERO = Range(low=0.0, high=1.2, inside=0.5)

_AROUND = math.sqrt(10)
"""Half of the way, in powers of ten, from one unit to the next."""


def in_percent(e: Floats) -> bool:
    """Whether restitutions look as if they were written in percent."""
    return bool(e.size) and float(np.median(e)) > 2 and float(e.max()) <= 120


def length_guess(times: float) -> str:
    """The unit of a length that is so many times too large; nothing where that is not clear."""
    for unit, size in (("cm", 100), ("mm", 1000)):
        if size / _AROUND < times < size * _AROUND:
            return f"; is it in {unit}? then divide by {size}"
    return ""
