"""Plausible readings of bouncing balls: ranges of e, and guesses of a wrong unit."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from ..._entry import Range
from ..._flight import STANDARD_GRAVITY, Floats

MEASURED_RESTITUTION = Range(low=0.0, high=1.2, low_open=True, inside=0.5)
"""Range of a measured e, which noise may raise above 1."""
MEASURED_RESTITUTION_FROM_ZERO = Range(low=0.0, high=1.2, inside=0.5)

_AROUND = math.sqrt(10)
"""Half of a factor of ten, on a logarithmic scale: the limit between two units."""

_LONG = 20.0
"""Longest plausible interval in s; such a flight rises half a kilometre."""

EVEN = 0.985
"""Ratio of successive intervals above which they are those of a clock, not of a ball."""

_MOST_COMPARED = 200


def in_percent(e: Floats) -> bool:
    """Return whether restitutions seem to be in percent."""
    return bool(e.size) and float(np.median(e)) > 2 and float(e.max()) <= 120


def length_guess(times: float) -> str:
    """Return the unit of a length that is `times` too large; "" if unclear."""
    for unit, size in (("cm", 100), ("mm", 1000)):
        if size / _AROUND < times < size * _AROUND:
            return f"; is it in {unit}? then divide by {size}"
    return ""


def too_long(seconds: ArrayLike, gravity: float = STANDARD_GRAVITY) -> str:
    """Return why these are not intervals in s, with a guess of their unit; "" if plausible."""
    typical = float(np.median(np.asarray(seconds)))
    rise = gravity * typical**2 / 8
    if rise <= STANDARD_GRAVITY * _LONG**2 / 8:
        return ""
    return (
        f"half of the intervals are longer than {typical:g} s, in which a ball rises {rise:.0f} m; "
        "are they in ms? then divide by 1000"
    )


def not_shrinking(chains: Iterable[Floats], power: float = 1.0) -> float | None:
    """Return the median factor between successive intervals if no ball can have it, or None.

    `chains` are successive intervals (n,) of one trial each, or heights with `power` 2. The result
    is not None if two conditions hold. The factor is above `EVEN` to this power. And shorter
    intervals than before do not clearly outnumber longer ones: by less than two standard deviations
    of Kendall's (1938) count, doi 10.1093/biomet/30.1-2.81.
    """
    steps, score, variance = [], 0.0, 0.0
    for chain in chains:
        one = chain[:_MOST_COMPARED]
        n = one.size
        steps.append(one[1:] / one[:-1])
        score += float(np.sum(np.tril(np.sign(one[:, None] - one), -1)))
        variance += n * (n - 1) * (2 * n + 5) / 18
    ratios = np.concatenate(steps or [np.zeros(0)])
    if not ratios.size or score <= -2 * math.sqrt(variance):
        return None
    middle = float(np.median(ratios))
    return middle if middle > EVEN**power else None
