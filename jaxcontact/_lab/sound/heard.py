"""Results of a sound recording as plain data."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

Floats = Float[np.ndarray, " n"]


class Envelope(NamedTuple):
    """The energy (n,) of whitened samples in each hop of `step` s, and that of the noise."""

    step: float
    energy: Floats
    noise: Floats


@dataclasses.dataclass(frozen=True)
class HeardBounce:
    """One impact: its `number` in the drop, from 1, and its `time` with standard `error` in s.

    `level` is its level over the noise in dB.
    """

    number: int
    time: float
    error: float
    level: float


@dataclasses.dataclass(frozen=True)
class Other:
    """A sound that is not used: its time in s, its level over the noise in dB, and why.

    It is `doubtful` if it may be a bounce.
    """

    time: float
    level: float
    why: str
    doubtful: bool = False


@dataclasses.dataclass(frozen=True)
class Sound:
    """Detected sounds: the drops, each of bounces in order; `others`; the length in `seconds`.

    `envelope` is the energy of the whitened samples, and of their noise, in steps of half a
    millisecond. It is that of the `channel` (from 1) that was used. `words` describe the file.
    """

    words: str
    seconds: float
    channel: int
    drops: tuple[tuple[HeardBounce, ...], ...]
    others: tuple[Other, ...]
    envelope: Envelope
