"""Sudden rises in a recording: the energy just after a time over that just before.

This is the ratio of a short-time to a long-time average of the energy of whitened samples. The two
windows are adjacent, so that the tail of the last impact counts as noise. Source: Allen (1978), doi
10.1785/BSSA0680051521.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float, Int
from scipy import ndimage

from .background import Whitener
from .heard import Envelope

HOP = 5e-4
_AFTER, _GAP, _BEFORE = 8, 1, 14
"""In hops: 4 ms after, and 7 ms before."""

_APART = 16
"""Hops within which only the strongest rise counts."""

LEAST_RISE = 2.2
_CHUNK = 0.25
_CHUNKS = 9

Floats = Float[np.ndarray, " n"]


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
