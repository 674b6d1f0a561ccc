"""Impacts in a long record of force or acceleration, separated from each other."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from .trace import Doubtful, Floats, Trace, hum_of, noise_of

HALF = 0.6
"""Approximate fraction of a contact during which its force exceeds half of its maximum."""

LEAST_READINGS = 8
"""Least readings of a contact from which its shape can be fitted."""

_CLEAR = 6.0
"""Standard deviations of the noise by which a contact rises, after a mean over a fifth of it."""

_DIP = 5.0, 0.1
"""Depth of the dip between two contacts, in deviations and as a fraction of their height."""

_AROUND = 16.0
"""Widths at half height over which the level without contact is a running median."""

_MARGIN, _BESIDE = 0.3, 1.0
"""Contact durations that must be free before and after a contact, and that are kept if free."""

_BELOW, _BETWEEN, _STEP = 0.35, 4.0, 5.0
"""Limits of a contact that can be fitted.

A swing below the level by the first fraction of the height is not a pushing contact. Levels before
and after agree within the second number of errors. Contacts differ in length by less than the third
factor.
"""


_EDGES = 0.1, 0.3
"""Contact durations before the touch and after the end that may belong to a contact."""


class Cut(NamedTuple):
    """A contact in numbers of readings: approximate touch and end, and the window [start, stop).

    `height` is its height. The window includes free readings beside the contact.
    """

    touch: float
    end: float
    height: float
    start: int
    stop: int


def cut(quantity: str, time: Floats, value: Floats) -> tuple[Trace, list[Cut]]:
    """Return the record, with its noise and without hum, and its contacts that can be fitted."""
    from scipy.ndimage import median_filter, uniform_filter1d

    notes = []
    middle = float(np.median(value))
    smooth = median_filter(value, 3)
    if smooth.max() - middle < middle - smooth.min():
        value, smooth, middle = -value, -smooth, -middle
        notes.append("sign reversed, since contacts are negative in the file")
    noise = noise_of(value)
    width = _width(smooth, middle)
    level = _level(value, width)
    hum = hum_of(time, value, _quiet(smooth - level, noise, width), noise)
    if hum is not None:
        value = value - hum.value
        noise = noise_of(value)
        smooth = median_filter(value, 3)
        width = _width(smooth, float(np.median(value)))
        level = _level(value, width)
        size = shown(quantity, hum.amplitude)
        notes.append(f"hum of {hum.frequency:.1f} Hz subtracted, {size} in amplitude")
    mean = uniform_filter1d(value - level, max(width // 5, 1))
    found, good, doubtful = _contacts(mean, noise), [], []
    for k, one in enumerate(found):
        before = found[k - 1].end if k else -math.inf
        after = found[k + 1].touch if k + 1 < len(found) else math.inf
        made = _add_window(one, before, after, value.size)
        why = made if isinstance(made, str) else _doubt(made, found, mean, value, noise)
        if isinstance(made, str) or why:
            doubtful.append(Doubtful(float(time[min(max(int(one.touch), 0), time.size - 1)]), why))
        else:
            good.append(made)
    doubtful.sort()
    return Trace(quantity, time, value, level, noise, tuple(doubtful), tuple(notes)), good


def shown(quantity: str, number: float) -> str:
    """Return a reading with its unit."""
    unit = {"force": "N", "acceleration": "m/s²", "indentation": "m"}[quantity]
    return f"{number:.3g} {unit}"


def _width(smooth: Floats, middle: float) -> int:
    """Return the width in readings of the largest excursion at half height."""
    top = int(np.argmax(smooth))
    left, right = _half(smooth - middle, top)
    return max(int(right - left), 1)


def _half(height: Floats, top: int) -> tuple[float, float]:
    """Return the positions at half height around a peak, in numbers of readings."""
    half = height[top] / 2
    below = np.flatnonzero(height[: top + 1] < half)
    left = float(below[-1]) if below.size else 0.0
    if below.size:
        a, b = height[below[-1]], height[below[-1] + 1]
        left += float((half - a) / (b - a))
    below = np.flatnonzero(height[top:] < half)
    right = float(height.size - 1)
    if below.size:
        k = top + int(below[0])
        right = k - float((half - height[k]) / (height[k - 1] - height[k]))
    return left, right


def _level(value: Floats, width: int) -> Floats:
    """Return a running median, long compared with a contact, which follows steps of the level."""
    from scipy.ndimage import median_filter

    block = max(width // 4, 1)
    count = max(value.size // block, 1)
    means = np.median(value[: count * block].reshape(count, -1), axis=1)
    size = min(int(_AROUND * width / block) // 2 * 2 + 1, 2 * count - 1)
    found = median_filter(means, size, mode="nearest")
    at = (np.arange(count) + 0.5) * block - 0.5
    return np.interp(np.arange(value.size), at, found)


def _quiet(height: Floats, noise: float, width: int) -> np.ndarray:
    """Return the mask (n,) of readings far from contacts; hum may exceed the noise."""
    from scipy.ndimage import uniform_filter1d

    most = max(5 * noise, 6 * float(np.median(np.abs(height))))
    return uniform_filter1d((np.abs(height) > most).astype(float), 2 * width + 1) < 1e-9


def _contacts(mean: Floats, noise: float) -> list[Cut]:
    """Return the peaks that exceed the noise and the adjacent dips."""
    from scipy.signal import find_peaks, peak_prominences

    # SciPy does not find a plateau at the edge of a record.
    low = float(mean.min()) - noise
    within = np.concatenate([[low], mean, [low]])
    tops = find_peaks(within, height=_CLEAR * noise)[0]
    prominence = peak_prominences(within, tops)[0]
    tops = tops[prominence >= np.maximum(_DIP[0] * noise, _DIP[1] * within[tops])] - 1
    found = []
    for top in tops:
        left, right = _half(mean, int(top))
        beside = (1 - HALF) / HALF / 2 * (right - left)
        found.append(Cut(left - beside, right + beside, float(mean[top]), 0, 0))
    return found


def _add_window(one: Cut, before: float, after: float, size: int) -> Cut | str:
    """Return the contact with the free readings around it, or why there are too few."""
    long = one.end - one.touch
    if one.touch - before < 0 or after - one.end < 0:
        return "a double contact"
    if one.touch - before < _MARGIN * long or after - one.end < _MARGIN * long:
        return "another contact is too near"
    if one.touch < _MARGIN * long:
        return "cut off by the beginning of the record"
    if size - one.end < _MARGIN * long:
        return "cut off by the end of the record"
    start = max(one.touch - _BESIDE * long, before + 0.1 * long, 0)
    stop = min(one.end + _BESIDE * long, after - 0.1 * long, size)
    return one._replace(start=math.ceil(start), stop=math.floor(stop))


def _doubt(one: Cut, found: list[Cut], mean: Floats, value: Floats, noise: float) -> str:
    """Return why a contact cannot be fitted, "" if it can."""
    long = one.end - one.touch
    if long < LEAST_READINGS:
        return f"only {long:.0f} readings of the contact"
    usual = float(np.median([other.end - other.touch for other in found]))
    if not usual / _STEP < long < usual * _STEP:
        return f"lasts {long / usual:.2g} times as long as the others"
    if mean[one.start : one.stop].min() < -max(_BELOW * one.height, _CLEAR * noise):
        return "swings below zero, as the ringing of an instrument does"
    # A contact with loss ends slowly, later than its width at half height implies.
    last_before, first_after = one.touch - _EDGES[0] * long, one.end + _EDGES[1] * long
    sides = value[one.start : math.floor(last_before)], value[math.ceil(first_after) : one.stop]
    if min(map(len, sides)) < 2:
        return ""
    error = noise * math.sqrt(sum(1 / side.size for side in sides))
    first, last = (float(side.mean()) for side in sides)
    if abs(last - first) > max(_BETWEEN * error, 0.05 * one.height):
        return "the level after it differs from that before"
    return ""
