"""Sound as a column of samples, searched for bounces like a sound file."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from types import MappingProxyType

import numpy as np

from ..layouts.intervals import Interval, Intervals
from ..signals.clock import CLOCK, column_of, even
from ..sound import Sound
from ..tables.heading import Meaning, words
from ..tables.match import Match
from ..tables.sheet import Row, Sheet
from .sound_file import heard


@dataclasses.dataclass(frozen=True, eq=False)
class Heard(Interval):
    """The time between two bounces detected in a `sound`, and the notes on it."""

    sound: Sound
    told: tuple[str, ...]


class Samples(Intervals):
    """Samples of a sound over time, in any unit, as written by interfaces with a microphone."""

    name = "sound"
    columns = measured = ("time", "sound")
    meanings = MappingProxyType(
        {
            "time": CLOCK,
            "sound": Meaning(
                words(
                    "sound, audio, sound pressure, sound level, microphone, mic, amplitude, "
                    "waveform, recording"
                )
            ),
        }
    )
    instead = MappingProxyType({"time": "; or give `rate`, the samples per second"})
    made_of = "intervals between the bounces in a sound"

    def fits(self, made: Match, sheet: Sheet) -> bool:
        return True

    def at_rate(self, rate: float | None) -> Samples:
        return self  # its times already include the rate

    def read(self, rows: Sequence[Row]) -> list[Interval]:
        from ..sound.audio import Audio

        if not rows:
            return []
        samples = column_of(rows, "sound")
        time, _ = even(rows, column_of(rows, "time"))
        samples = samples - np.median(samples)
        size = float(np.max(np.abs(samples)))
        if size == 0:
            rows[0].refuse("sound", "is the same everywhere")
        samples = samples[:, None] / size
        rate = (time.size - 1) / float(time[-1] - time[0])
        # Written times are rounded; instruments sample at whole rates.
        rate = float(round(rate)) if abs(rate - round(rate)) < 1e-4 * math.sqrt(rate) else rate
        audio = Audio(
            *(rate, time.size, 1, "a column of samples"),
            lambda start, count: samples[start : start + count],
        )
        sound, records, told = heard(rows[0].source, audio)
        fields = [
            {f.name: getattr(one, f.name) for f in dataclasses.fields(one)} for one in records
        ]
        return [Heard(**one, sound=sound, told=tuple(told)) for one in fields]

    def notes(self, records: Sequence[Interval]) -> tuple[str, ...]:
        return next((one.told for one in records if isinstance(one, Heard)), ())


def sound_of(records: Sequence[object]) -> Sound | None:
    """Return the sound in which intervals were detected, None without one."""
    return next((one.sound for one in records if isinstance(one, Heard)), None)
