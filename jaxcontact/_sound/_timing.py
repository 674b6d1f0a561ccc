"""Times of impacts to a few microseconds: each sounds like the others of its drop, only weaker.

Behind the whitening filter a bounce is a_k s(t - t_k) + noise with one shape s for all. The time
with the largest correlation c(τ) = ∫ x(t + τ) s(t) dt has, in noise of the variance σ² per sample,
the error

    var t = σ²/(a² Σ s'²),

and the posterior of τ, exp(c²/(2 σ² Σ s²)), says whether another period fits as well. σ² is what a
bounce leaves beside the shape, so that sounds which differ from it are known less well. No
threshold is met later by a weaker sound, as that of a picker is. Source: Kay (1993), Fundamentals
of Statistical Signal Processing: Estimation Theory, ISBN 978-0133457117, ex. 3.13.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ._background import Whitener

_LEAD, _SHAPE, _FADE = 5e-4, 6e-3, 2e-3
"""Parts of the shape in s: before the impact, after it, and of that where it fades out."""

_QUIET = 8e-3
_FINE = 384e3
"""Samples per second between which a parabola is exact enough."""

_ROUNDS = 3
CLEAR = 30.0
"""c²/(σ² Σ s²) of a sound that is the shape: of noise it is above 30 once in a million lags."""


class Timed(NamedTuple):
    """The `time` of an impact in s, its standard `error`, its amplitude in units of the shape, and
    how `clear` it is, c²/(σ² Σ s²).
    """

    time: float
    error: float
    amplitude: float
    clear: float


class Shape(NamedTuple):
    """What all impacts of a drop sound like: samples from `lead` before the impact on."""

    samples: Float[np.ndarray, " m"]
    lead: int
    rate: int


def shape_at(filters: Whitener, time: float) -> Shape:
    """The sound at one time."""
    rate = filters.audio.rate
    lead, after = round(_LEAD * rate), round(_SHAPE * rate)
    at = round(time * rate)
    return Shape(filters.part(at - lead, at + after) * _window(rate), lead, rate)


def _window(rate: int) -> Float[np.ndarray, " m"]:
    lead, after = round(_LEAD * rate), round(_SHAPE * rate)
    t = (np.arange(lead + after) - lead) / rate
    return np.cos(np.pi / 2 * np.clip((t - _SHAPE + _FADE) / _FADE, 0, 1)) ** 2


def find(filters: Whitener, shape: Shape, near: float, reach: float) -> Timed:
    """The impact within `reach` s of a time."""
    rate, m = shape.rate, shape.samples.size
    margin = round(reach * rate) + 2
    start = round(near * rate) - shape.lead - margin
    quiet = round(_QUIET * rate)
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
    here = x[round(lag) : round(lag) + m]
    left = max(float(here @ here) - amplitude * float(c[k]), 0.0) / max(m - 2, 1)
    variance = max(left, float(np.mean(before**2)) if near > _QUIET else 0.0, 1e-20)
    slope = float(np.sum(np.diff(shape.samples, prepend=0.0) ** 2)) * rate**2
    error = math.sqrt(variance / slope) / amplitude
    posterior = np.where(c > 0, c, 0) ** 2 / (2 * variance * power)
    weight = np.exp(posterior - posterior.max())
    place = np.arange(c.size) / fine
    mean = float(weight @ place / weight.sum())
    spread = math.sqrt(float(weight @ (place - mean) ** 2 / weight.sum())) / rate
    time = (start + lag + shape.lead) / rate
    return Timed(time, max(error, spread), amplitude, float(c[k] ** 2 / (variance * power)))


def common_shape(filters: Whitener, found: list[Timed], shape: Shape) -> Shape:
    """The mean of sounds at their times, each weighted as its amplitude and noise say."""
    m, rate = shape.samples.size, shape.rate
    total, weights = np.zeros(m), 0.0
    for one in found:
        if not (one.amplitude > 0 and math.isfinite(one.error)):
            continue
        exact = one.time * rate - shape.lead
        whole, spare = math.floor(exact), m
        x = filters.part(whole - spare, whole + m + spare)
        turn = np.exp(2j * np.pi * np.fft.rfftfreq(x.size) * (exact - whole))
        x = np.fft.irfft(np.fft.rfft(x) * turn, x.size)[spare : spare + m]
        # A clear sound weighs as its energy; a weak one less, by its noise.
        weight = one.amplitude * one.clear / (one.clear + CLEAR)
        total += weight * x
        weights += weight * one.amplitude
    if weights == 0:
        return shape
    return Shape(total / weights * _window(rate), shape.lead, rate)


def timed(filters: Whitener, near: list[float], loudest: int) -> tuple[list[Timed], Shape]:
    """The impacts near some times, and their common shape, which begins as that of the loudest."""
    shape, reach = shape_at(filters, near[loudest]), 2e-3
    found = [find(filters, shape, time, reach) for time in near]
    for _ in range(_ROUNDS - 1):
        shape = common_shape(filters, found, shape)
        found = [find(filters, shape, one.time, reach / 2) for one in found]
    return found, shape
