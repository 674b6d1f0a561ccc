"""Plausible readings of bouncing balls: ranges of e, and guesses at a wrong unit."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from ..._flight import STANDARD_GRAVITY, Floats
from ..._parameter import Range

MEASURED_RESTITUTION = Range(low=0.0, high=1.2, low_open=True, inside=0.5)
"""Of a measured e, which noise may bring above 1."""
MEASURED_RESTITUTION_FROM_ZERO = Range(low=0.0, high=1.2, inside=0.5)

_AROUND = math.sqrt(10)
"""Half of the way, in powers of ten, from one unit to the next."""

_LONG = 20.0
"""Of an interval in s: a ball that is so long in the air came from half a kilometre."""

EVEN = 0.985
"""Balls that keep so much of their speed are hardly found: what is evener is a clock."""

_MOST_COMPARED = 200


def in_percent(e: Floats) -> bool:
    """Whether restitutions look as if they were written in percent."""
    return bool(e.size) and float(np.median(e)) > 2 and float(e.max()) <= 120


def length_guess(times: float) -> str:
    """The unit of a length that is so many times too large; nothing where that is not clear."""
    for unit, size in (("cm", 100), ("mm", 1000)):
        if size / _AROUND < times < size * _AROUND:
            return f"; is it in {unit}? then divide by {size}"
    return ""


def too_long(seconds: ArrayLike, gravity: float = STANDARD_GRAVITY) -> str:
    """Why these are no intervals in s, with a guess of their unit; nothing where they may be."""
    typical = float(np.median(np.asarray(seconds)))
    rise = gravity * typical**2 / 8
    if rise <= STANDARD_GRAVITY * _LONG**2 / 8:
        return ""
    return (
        f"half of the intervals are longer than {typical:g} s, in which a ball rises {rise:.0f} m; "
        "are they in ms? then divide by 1000"
    )


def not_shrinking(chains: Iterable[Floats], power: float = 1.0) -> float | None:
    """The median factor from one interval to the next, where those of no ball have it.

    `chains` are successive intervals (n,) of one trial each, or with `power` 2 heights. They do not
    shrink where the factor is above `EVEN` to this power, and where not clearly more of them are
    shorter than one before than are longer: by less than two standard deviations of Kendall's
    (1938) count, doi 10.1093/biomet/30.1-2.81.
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
