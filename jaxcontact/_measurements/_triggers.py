"""What may have gone wrong with the trigger that times impacts, told by the intervals around it."""

from __future__ import annotations

import math
from collections.abc import Sequence

_TOLERANCE = 0.06
_LATE_TOLERANCE = 0.25  # of the deviation that a late trigger would explain
_MOST_MERGED = 5


def trigger_fault(near: Sequence[float | None], e: float) -> str:
    """What may have happened to the pair (k, k+1) of intervals.

    `near` are the intervals k-2 ... k+3 in s, None where there is none; `e` is the usual ratio.
    """
    two_before, before, first, second, after, two_after = near
    assert first is not None  # a pair has both
    assert second is not None
    # A flight cut in two: the parts together fit their neighbours, and each is too short.
    # This is checked first: neighbours on both sides are better evidence than one ratio.
    cuts = (
        (_ratio(_sum(first, second), before), _ratio(after, _sum(first, second))),
        (_ratio(_sum(second, after), first), _ratio(two_after, _sum(second, after))),
        (_ratio(_sum(before, first), two_before), _ratio(second, _sum(before, first))),
    )
    for into, out_of in cuts:
        matches = [_close(r, e) for r in (into, out_of) if r is not None]
        if matches and all(matches):
            return "spurious trigger (one flight cut in two)"
    # An interval that holds m flights is 1 + e + ... times as long.
    for m in range(2, _MOST_MERGED + 1):
        whole = (1 - e**m) / (1 - e) if e < 1 else float(m)
        if _close(second / first, e * whole):
            return f"missed trigger ({m} flights in the second interval)"
        if _close(second / first, e**m / whole):
            return f"missed trigger ({m} flights in the first interval)"
    # A trigger between two good ones that came late or early: one interval is too long, its
    # neighbour too short, and their sum is right, much more nearly than the ratio.
    off = abs(math.log(second / first / e))
    shifts = (
        (two_before, before, first),
        (before, first, second),
        (first, second, after),
    )
    for reference, a, b in shifts:
        both, between = _ratio(_sum(a, b), reference), _ratio(b, a)
        if both is None or between is None:
            continue
        tolerance = min(_LATE_TOLERANCE * off, _TOLERANCE)
        right = abs(math.log(both / (e + e * e))) < tolerance
        # Two good intervals also have the right sum: the fault must lie between these two.
        if right and abs(math.log(between / e)) > off / 2:
            return "late or early trigger"
    return "unclear"


def _close(ratio: float | None, expected: float) -> bool:
    return ratio is not None and abs(ratio / expected - 1) < _TOLERANCE


def _ratio(above: float | None, below: float | None) -> float | None:
    return None if above is None or below is None else above / below


def _sum(a: float | None, b: float | None) -> float | None:
    return None if a is None or b is None else a + b
