"""A sound, from a file or a column of samples, as intervals between impacts with their errors."""

from __future__ import annotations

import itertools
import math
import pathlib
from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np

from ...extend import counted
from ..signals import CLOCK, column_of, even
from ..sound.audio import Audio, Sound, SoundError
from ..tables.heading import Meaning
from ..tables.sheet import RecordingError, Row
from .intervals import Interval, Intervals, Timing

_CONTACT = 4e-4
"""Contact time in s; contacts of balls on hard floors last up to a millisecond."""

_SHOWN = 6


def intervals_in(name: str, source: pathlib.Path | bytes | Audio) -> list[Interval]:
    """Return the intervals of each drop in a sound as a trial, with the sound and notes on it.

    Raises RecordingError for a file that cannot be read, and if no bounces are found.
    """
    from ..sound.listening import listen

    try:
        sound = listen(source)
    except SoundError as error:
        raise RecordingError(str(error), name) from error
    except OSError as error:
        raise RecordingError(f"cannot be read ({error.strerror or error})", name) from error
    if not sound.drops:
        raise RecordingError(_nothing(sound), name)
    notes = _notes(sound)
    found = [
        (str(trial), one, two)
        for trial, drop in enumerate(sound.drops, 1)
        for one, two in itertools.pairwise(drop)
        if two.number == one.number + 1
    ]
    return [
        Interval(
            *("", row, trial, one.number),
            seconds=two.time - one.time,
            timing=Timing(one.error, two.error, _CONTACT),
            told=notes,
            sound=sound,
        )
        for row, (trial, one, two) in enumerate(found, 1)
    ]


def _long(sound: Sound) -> str:
    return f"{sound.seconds:.3g}" if sound.seconds < 100 else f"{sound.seconds:.0f}"


def _notes(sound: Sound) -> tuple[str, ...]:
    counts = " and ".join(map(str, map(len, sound.drops)))
    errors = [1e3 * one.error for one in itertools.chain(*sound.drops)]
    notes = [
        f"sound ({sound.words}, {_long(sound)} s)",
        f"{counted(len(sound.drops), ('drop', 'drops'))} of {counts} bounces, timed to "
        f"{min(errors):.2g} to {max(errors):.2g} ms",
    ]
    for doubtful, words in ((True, "doubtful and not used"), (False, "other sounds, not used")):
        if times := [f"{one.time:.3f}" for one in sound.others if one.doubtful is doubtful]:
            more = f" and {len(times) - _SHOWN} more" if len(times) > _SHOWN else ""
            notes.append(f"{words}: {len(times)}, at {', '.join(times[:_SHOWN])}{more} s")
    return tuple(notes)


def _nothing(sound: Sound) -> str:
    """Return why a recording holds no bounces, and what to do."""
    what = f"{_long(sound)} s of sound ({sound.words})"
    if not sound.others:
        return (
            f"{what} without a sound above the background: no bounce was found; record nearer to "
            "the ball, with automatic gain and noise reduction off"
        )
    count = len(sound.others)
    first = ", ".join(f"{one.time:.3f}" for one in sound.others[:_SHOWN])
    sounds = counted(count, ("sound", "sounds"))
    return (
        f"{what} with {sounds} above the background (at {first}{', ...' if count > _SHOWN else ''} "
        "s), but no series of at least 4 bounces with intervals that shrink by similar factors; "
        "let the ball bounce at least six times undisturbed, or give the intervals as a table"
    )


class Samples(Intervals):
    """Samples of a sound over time, in any unit, as written by interfaces with a microphone."""

    name = "sound"
    meanings: ClassVar[Mapping[str, Meaning]] = {
        "time": CLOCK,
        "sound": Meaning(
            "sound, audio, sound pressure, sound level, microphone, mic, amplitude, waveform, "
            "recording"
        ),
    }
    measured: ClassVar[tuple[str, ...]] = ("time", "sound")
    instead: ClassVar[Mapping[str, str]] = {"time": "; or give `rate`, the samples per second"}
    made_of = "intervals between the bounces in a sound"

    def read(self, rows: Sequence[Row]) -> list[Interval]:
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
        return intervals_in(rows[0].source, audio)
