"""The bounces of one drop among sudden sounds: intervals and loudness that shrink by like factors.

A ball that bounces at the speeds v, e v, e² v, ... is in the air for T, e T, e² T, ... e changes
little from one bounce to the next, and the sound becomes weaker. The best such series is found by
dynamic programming over pairs of successive sounds.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from ._rises import Rises

SHORTEST, LONGEST = 0.02, 2.5
"""Flights in s that are looked for; a ball that flies for 2.5 s rises 8 m."""

_LOW, _HIGH = 0.25, 0.99
"""Ratios of successive flights; larger only by errors of the times."""

_CHANGE = 0.07
"""By how much ln(ratio) may change from one bounce to the next: drag, and e(v)."""

_TIMING = 1.5e-3
"""In s, of a sudden rise before its time is refined."""

_LOUDER, _WEAKER = 6.0, 22.0
"""By so many dB the next bounce may be louder or weaker."""

_MOST_GAIN, _MISS, _MISFIT = 3.0, 2.0, 0.5
LEAST_BOUNCES = 4
"""Three intervals, whose two ratios agree: fewer sounds are no evidence of a series."""

_LEAST_CLEAR = 3
"""Of them that stand out by themselves; others may be found where they let them be expected."""

_LEAST_SCORE = 5.0


@dataclasses.dataclass(frozen=True)
class Series:
    """Some rises by their positions, and the number of each bounce: one that was missed is left
    out of the count. `score` is larger for more and clearer ones.
    """

    place: tuple[int, ...]
    number: tuple[int, ...]
    score: float


@dataclasses.dataclass
class _Ends:
    """Series that end with a rise, by the rise before it: `flight` is the last one in s, `ratio` of
    the last two (NaN for the first), `last` the best series before, `step` flights between.
    """

    before: np.ndarray
    score: np.ndarray
    flight: np.ndarray
    ratio: np.ndarray
    last: np.ndarray
    step: np.ndarray


def best_series(rises: Rises) -> Series | None:
    """The series with the highest score; None where no sounds make one."""
    gain = np.minimum(np.log(rises.ratio), _MOST_GAIN)
    ends: list[_Ends] = []
    top = (_LEAST_SCORE, -1, -1)
    for j, now in enumerate(rises.time):
        first = int(np.searchsorted(rises.time, now - 2 * LONGEST))
        near = np.arange(first, j)
        wait, fall = now - rises.time[near], rises.level[near] - rises.level[j]
        near = near[(wait > SHORTEST) & (fall >= -_LOUDER) & (fall <= _WEAKER)]
        parts = [_onwards(ends[i], i, j, rises.time, gain) for i in near]
        columns = list(zip(*parts, strict=True)) or [()] * 5
        kinds = (float, float, float, int, int)
        found = _Ends(near, *map(np.array, columns, kinds))
        ends.append(found)
        full = np.where(found.last >= 0, found.score, -math.inf)
        if full.size and full.max() > top[0]:
            top = (float(full.max()), j, int(np.argmax(full)))
    if top[1] < 0:
        return None
    _, j, row = top
    place, steps = [j], []
    while row >= 0:
        here = ends[j]
        steps.append(int(here.step[row]))
        j, row = int(here.before[row]), int(here.last[row])
        place.append(j)
    number = 1 + np.concatenate([[0], np.cumsum(steps[::-1])])
    if len(place) < _LEAST_CLEAR:
        return None
    return Series(tuple(place[::-1]), tuple(map(int, number)), top[0])


def _onwards(
    ends: _Ends, i: int, j: int, time: np.ndarray, gain: np.ndarray
) -> tuple[float, float, float, int, int]:
    """The best series that ends with the rises i and j: score, flight, ratio, last, and step."""
    wait = time[j] - time[i]
    alone = (gain[i] + gain[j], wait, math.nan, -1, 1)
    if wait > LONGEST:
        alone = (-math.inf, wait, math.nan, -1, 1)
    if not ends.before.size:
        return alone
    best = alone
    with np.errstate(divide="ignore", invalid="ignore"):
        known = np.isfinite(ends.ratio)
        for step in (1, 2):
            flight = wait if step == 1 else wait * ends.ratio / (1 + ends.ratio)
            grown = ends.flight if step == 1 else ends.flight * ends.ratio
            ratio = flight / grown
            slack = _CHANGE + _TIMING / np.asarray(flight)
            off = np.where(known, np.log(ratio / ends.ratio) / slack, 0.0)
            good = (ratio > _LOW) & (ratio < _HIGH + _TIMING / grown) & (np.abs(off) < 1)
            good &= known | (step == 1)
            score = ends.score + gain[j] - _MISFIT * off**2 - (_MISS if step == 2 else 0.0)
            score = np.where(good, score, -math.inf)
            row = int(np.argmax(score))
            if score[row] > best[0]:
                own = wait if step == 1 else float(np.asarray(flight)[row])
                best = (float(score[row]), own, float(ratio[row]), row, step)
    return best
