"""The impacts of a bouncing ball in a sound recording."""

from __future__ import annotations

import math
import pathlib

import numpy as np

from .audio import Audio, SoundError, open_sound
from .background import Whitener, whiteners
from .heard import HeardBounce, Other, Sound
from .series import LEAST_BOUNCES, SHORTEST, Rises, Series, best_series, envelopes, rises_of
from .timing import CLEAR, Shape, Timed, find, timed

_SHORT = 0.3
_LEAST_RATE = 4000
_MOST_RISES = 5000
_REACH = 0.04
"""Largest search radius around the expected time of the next impact, as a fraction of a flight."""

_CERTAIN, _LEAST_REACH = 2e-3, 4e-4
_UNSURE = 2e-4
"""Timing error in s above which an impact is doubtful."""

_MOST_EVEN = 0.985
"""Largest median ratio of intervals of a ball; voices and machines are more even."""

_FREE, _FAR = 3e-3, 6.0
"""Tolerance of ln(ratio) of flights, absolute and in standard deviations."""

_TRIES = 12
"""Rejected series after which the search ends."""

_EXPECTED = 10.0
"""As `CLEAR`, for a sound within a fraction of a millisecond of its expected time."""

_SURE = 4.0
"""Clearness, in units of `CLEAR`, of the impacts from which a series is extended."""

_LOUD = 12.0
"""Level over the noise in dB above which other sounds are listed."""

_AMPLITUDES = 0.15, 2.5


def listen(source: pathlib.Path | bytes | Audio) -> Sound:
    """Find the bounces in a sound file, in its bytes, or in samples.

    Raises SoundError for a file that cannot be read and for a recording that is too short. A
    recording without bounces has no drops.
    """
    audio = source if isinstance(source, Audio) else open_sound(source)
    if audio.rate < _LEAST_RATE:
        raise SoundError(
            f"has {audio.rate:g} samples per second, but at least {_LEAST_RATE} are needed to "
            "locate an impact"
        )
    if audio.seconds < _SHORT:
        raise SoundError(
            f"is {audio.seconds:.2g} s long, too short for bounces; record a ball from before it "
            "is dropped until it rests"
        )
    filters = whiteners(audio)
    found = envelopes(filters)
    # Use the channel with the loudest impact over its noise: a sum of channels would smear impacts.
    height = [float(np.max(one.energy / one.noise)) for one in found]
    channel = int(np.argmax(height))
    rises = rises_of(found[channel])
    if len(rises) > _MOST_RISES:
        least = np.sort(rises.ratio)[-_MOST_RISES]
        rises = rises.some(rises.ratio >= least)
    drops, others = _drops(audio, filters[channel], rises)
    bits = f"{audio.words}, {audio.rate:g} Hz"
    if audio.channels > 1:
        bits += f", channel {channel + 1} of {audio.channels}"
    return Sound(bits, audio.seconds, channel + 1, drops, others, found[channel])


def _drops(
    audio: Audio, filters: Whitener, rises: Rises
) -> tuple[tuple[tuple[HeardBounce, ...], ...], tuple[Other, ...]]:
    """Find the clearest drop first, then others, and return them in order of time."""
    left, drops, others, spans = rises, [], [], []
    tries = _TRIES
    while tries and (series := best_series(left)) is not None:
        members = np.zeros(len(left), bool)
        members[list(series.place)] = True
        drop, doubtful = _drop(filters, left, series)
        if len(drop) < LEAST_BOUNCES:
            left, tries = left.some(~members), tries - 1
            continue
        drops.append(drop)
        others += doubtful
        first, last = drop[0].time, drop[-1].time
        spans.append((first, last))
        flight = drop[1].time - first
        outside = (left.time < first - flight / 2) | (left.time > last + SHORTEST)
        left = left.some(outside & ~members)
    drops.sort(key=lambda one: one[0].time)
    used = np.array([one.time for drop in drops for one in drop] + [one.time for one in others])
    for k, time in enumerate(rises.time):
        near = used.size and np.min(np.abs(used - time)) < 0.5 * SHORTEST
        if rises.level[k] < _LOUD or near:
            continue
        during = any(first <= time <= last for first, last in spans)
        why = "between bounces, off their series" if during else "belongs to no series of bounces"
        others.append(Other(float(time), float(rises.level[k]), why))
    others.sort(key=lambda one: one.time)
    return tuple(drops), tuple(others)


def _drop(
    filters: Whitener, rises: Rises, series: Series
) -> tuple[tuple[HeardBounce, ...], list[Other]]:
    """Return the bounces of a series at refined times, adding weaker ones at expected times."""
    place = list(series.place)
    near = [float(t) for t in rises.time[place]]
    loudest = int(np.argmax(rises.level[place]))
    found, shape = timed(filters, near, loudest)
    known = {
        number: one
        for number, one in zip(series.number, found, strict=True)
        if one.clear > CLEAR and math.isfinite(one.error)
    }
    if not _three_in_a_row(known):
        return (), []
    # Weaker impacts are searched again at the times that the clearest ones predict.
    sure = {number: one for number, one in known.items() if one.clear > _SURE * CLEAR}
    known = sure if _three_in_a_row(sure) else known
    _extend(filters, shape, known)
    numbers = sorted(known)
    again, _ = timed(
        filters,
        [known[k].time for k in numbers],
        int(np.argmax([known[k].amplitude for k in numbers])),
    )
    doubtful, good = [], {}
    for number, one in zip(numbers, again, strict=True):
        if one.clear > _EXPECTED and one.error < _UNSURE:
            good[number] = one
        else:
            why = f"its time is known only to {1e3 * one.error:.2g} ms"
            doubtful.append(Other(one.time, _level(one), why, doubtful=True))
    while (number := _misfit(good)) is not None:
        one = good.pop(number)
        why = "too early or too late for its series"
        doubtful.append(Other(one.time, _level(one), why, doubtful=True))
    if _usual_ratio(good) > _MOST_EVEN:
        return (), []
    for number in sorted(good):
        if not {number - 1, number + 1} & good.keys():
            one = good.pop(number)
            why = "those before and after it are missing"
            doubtful.append(Other(one.time, _level(one), why, doubtful=True))
    first = min(good, default=1)
    drop = tuple(
        HeardBounce(number - first + 1, one.time, one.error, _level(one))
        for number, one in sorted(good.items())
    )
    return drop, doubtful


def _level(one: Timed) -> float:
    return 10 * math.log10(max(one.clear, 1e-3))


def _extend(filters: Whitener, shape: Shape, known: dict[int, Timed]) -> None:
    """Add impacts before, between and after the known ones, at expected times."""
    for onwards in (1, -1):
        for _ in range(200):
            number = max(known) if onwards > 0 else min(known)
            for step in (1, 2):
                if _add(filters, shape, known, number + onwards * step):
                    break
            else:
                break
    for number in range(min(known) + 1, max(known)):
        if number not in known:
            _add(filters, shape, known, number)


def _add(filters: Whitener, shape: Shape, known: dict[int, Timed], number: int) -> bool:
    expected = _expected(known, number)
    if expected is None:
        return False
    time, flight, spread = expected
    if not 0 < time < filters.audio.seconds - 1e-3 or flight < SHORTEST:
        return False
    near = min(known, key=lambda k: abs(k - number))
    reach = (min(2 * spread + _CERTAIN, _REACH) * flight + _LEAST_REACH) * abs(number - near)
    reach = min(reach, flight / 3)
    one = find(filters, shape, time, reach, flight)
    ratio = one.amplitude / known[near].amplitude
    low, high = _AMPLITUDES if number > near else tuple(1 / x for x in _AMPLITUDES[::-1])
    if one.clear < _EXPECTED or not low < ratio < high or abs(one.time - time) > 0.98 * reach:
        return False
    known[number] = one
    return True


def _expected(known: dict[int, Timed], number: int) -> tuple[float, float, float] | None:
    """Return the expected time of an impact, the adjacent flight time, and the spread of ratios.

    Times are in s; the spread is that of ln(ratio) of nearby flights.
    """
    flights = {k: known[k + 1].time - known[k].time for k in known if k + 1 in known}
    pairs = [(k, flights[k + 1] / flights[k]) for k in flights if k + 1 in flights]
    if not pairs:
        return None
    near = [one[1] for one in sorted(pairs, key=lambda one: abs(one[0] + 1 - number))]
    ratio = float(np.median(near[:3]))
    spread = float(np.ptp(np.log(near[:5]))) if len(near) > 2 else math.inf
    k = min(flights, key=lambda one: abs(one + 0.5 - number))
    if number > k:
        time, flight = known[k + 1].time, flights[k]
        for _ in range(number - k - 1):
            flight *= ratio
            time += flight
    else:
        time, flight = known[k].time, flights[k]
        for _ in range(k - number):
            flight /= ratio
            time -= flight
    return time, flight, spread


def _three_in_a_row(known: dict[int, Timed]) -> bool:
    return any(k + 1 in known and k + 2 in known for k in known)


def _usual_ratio(good: dict[int, Timed]) -> float:
    """Return the median ratio of successive flights; infinite without any."""
    triples = [(good[k], good[k + 1], good[k + 2]) for k in good if {k + 1, k + 2} <= good.keys()]
    ratios = [(three.time - two.time) / (two.time - one.time) for one, two, three in triples]
    return float(np.median(ratios)) if ratios else math.inf


def _misfit(good: dict[int, Timed]) -> int | None:
    """Return the least certain of three impacts whose flights misfit the nearby ones, or None.

    ln(T₂/T₁) is compared with its median over five nearby ones. The limit allows for timing errors
    and the scatter of the ratios.
    """
    found = []
    for k in good:
        if k + 1 in good and k + 2 in good:
            one, two, three = (good[k + step] for step in range(3))
            t1, t2 = two.time - one.time, three.time - two.time
            variance = (one.error / t1) ** 2 + (two.error * (1 / t1 + 1 / t2)) ** 2
            found.append((k, math.log(t2 / t1), variance + (three.error / t2) ** 2))
    worst, most = None, 1.0
    for k, own, variance in found:
        others = sorted((one for one in found if one[0] != k), key=lambda one: abs(one[0] - k))[:5]
        if len(others) < 2:
            continue
        ratios = np.array([one[1] for one in others])
        middle = float(np.median(ratios))
        scatter = float(np.median(np.abs(ratios - middle)))
        off = abs(own - middle) / (_FREE + _FAR * math.hypot(scatter, math.sqrt(variance)))
        if off > most:
            worst, most = k, off
    if worst is None:
        return None
    return max((worst + step for step in range(3)), key=lambda number: good[number].error)
