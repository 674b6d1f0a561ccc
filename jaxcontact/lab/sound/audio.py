"""Samples of a sound file in blocks: WAV by the standard library and SciPy, others by soundfile.

The results of a recording follow, as plain data.
"""

from __future__ import annotations

import dataclasses
import io
import os
import pathlib
import re
import struct
import tempfile
import warnings
import wave
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from ...extend import require_path

Samples = Float[np.ndarray, "frames channels"]

_BLOCK = 1 << 18

_KINDS = {
    "WAV": b"(RIFF|RF64|RIFX).{4}WAVE",
    # A table may also begin with a word such as "FORMAT" or "ID3".
    "AIFF": b"FORM.{4}AIF[FC]",
    "FLAC": b"fLaC",
    "OGG": b"OggS\0",
    "CAF": b"caff\0",
    # A version tag, or a frame of MPEG layer III; 0xFFFE is the byte order mark of UTF-16.
    "MP3": b"ID3[\2-\4]|\xff[\xfb\xfa\xf3\xf2\xe3\xe2]",
}
"""The first bytes of each kind that is read."""
_FOREIGN = {"MPEG-4 (m4a)": b".{4}ftyp", "WMA": b"\x30\x26\xb2\x75"}
_HOW = "convert it to WAV or FLAC, as with `ffmpeg -i recording bounce.wav`"

_UNREADABLE = ValueError, EOFError, RuntimeError, OSError, ArithmeticError, NameError, struct.error
"""Errors of readers; SciPy's is a NameError if no samples follow the header."""


class SoundError(ValueError):
    """A fault of a sound recording, without the name of its file."""


class Audio(NamedTuple):
    """A sound: frames per second, counts, and `read(start, count)` of frames from -1 to 1."""

    rate: float
    frames: int
    channels: int
    words: str
    read: Callable[[int, int], Samples]

    @property
    def seconds(self) -> float:
        return self.frames / self.rate

    def blocks(self) -> Iterator[Samples]:
        """Yield all frames in blocks, so that a long file does not fill the memory."""
        for start in range(0, self.frames, _BLOCK):
            yield self.read(start, min(_BLOCK, self.frames - start))


def is_sound(start: bytes) -> bool:
    """Return whether a file with these first bytes is a sound recording of any kind."""
    return _kind(start) is not None


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
    return name_of(source, "the sound"), source.read()


def name_of(file: Any, otherwise: str) -> str:
    """Return the name of an open file, which may be a number or missing."""
    name = getattr(file, "name", None)
    return name if isinstance(name, str) else otherwise


def _kind(start: bytes) -> str | None:
    kinds = _KINDS | _FOREIGN
    return next((name for name, mark in kinds.items() if re.match(mark, start, re.DOTALL)), None)


def open_sound(source: pathlib.Path | bytes) -> Audio:
    """Return the samples of a file or of its bytes; raise SoundError if they cannot be read."""
    start = source[:16] if isinstance(source, bytes) else _beginning(source)
    kind = _kind(start)
    if kind in _FOREIGN:
        raise SoundError(f"is {kind}, which cannot be read; {_HOW}")
    try:
        audio = (_wave(source) or _by_scipy(source)) if kind == "WAV" else _by_soundfile(source)
    except SoundError:
        raise
    except _UNREADABLE as error:
        raise SoundError(f"is a {kind} file that cannot be read ({error}); {_HOW}") from error
    if audio is None:
        problem = f"is {kind}, which needs soundfile (pip install 'jaxcontact[sound]', or {_HOW})"
        raise SoundError(problem)
    return audio


def _beginning(path: pathlib.Path) -> bytes:
    with path.open("rb") as file:
        return file.read(16)


def _file(source: pathlib.Path | bytes) -> io.BytesIO | str:
    return io.BytesIO(source) if isinstance(source, bytes) else str(source)


def _wave(source: pathlib.Path | bytes) -> Audio | None:
    """Return integer samples of 8 to 32 bits; None for other codings, which `wave` refuses."""
    try:
        with wave.open(_file(source), "rb") as file:
            rate, channels = file.getframerate(), file.getnchannels()
            width, frames = file.getsampwidth(), file.getnframes()
    except wave.Error:
        return None

    def read(start: int, count: int) -> Samples:
        with wave.open(_file(source), "rb") as file:
            file.setpos(start)
            data = file.readframes(count)
        whole = len(data) // (width * channels) * width * channels
        return _numbers(np.frombuffer(data[:whole], np.uint8), width).reshape(-1, channels)

    # A truncated file holds fewer frames than its header says.
    size = len(source) if isinstance(source, bytes) else source.stat().st_size
    frames = min(frames, size // (width * channels))
    return Audio(rate, frames, channels, f"WAV of {8 * width} bits", read)


def _numbers(data: np.ndarray, width: int) -> np.ndarray:
    if width == 1:  # the only unsigned width
        return (data.astype(float) - 128) / 128
    # Pad the lower bytes with zeros, so that all samples have 32 bits.
    wide = np.zeros((data.size // width, 4), np.uint8)
    wide[:, 4 - width :] = data.reshape(-1, width)
    return wide.reshape(-1).view("<i4") / 2.0**31


def _by_scipy(source: pathlib.Path | bytes) -> Audio:
    """Return WAV with floating-point numbers or an extended header."""
    from scipy.io import wavfile

    with warnings.catch_warnings():
        # Chunks of titles and cue points are skipped, with a warning for each.
        warnings.simplefilter("ignore", wavfile.WavFileWarning)
        try:
            rate, data = wavfile.read(_file(source), mmap=not isinstance(source, bytes))
        except ValueError:  # 24 bits cannot be mapped
            rate, data = wavfile.read(_file(source))
    data = data.reshape(len(data), -1)
    scale = 1.0 if data.dtype.kind == "f" else float(np.iinfo(data.dtype).max) + 1
    middle = scale / 2 if data.dtype.kind == "u" else 0.0
    scale = scale / 2 if data.dtype.kind == "u" else scale

    def read(start: int, count: int) -> Samples:
        return (np.asarray(data[start : start + count], float) - middle) / scale

    return Audio(int(rate), len(data), data.shape[1], f"WAV of {data.dtype.name}", read)


def _by_soundfile(source: pathlib.Path | bytes) -> Audio | None:
    """Return any format that soundfile reads; None if it is not installed.

    The file is decoded once, in order, into a temporary file. After a seek in a coded file,
    decoders return wrong samples for some milliseconds.
    """
    try:
        import soundfile
    except ImportError:
        return None
    with soundfile.SoundFile(_file(source)) as file, tempfile.TemporaryFile() as decoded:
        rate, channels, kind = file.samplerate, file.channels, str(file.format)
        for block in file.blocks(_BLOCK, dtype="float32", always_2d=True):
            decoded.write(np.ascontiguousarray(block).data)
        decoded.flush()
        frames = decoded.tell() // (4 * channels)
        if not frames:
            return Audio(rate, 0, channels, kind, lambda start, count: np.zeros((0, channels)))
        data = np.memmap(decoded, np.float32, "r", shape=(frames, channels))

    def read(start: int, count: int) -> Samples:
        return np.asarray(data[start : start + count], float)

    return Audio(rate, frames, channels, kind, read)


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
