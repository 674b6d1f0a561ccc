"""The drops in the track of one ball."""

from __future__ import annotations

import dataclasses

import numpy as np

from .finding import FoundDrops, find, noise_of
from .fitting import LEAST_FRAMES, fit_drop
from .seen import Drop, Frames, Skipped, Track

_HEAVY = 1 / 3
"""Fraction of frames within flights that are off; with more, the result is not a drop."""

_MOST = 1.2
"""Largest ratio of successive flights."""

_ROUGH, _BENT = 2.5, 0.02
"""Limits of the residual: times the difference of neighbours, and as a fraction of the height.

Above both, the motion is not free flight. Measured values are up to 1.4 for balls, and from 2.8 and
5 % for swings.
"""


def follow(frames: Frames) -> Track:
    """Find the flights of a ball and fit them; a track without an impact has no drops.

    Heights that count downwards are inverted, so that flights curve towards the floor.
    """
    best: Track | None = None
    for sign in (1, -1):
        turned = dataclasses.replace(frames, height=sign * frames.height, sign=sign)
        found = _fit_drops(turned, find(turned.time, turned.height))
        if best is None or _count(found) > _count(best):
            best = found
    assert best is not None  # for the type checker
    return best


def _count(track: Track) -> int:
    return sum(int(drop.used.sum()) for drop in track.drops)


def _fit_drops(frames: Frames, found: FoundDrops) -> Track:
    drops: list[Drop] = []
    skipped = [Skipped(time, "no flights on both sides") for time in found.others]
    for guess in found.guesses:
        drop = fit_drop(frames, guess)
        impacts = guess.times[1:-1]
        why = "no parabolas" if drop is None else _doubt(drop)
        if drop is None or why:
            skipped += [Skipped(float(time), why) for time in impacts]
        else:
            drops.append(drop)
    skipped.sort()
    return Track(frames, tuple(drops), tuple(skipped))


def _doubt(drop: Drop) -> str:
    """Return why a fit is not a drop, "" if it may be one."""
    if drop.off.sum() > _HEAVY * (drop.off.sum() + drop.used.sum()):
        return "too many frames off the parabolas"
    seconds, off = drop.seconds, drop.noise[1]
    highest = drop.camera.fall * float(seconds.max()) ** 2 / 8
    if off > max(_ROUGH * noise_of(drop.frames.height[drop.used]), _BENT * highest):
        return "no parabolas"
    error = np.sqrt(np.diag(drop.covariance))
    # A flight longer than the one before by more than its errors was thrown.
    ratio, spread = seconds[1:] / seconds[:-1], error[1:] / seconds[1:] + error[:-1] / seconds[:-1]
    if np.any(ratio > _MOST + 3 * spread):
        return "a flight longer than the one before"
    if np.any(spread > 0.5):
        return f"flights with too few frames, about {LEAST_FRAMES}"
    return ""
