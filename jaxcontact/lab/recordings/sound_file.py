"""A sound recording as intervals between impacts, each with its timing errors."""

from __future__ import annotations

import io
import itertools
import os
import pathlib
from typing import TYPE_CHECKING, Any

from ...extend import counted, require_path
from ..layouts.intervals import Interval, Timing
from ..sound.audio import Sound, SoundError, is_sound
from ..tables.grid import RecordingError

if TYPE_CHECKING:
    from ..sound.audio import Audio

_CONTACT = 4e-4
"""Contact time in s; contacts of balls on hard floors last up to a millisecond."""

_SHOWN = 6


def sound_in(source: Any) -> tuple[str, pathlib.Path | bytes] | None:
    """Return name and content of a sound file, None for other files; the first bytes decide.

    An open file is read from its current position, which is restored if it is not a sound.
    """
    if isinstance(source, str | os.PathLike):
        path = require_path("source", source)
        try:
            with path.open("rb") as file:
                start = file.read(16)
        except OSError:
            return None  # the reader of tables reports it
        return (str(path), path) if is_sound(start) else None
    if isinstance(source, io.TextIOBase) or not hasattr(source, "seek"):
        return None
    try:
        place, start = source.tell(), source.read(16)
        source.seek(place)
    except (OSError, ValueError):
        return None
    if not isinstance(start, bytes) or not is_sound(start):
        return None
    name = getattr(source, "name", None)
    return name if isinstance(name, str) else "the sound", source.read()


def heard(
    name: str, source: pathlib.Path | bytes | Audio
) -> tuple[Sound, list[Interval], list[str]]:
    """Return what a sound holds: the sound, the intervals of each drop as a trial, and notes.

    Raises RecordingError for a file that cannot be read, and if no bounces are found.
    """
    from ..sound.listening import listen

    try:
        sound = listen(source)
    except SoundError as error:
        raise RecordingError(str(error), name) from error
    except OSError as error:
        raise RecordingError(f"cannot be read ({error.strerror or error})", name) from error
    records: list[Interval] = []
    for trial, drop in enumerate(sound.drops, 1):
        for one, two in itertools.pairwise(drop):
            if two.number == one.number + 1:
                timing = Timing(one.error, two.error, _CONTACT)
                row, seconds = len(records) + 1, two.time - one.time
                records.append(
                    Interval("", row, None, str(trial), one.number, seconds, timing=timing)
                )
    if not records:
        raise RecordingError(_nothing(sound), name)
    counts = " and ".join(str(len(drop)) for drop in sound.drops)
    drops = "1 drop" if len(sound.drops) == 1 else f"{len(sound.drops)} drops"
    errors = [1e3 * one.error for drop in sound.drops for one in drop]
    notes = [
        f"sound ({sound.words}, {_long(sound)} s)",
        f"{drops} of {counts} bounces, timed to {min(errors):.2g} to {max(errors):.2g} ms",
    ]
    maybe = [one for one in sound.others if one.doubtful]
    rest = [one for one in sound.others if not one.doubtful]
    for some, words in ((maybe, "doubtful and not used"), (rest, "other sounds, not used")):
        if some:
            shown = ", ".join(f"{one.time:.3f}" for one in some[:_SHOWN])
            more = f" and {len(some) - _SHOWN} more" if len(some) > _SHOWN else ""
            notes.append(f"{words}: {len(some)}, at {shown}{more} s")
    return sound, records, notes


def _long(sound: Sound) -> str:
    return f"{sound.seconds:.3g}" if sound.seconds < 100 else f"{sound.seconds:.0f}"


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
