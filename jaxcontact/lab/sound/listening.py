"""The impacts of a bouncing ball in a sound recording.

Times of impacts to a few microseconds, by matching the common sound of a drop. Behind the whitening
filter a bounce is a_k s(t - t_k) + noise, with one shape s for all. The time with the largest
correlation c(τ) = ∫ x(t + τ) s(t) dt has the error

    var t = Σ |S'(f)|² |R(f)|² / (a Σ |S'(f)|²)²,

with S' the spectrum of s'. R is that of the residual after subtracting the shape of the others:
noise, and true differences. In white noise of variance σ² this is σ²/(a² Σ s'²). The posterior of
τ, exp(c²/(2 σ² Σ s²)), shows whether another period fits as well. Unlike a threshold picker, this
does not date weaker sounds later. Source: Kay (1993), Fundamentals of Statistical Signal
Processing: Estimation Theory, ISBN 978-0133457117, ex. 3.13.
"""

from __future__ import annotations

import dataclasses
import math
import pathlib
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .audio import Audio, HeardBounce, Other, Sound, SoundError, open_sound
from .background import Whitener, whiteners
from .series import LEAST_BOUNCES, SHORTEST, Rises, Series, best_series, envelopes, rises_of

_LEAD, _SHAPE, _FADE = 5e-4, 6e-3, 2e-3
"""Parts of the shape in s: before the impact, after it, and the final fade-out."""

_QUIET = 16e-3
_LONG = 1.0
_ALIKE = 0.2
"""Least fraction of the energy of a sound that must be that of the shape."""

_FINE = 384e3
"""Samples per second between which a parabola is accurate enough."""

_ROUNDS = 3
CLEAR = 16.0
"""c²/(σ² Σ s²) of a sound with the shape; noise exceeds 16 once in ten thousand lags."""


class Timed(NamedTuple):
    """The `time` of an impact in s, its standard `error`, and its amplitude in units of the shape.

    `clear` is c²/(σ² Σ s²), and `share` the fraction of its energy that is that of the shape.
    """

    time: float
    error: float
    amplitude: float
    clear: float
    share: float = 0.0


@dataclasses.dataclass(frozen=True)
class Shape:
    """The common sound of all impacts of a drop: samples from `lead` before the impact on."""

    samples: Float[np.ndarray, " m"]
    lead: int
    rate: float


def shape_at(filters: Whitener, time: float) -> Shape:
    """Return the sound at one time."""
    rate = filters.audio.rate
    lead, after = round(_LEAD * rate), round(_SHAPE * rate)
    at = round(time * rate)
    return Shape(filters.part(at - lead, at + after) * _window(rate), lead, rate)


def _window(rate: float) -> Float[np.ndarray, " m"]:
    lead, after = round(_LEAD * rate), round(_SHAPE * rate)
    t = (np.arange(lead + after) - lead) / rate
    return np.cos(np.pi / 2 * np.clip((t - _SHAPE + _FADE) / _FADE, 0, 1)) ** 2


def find(
    filters: Whitener, shape: Shape, near: float, reach: float, flight: float = _LONG
) -> Timed:
    """Find the impact within `reach` s of a time, after a `flight` in s."""
    rate, m = shape.rate, shape.samples.size
    margin = round(reach * rate) + 2
    start = round(near * rate) - shape.lead - margin
    # Take the noise from the end of the flight, where the last impact has decayed most.
    quiet = max(round(min(_QUIET, 0.4 * flight) * rate), m + round(_LEAD * rate))
    x = filters.part(start - quiet, start + m + 2 * margin)
    before, x = x[:quiet], x[quiet:]
    fine = max(math.ceil(_FINE / rate), 1)
    size = 1 << (x.size + m).bit_length()
    spectrum = np.fft.rfft(x, size) * np.conj(np.fft.rfft(shape.samples, size))
    lags = 2 * margin * fine
    c = np.fft.irfft(spectrum, size * fine)[: lags + 1] * fine
    power = float(shape.samples @ shape.samples)
    k = int(np.argmax(c[fine:-fine])) + fine
    if power == 0 or c[k] <= 0:
        return Timed(near, math.inf, 0.0, 0.0)
    bend = c[k - 1] - 2 * c[k] + c[k + 1]
    lag = (k + (0.5 * (c[k - 1] - c[k + 1]) / bend if bend < 0 else 0.0)) / fine
    amplitude = float(c[k]) / power
    time = (start + lag + shape.lead) / rate
    left = _at(filters, shape, time) - amplitude * shape.samples
    spectrum = np.fft.fft(shape.samples)
    energy = np.abs(spectrum) ** 2
    # The residual is coloured: only its part that resembles the shape matters.
    rest = np.abs(np.fft.fft(left)) ** 2
    variance = noise = max(float(energy @ rest) / m**2, 1e-30)
    if near > quiet / rate + reach:
        like = np.convolve(before, shape.samples[::-1], "valid")
        noise = max(float(np.mean(like**2)), 1e-30)
        rest = np.maximum(rest, m * noise / power)
        variance = max(variance, noise)
    slope = energy * (2 * np.pi * np.fft.fftfreq(m, 1 / rate)) ** 2
    error = math.sqrt(float(slope @ rest)) / (amplitude * float(np.sum(slope)))
    posterior = np.where(c > 0, c, 0) ** 2 / (2 * variance)
    weight = np.exp(posterior - posterior.max())
    place = np.arange(c.size) / fine
    mean = float(weight @ place / weight.sum())
    other = math.sqrt(float(weight @ (place - mean) ** 2 / weight.sum())) / rate
    whole = amplitude**2 * power
    share = whole / (whole + float(left @ left))
    clear = float(c[k] ** 2 / noise) if share > _ALIKE else 0.0
    return Timed(time, max(error, other), amplitude, clear, share)


def _at(filters: Whitener, shape: Shape, time: float) -> Float[np.ndarray, " m"]:
    """Return the sound at a time between samples, as long as the shape."""
    exact, m = time * shape.rate - shape.lead, shape.samples.size
    whole = math.floor(exact)
    x = filters.part(whole - m, whole + 2 * m)
    turn = np.exp(2j * np.pi * np.fft.rfftfreq(x.size) * (exact - whole))
    return np.fft.irfft(np.fft.rfft(x) * turn, x.size)[m : 2 * m] * _window(shape.rate)


def _shapes(filters: Whitener, found: list[Timed], shape: Shape) -> tuple[Shape, list[Shape]]:
    """Return the mean of sounds at their times, weighted by amplitude and noise.

    Also return the mean without each in turn, since a sound always resembles a mean that includes
    it.
    """
    sounds = np.array([_at(filters, shape, one.time) for one in found])
    size = np.array([one.amplitude for one in found])
    clear = np.array([one.clear for one in found])
    # A clear sound is weighted by its energy, a weak one less because of its noise.
    weight = size * clear / (clear + CLEAR)
    total, whole = weight @ sounds, float(weight @ size)
    if not whole > 0:
        return shape, [shape] * len(found)
    rest = whole - weight * size
    others = [
        dataclasses.replace(shape, samples=(total - w * x) / r) if r > 0.02 * whole else shape
        for w, x, r in zip(weight, sounds, rest, strict=True)
    ]
    return dataclasses.replace(shape, samples=total / whole), others


def timed(filters: Whitener, near: list[float], loudest: int) -> tuple[list[Timed], Shape]:
    """Return the impacts near some times, and their common shape, starting from the loudest."""
    shape, reach = shape_at(filters, near[loudest]), 2e-3
    flights = np.diff(near, prepend=near[0] - _LONG)
    found = [
        find(filters, shape, time, reach, flight)
        for time, flight in zip(near, flights, strict=True)
    ]
    for _ in range(_ROUNDS - 1):
        shape, others = _shapes(filters, found, shape)
        found = [
            find(filters, own, one.time, reach / 2, flight)
            for own, one, flight in zip(others, found, flights, strict=True)
        ]
    return found, shape


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
    if not _triples(known):
        return (), []
    # Weaker impacts are searched again at the times that the clearest ones predict.
    sure = {number: one for number, one in known.items() if one.clear > _SURE * CLEAR}
    known = sure if _triples(sure) else known
    _extend(filters, shape, known)
    numbers = sorted(known)
    again, _ = timed(
        filters,
        [known[k].time for k in numbers],
        int(np.argmax([known[k].amplitude for k in numbers])),
    )
    good, doubtful = dict(zip(numbers, again, strict=True)), []

    def reject(number: int, why: str) -> None:
        one = good.pop(number)
        doubtful.append(Other(one.time, _level(one), why, doubtful=True))

    for number, one in zip(numbers, again, strict=True):
        if not (one.clear > _EXPECTED and one.error < _UNSURE):
            reject(number, f"its time is known only to {1e3 * one.error:.2g} ms")
    while (number := _misfit(good)) is not None:
        reject(number, "too early or too late for its series")
    triples = _triples(good)
    ratios = [(three.time - two.time) / (two.time - one.time) for _, one, two, three in triples]
    if not ratios or np.median(ratios) > _MOST_EVEN:
        return (), []
    for number in sorted(good):
        if not {number - 1, number + 1} & good.keys():
            reject(number, "those before and after it are missing")
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
    later, flight = number > k, flights[k]
    time = known[k + later].time
    growth, sign = (ratio, 1) if later else (1 / ratio, -1)
    for _ in range(abs(number - k - later)):
        flight *= growth
        time += sign * flight
    return time, flight, spread


def _triples(good: dict[int, Timed]) -> list[tuple[int, Timed, Timed, Timed]]:
    """Return each three impacts in succession, with the number of the first."""
    return [
        (k, one, good[k + 1], good[k + 2])
        for k, one in good.items()
        if {k + 1, k + 2} <= good.keys()
    ]


def _misfit(good: dict[int, Timed]) -> int | None:
    """Return the least certain of three impacts whose flights misfit the nearby ones, or None.

    ln(T₂/T₁) is compared with its median over five nearby ones. The limit allows for timing errors
    and the scatter of the ratios.
    """
    found = []
    for k, one, two, three in _triples(good):
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
