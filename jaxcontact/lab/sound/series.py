"""Sudden rises in a recording, and the bounces of one drop among them.

A rise is the energy just after a time over that just before: the ratio of a short-time to a
long-time average of the energy of whitened samples. The two windows are adjacent, so that the tail
of the last impact counts as noise. Source: Allen (1978), doi 10.1785/BSSA0680051521.

A ball that bounces at the speeds v, e v, e² v, ... is in the air for T, e T, e² T, ... From one
bounce to the next e changes little, and the sound becomes weaker: intervals and loudness shrink
geometrically. The best such series is found by dynamic programming over pairs of successive sounds.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from jaxtyping import Float, Int
from scipy import ndimage

from .audio import Envelope
from .background import Whitener

Floats = Float[np.ndarray, " n"]


HOP = 5e-4
_AFTER, _GAP, _BEFORE = 8, 1, 14
"""In hops: 4 ms after, and 7 ms before."""

_APART = 16
"""Hops within which only the strongest rise counts."""

LEAST_RISE = 2.2
_CHUNK = 0.25
_CHUNKS = 9


@dataclasses.dataclass(frozen=True)
class Rises:
    """Sudden rises: time in s, ratio of energies, and level over the noise in dB."""

    time: Floats
    ratio: Floats
    level: Floats

    def some(self, which: np.ndarray) -> Rises:
        return Rises(self.time[which], self.ratio[which], self.level[which])

    def __len__(self) -> int:
        return self.time.size


def envelopes(filters: list[Whitener]) -> list[Envelope]:
    """Return the energy of each channel over time, read in one pass."""
    audio = filters[0].audio
    hop = max(round(HOP * audio.rate), 1)
    states: list[list] = [[] for _ in filters]
    rest = [np.zeros(0)] * len(filters)
    energies: list[list[np.ndarray]] = [[] for _ in filters]
    for block in audio.blocks():
        for k, one in enumerate(filters):
            x = np.concatenate([rest[k], one.apply(block[:, k], states[k])])
            count = x.size // hop
            rest[k] = x[count * hop :]
            energies[k].append(np.mean(x[: count * hop].reshape(count, hop) ** 2, axis=1))
    step = hop / audio.rate
    return [_with_noise(step, np.concatenate(one)) for one in energies]


def _with_noise(step: float, energy: Floats) -> Envelope:
    """Return the envelope with noise: the quiet part of quarter seconds, over two seconds."""
    size = max(round(_CHUNK / step), 1)
    count = max(energy.size // size, 1)
    smooth = ndimage.uniform_filter1d(energy, _AFTER, mode="nearest")
    quiet = np.array([np.quantile(part, 0.25) for part in np.array_split(smooth, count)])
    quiet = ndimage.percentile_filter(quiet, 40, min(_CHUNKS, count), mode="nearest")
    place = (np.arange(count) + 0.5) * energy.size / count
    noise = np.interp(np.arange(energy.size), place, quiet)
    least = max(1e-7 * float(energy.max(initial=0)), 1e-14)
    return Envelope(step, energy, np.maximum(noise, least))


def rises_of(found: Envelope) -> Rises:
    """Return all rises of at least `LEAST_RISE`, in order."""
    energy = found.energy
    total = np.concatenate([[0.0], np.cumsum(energy)])
    k = np.arange(energy.size)

    def mean(first: Int[np.ndarray, " n"], last: Int[np.ndarray, " n"]) -> Floats:
        first, last = np.clip(first, 0, energy.size), np.clip(last, 0, energy.size)
        return (total[last] - total[first]) / np.maximum(last - first, 1)

    after = mean(k, k + _AFTER)
    before = np.maximum(mean(k - _GAP - _BEFORE, k - _GAP), found.noise)
    ratio = after / before
    peak = ndimage.maximum_filter1d(ratio, 2 * _APART + 1, mode="nearest") == ratio
    at = np.flatnonzero(peak & (ratio > LEAST_RISE) & (k > _BEFORE // 2))
    level = 10 * np.log10(np.maximum(after - before, 1e-30) / found.noise)
    return Rises(found.step * _onset(energy, at), ratio[at], level[at])


def _onset(energy: Floats, at: Int[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    """Return the hop that separates quiet from loud at each rise, by two variances (Akaike).

    A short sound may lie entirely in the window after, long before it begins.
    """
    steps = np.arange(-_BEFORE, 2 * _AFTER)
    part = energy[np.clip(at[:, None] + steps, 0, energy.size - 1)] + 1e-300
    total = np.cumsum(part, axis=1)
    first = np.arange(1, steps.size)
    rest = steps.size - first
    cost = first * np.log(total[:, :-1] / first)
    cost = cost + rest * np.log(np.maximum(total[:, -1:] - total[:, :-1], 1e-300) / rest)
    inner = slice(_BEFORE // 2 - 1, -2)
    best = np.argmin(cost[:, inner], axis=1) if at.size else np.zeros(0, int)
    return at + steps[1:][inner][best]


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
