"""The bounces of one drop among sudden sounds: intervals and loudness shrink geometrically.

A ball that bounces at the speeds v, e v, e² v, ... is in the air for T, e T, e² T, ... From one
bounce to the next e changes little, and the sound becomes weaker. The best such series is found by
dynamic programming over pairs of successive sounds.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from .rises import Rises

SHORTEST, LONGEST = 0.02, 1.8
"""Range of flights in s; a ball that flies for 1.8 s rises 4 m."""

_LOW, _HIGH = 0.25, 0.99
"""Range of ratios of successive flights; larger only through timing errors."""

_CHANGE = 0.07
"""Largest change of ln(ratio) from one bounce to the next, by drag and e(v)."""

_TIMING = 1.5e-3
"""Timing error in s of a sudden rise before refinement."""

_LOUDER, _WEAKER = 6.0, 22.0
"""Limits in dB by which the next bounce may be louder or weaker."""

_MOST_GAIN, _MISS, _MISFIT = 3.0, 2.0, 0.5
LEAST_BOUNCES = 4
"""Least bounces of a series: three intervals have two ratios that can agree."""

_LEAST_CLEAR = 3
"""Least sounds of a series that stand out alone; the others may be searched at expected times."""

_LEAST_SCORE = 5.0


@dataclasses.dataclass(frozen=True)
class Series:
    """Rises by position, and the number of each bounce; a missed bounce skips a number.

    `score` is larger for more and clearer bounces.
    """

    place: tuple[int, ...]
    number: tuple[int, ...]
    score: float


@dataclasses.dataclass
class _Ends:
    """Series that end with one rise, listed by the rise before it.

    `flight` is the last one in s, and `ratio` that of the last two (NaN for the first). `last` is
    the best series before, and `step` the number of flights between.
    """

    before: np.ndarray
    score: np.ndarray
    flight: np.ndarray
    ratio: np.ndarray
    last: np.ndarray
    step: np.ndarray


def best_series(rises: Rises) -> Series | None:
    """Return the series with the highest score; None if no sounds form one."""
    gain = np.minimum(np.log(rises.ratio), _MOST_GAIN)
    ends: list[_Ends] = []
    top = (_LEAST_SCORE, -1, -1)
    for j, now in enumerate(rises.time):
        near = np.arange(int(np.searchsorted(rises.time, now - LONGEST)), j)
        wait, fall = now - rises.time[near], rises.level[near] - rises.level[j]
        near = near[(wait > SHORTEST) & (fall >= -_LOUDER) & (fall <= _WEAKER)]
        found = _onwards(
            [ends[i] for i in near], near, now - rises.time[near], gain, float(gain[j])
        )
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
    ends: list[_Ends], near: np.ndarray, wait: np.ndarray, gain: np.ndarray, own: float
) -> _Ends:
    """Return the best series that end with each of the rises `near` and one more.

    It follows after `wait` s and has the gain `own`. `ends` are the series that end with each of
    `near`.
    """
    found = _Ends(
        near,
        gain[near] + own,
        wait.copy(),
        np.full(near.size, math.nan),
        np.full(near.size, -1),
        np.ones(near.size, int),
    )
    counts = np.array([one.before.size for one in ends], int)
    if not counts.sum():
        return found
    place = np.repeat(np.arange(near.size), counts)
    waits = wait[place]
    score, flight, ratio = (
        np.concatenate([getattr(one, name) for one in ends])
        for name in ("score", "flight", "ratio")
    )
    known = np.isfinite(ratio)
    best = np.full((3, place.size), -math.inf)  # score, flight and ratio
    step = np.ones(place.size, int)
    with np.errstate(divide="ignore", invalid="ignore"):
        for k, now, grown in (
            (1, waits, flight),
            (2, waits * ratio / (1 + ratio), flight * ratio),  # one bounce is missed
        ):
            new = now / grown
            off = np.where(known, np.log(new / ratio) / (_CHANGE + _TIMING / now), 0.0)
            good = (new > _LOW) & (new < _HIGH + _TIMING / grown) & (np.abs(off) < 1)
            good &= known | (k == 1)
            value = score + own - _MISFIT * off**2 - _MISS * (k - 1)
            better = good & (value > best[0])
            best = np.where(better, [value, now, new], best)
            step = np.where(better, k, step)
    starts = np.concatenate([[0], np.cumsum(counts)])
    for i in np.flatnonzero(counts):
        part = slice(starts[i], starts[i + 1])
        row = int(np.argmax(best[0, part]))
        value, now, new = best[:, starts[i] + row]
        if value > found.score[i]:
            found.score[i], found.flight[i], found.ratio[i] = value, now, new
            found.last[i], found.step[i] = row, step[starts[i] + row]
    return found
