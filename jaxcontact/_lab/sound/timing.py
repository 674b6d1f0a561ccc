"""Times of impacts to a few microseconds, by matching the common sound of a drop.

Behind the whitening filter a bounce is a_k s(t - t_k) + noise, with one shape s for all. The time
with the largest correlation c(τ) = ∫ x(t + τ) s(t) dt has the error

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
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .background import Whitener

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
