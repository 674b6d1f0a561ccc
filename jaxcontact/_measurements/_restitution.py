"""What a measured restitution may be."""

from __future__ import annotations

import numpy as np

from .._flight import Floats
from .._parameter import Range

MEASURED_RESTITUTION = Range(low=0.0, high=1.2, low_open=True, inside=0.5)
"""Of a measured e, which noise may bring above 1."""
MEASURED_RESTITUTION_FROM_ZERO = Range(low=0.0, high=1.2, inside=0.5)


def in_percent(e: Floats) -> bool:
    """Whether restitutions look as if they were written in percent."""
    return bool(e.size) and float(np.median(e)) > 2 and float(e.max()) <= 120
