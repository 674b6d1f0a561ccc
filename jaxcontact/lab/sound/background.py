"""The background of a recording, and the filter that whitens it.

Hum and low frequencies of a room are far louder than a distant bounce, but not at all frequencies.
A linear prediction filter for the background spectrum turns it into white noise. The filter is
causal, so that nothing sounds before an impact. Source: Akaike's picker on such residuals, Sleeman
& van Eck (1999), doi 10.1016/S0031-9201(99)00007-2.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float
from scipy import linalg, signal

from .audio import Audio, SoundError

_HIGH_PASS = 150.0
"""Cut-off in Hz, against hum with its first harmonics and wind noise."""

_ORDER = 24
_SEGMENT = 0.03
_MOST_SEGMENTS = 2000
_QUIET = 0.3
"""Quantile over segments, at each frequency, that counts as background."""

_RANGE = 1e-5
"""Relative floor of the spectrum; limits gain at weak frequencies, as in coded files."""

_LEAST = 1e-11
"""Variance of rounding to 16 bits, at full scale 1."""

_SETTLED = 0.03


@dataclasses.dataclass(frozen=True)
class Whitener:
    """A high-pass filter followed by a linear prediction filter, for one channel of a file."""

    audio: Audio
    channel: int
    high_pass: Float[np.ndarray, "sections 6"]
    prediction: Float[np.ndarray, " order"]
    settled: Float[np.ndarray, "sections 2"]
    """State of the first filter after a constant 1."""

    def apply(
        self, x: Float[np.ndarray, " n"], state: list[np.ndarray] | None = None
    ) -> np.ndarray:
        """Return filtered samples (n,); `state`, initially [], carries over from block to block."""
        if state is None:
            state = []
        if not state:
            state[:] = [
                self.settled * (x[0] if x.size else 0.0),
                np.zeros(self.prediction.size - 1),
            ]
        x, state[0] = signal.sosfilt(self.high_pass, x, zi=state[0])
        x, state[1] = signal.lfilter(self.prediction, [1.0], x, zi=state[1])
        return x

    def part(self, start: int, stop: int) -> np.ndarray:
        """Return filtered samples `start` to `stop`; zeros beyond the ends of the file."""
        rate, frames = self.audio.rate, self.audio.frames
        first, last = max(start - round(_SETTLED * rate), 0), min(stop, frames)
        whole = np.zeros(stop - start)
        if last > max(start, 0):
            x = self.apply(self.audio.read(first, last - first)[:, self.channel])
            inside = x[max(start, 0) - first :]
            whole[max(-start, 0) : max(-start, 0) + inside.size] = inside
        return whole


def whiteners(audio: Audio) -> list[Whitener]:
    """Return the filter of each channel; raise SoundError for samples that are not finite."""
    length = max(1 << round(np.log2(_SEGMENT * audio.rate)), 2 * _ORDER)
    step = max(audio.frames // length // _MOST_SEGMENTS, 1)
    window = np.asarray(signal.get_window("hann", length), float)[:, None]
    spectra = []
    for block in audio.blocks():
        if not np.isfinite(block).all():
            raise SoundError("holds samples that are not finite; save it again as 16 bit WAV")
        count = len(block) // length
        segments = block[: count * length].reshape(count, length, audio.channels)[::step]
        spectra.append(np.abs(np.fft.rfft(window * segments, axis=1)) ** 2)
    power = np.quantile(np.concatenate(spectra), _QUIET, axis=0)
    power /= float(np.sum(window**2))
    high_pass = np.asarray(
        signal.butter(4, _HIGH_PASS, "highpass", fs=audio.rate, output="sos"), float
    )
    frequency = np.fft.rfftfreq(length)
    passed = np.abs(signal.sosfreqz(high_pass, 2 * np.pi * frequency)[1]) ** 2
    found = []
    for k in range(audio.channels):
        own = power[:, k] * passed + _LEAST
        r = np.fft.irfft(own + _RANGE * own.max())[: _ORDER + 1]
        a = linalg.solve_toeplitz(r[:-1], r[1:])
        prediction = np.concatenate([[1.0], -a])
        found.append(Whitener(audio, k, high_pass, prediction, signal.sosfilt_zi(high_pass)))
    return found
