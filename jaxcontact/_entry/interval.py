"""Intervals that numbers must lie in."""

from __future__ import annotations

import dataclasses
import math
from typing import Any


@dataclasses.dataclass(frozen=True)
class Range:
    """The interval a parameter must lie in; `inside` is an arbitrary number in it."""

    low: float = -math.inf
    high: float = math.inf
    low_open: bool = False
    high_open: bool = False
    inside: float = 0.5

    def __str__(self) -> str:
        low_bracket = "(" if self.low_open or math.isinf(self.low) else "["
        high_bracket = ")" if self.high_open or math.isinf(self.high) else "]"
        return f"{low_bracket}{self.low:g}, {self.high:g}{high_bracket}"

    def holds(self, x: Any) -> Any:
        """Return whether x, a float or an array, lies inside; False for NaN and the infinities."""
        above = (x > self.low) if self.low_open else (x >= self.low)
        below = (x < self.high) if self.high_open else (x <= self.high)
        return above & below & (abs(x) < math.inf)


POSITIVE = Range(low=0.0, low_open=True, inside=1.0)
NOT_NEGATIVE = Range(low=0.0, inside=0.0)
REAL = Range(inside=0.0)
RESTITUTION = Range(low=0.0, high=1.0, low_open=True, inside=0.5)
RESTITUTION_FROM_ZERO = Range(low=0.0, high=1.0, inside=0.5)
FRACTION = Range(low=0.0, high=1.0, low_open=True, high_open=True, inside=0.5)
