"""Coverage of intervals of e for recordings of sound: `python -m benchmarks sound`.

2000 recordings are simulated with known impacts, independently of the library: a ball that rings in
a few modes is struck by half sines of force, whose duration grows as v^(-1/5), in a room with hum,
noise and reverberation. They are read as a user would; the constant e is fitted like `calibrate`.
The study counts the bounces found, recordings with an invented bounce, and the coverage of the 95 %
interval of e. Recordings with speech, and without any bounce, follow.
"""

from __future__ import annotations

import io
import itertools
import math
import wave
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy import signal
from scipy.special import stdtrit

import jaxcontact as jc
from benchmarks.study import grouped, percent, study_of
from jaxcontact._flight import Flight
from jaxcontact.lab.choice.table import errors_of
from jaxcontact.lab.pairs.outliers import find_outliers
from jaxcontact.lab.pairs.pairs import LEAST_PAIRS
from jaxcontact.lab.recordings import make_pairs

GRAVITY = 9.81
RATES = (8000, 11025, 16000, 22050, 32000, 44100, 48000)
LOUDNESS = 5e-3
"""In s: the level of a bounce is the mean square of its sound over so long, against the noise."""

LAST_FLIGHT = 0.02
"""In s: shorter flights are not simulated; the ball is caught."""


class Truth(NamedTuple):
    """What was simulated: samples (n,) from -1 to 1, the times of impact (m,) in s, the level (m,)
    of each over the noise in dB; the restitution, the scatter of ln e, and the level of the first
    bounce over the noise in dB.
    """

    rate: int
    samples: np.ndarray
    time: np.ndarray
    level: np.ndarray
    e: float
    scatter: float
    snr: float


def draw(random: np.random.Generator, *, speech: bool = False, bounces: bool = True) -> Truth:
    """One recording; with `speech` in the background, or without any bounce."""
    rate = int(random.choice(RATES))
    e = random.uniform(0.55, 0.93)
    scatter = 0.0 if random.random() < 0.5 else 10 ** random.uniform(-3.5, -2)
    first, start = random.uniform(0.25, 0.7), random.uniform(0.2, 0.8)
    flights = [first]
    while flights[-1] > LAST_FLIGHT and sum(flights) < 6:
        flights.append(flights[-1] * e * np.exp(scatter * random.normal()))
    speed = GRAVITY * np.array(flights) / 2 / e  # closing speed, without the scatter
    ball = _ball(random, rate)
    # The interval between touches includes the contact.
    whole = np.array(flights) + ball.contact * (speed / speed[0]) ** -0.2
    time = start + np.concatenate([[0], np.cumsum(whole[:-1])])
    seconds = time[-1] + random.uniform(0.3, 0.8)
    n = round(seconds * rate)
    dry, own = np.zeros(n + rate), []
    for t, v in zip(time, speed, strict=True):
        at = int(np.ceil(t * rate))
        sound = ball(v, v / speed[0], (np.arange(ball.samples) + at) / rate - t)
        dry[at : at + sound.size] += sound[: dry.size - at]
        own.append(np.mean(sound[: round(LOUDNESS * rate)] ** 2))
    dry = dry[:n]
    room = _room(random, rate)
    wet = signal.oaconvolve(dry, room)[:n] if room.size > 1 else dry
    snr = random.uniform(10, 40)
    level = np.sqrt(own[0]) * 10 ** (-snr / 20)
    noise = level * _noise(random, n, rate)
    x = (wet if bounces else 0) + noise
    if random.random() < 0.7:
        x = x + level * 10 ** random.uniform(-0.5, 0.5) * _hum(random, n, rate)
    if speech:
        x = x + np.sqrt(own[0]) * 10 ** (-random.uniform(6, 20) / 20) * _speech(random, n, rate)
    x = x / np.max(np.abs(x)) * 10 ** random.uniform(-1.5, -0.05)
    if random.random() < 0.15:
        most = np.max(np.abs(x)) * random.uniform(0.4, 0.9)
        x = np.clip(x, -most, most)
    over = 10 * np.log10(np.array(own) / level**2)
    if not bounces:
        time, over = time[:0], over[:0]
    return Truth(rate, np.round(x * 32767) / 32768, time, over, e, scatter, snr)


class _Ball(NamedTuple):
    """The sound of one ball: `ball(speed, share of the first speed, times)`."""

    random: np.random.Generator
    frequency: np.ndarray
    decay: np.ndarray
    weight: np.ndarray
    contact: float
    jitter: float
    samples: int

    def __call__(self, speed: float, share: float, t: np.ndarray) -> np.ndarray:
        """Modes from rest under a half sine of force of the duration τ, from t = 0 on.

        q'' + ω² q = sin(πt/τ) while it lasts, then free: in closed form, with the decay put on.
        """
        tau = self.contact * share**-0.2
        p, w = np.pi / tau, 2 * np.pi * self.frequency[:, None]
        w = np.where(np.abs(w / p - 1) < 1e-4, w * 1.001, w)
        held = (p * np.sin(w * t) - w * np.sin(p * t)) / (p**2 - w**2)
        free = p * (np.sin(w * t) + np.sin(w * (t - tau))) / (p**2 - w**2)
        q = np.where(t < tau, held, free) * w * np.exp(-t / self.decay[:, None])
        own = self.weight * (1 + self.jitter * self.random.normal(size=self.weight.size))
        return share * np.exp(0.1 * self.random.normal()) * (own @ q)


def _ball(random: np.random.Generator, rate: int) -> _Ball:
    count = 6
    lowest = 10 ** random.uniform(2.6, 3.5)
    frequency = lowest * np.concatenate([[1], random.uniform(1.2, 6, count - 1)])
    frequency = np.minimum(frequency, random.uniform(0.3, 0.45, count) * rate)
    decay = random.uniform(2e-3, 20e-3, count)
    weight = random.normal(size=count) * (lowest / frequency) ** 0.5
    contact = 10 ** random.uniform(-4.3, -3.1)
    samples = round(6 * decay.max() * rate)
    return _Ball(random, frequency, decay, weight, contact, random.uniform(0.0, 0.2), samples)


def _room(random: np.random.Generator, rate: int) -> np.ndarray:
    """The response of a room: the direct sound, a tail of noise, and sometimes one echo."""
    rt60 = random.uniform(0.0, 0.5)
    response = np.zeros(max(round(rt60 * rate), 1))
    if rt60 > 3e-3:
        t = np.arange(response.size) / rate
        tail = random.normal(size=t.size) * 10 ** (-3 * t / rt60) * (t > 1e-3)
        direct = 10 ** (random.uniform(0, 15) / 10)
        response = tail / np.sqrt(np.sum(tail**2) * direct)
        if random.random() < 0.3:
            k = round(random.uniform(0.01, 0.06) * rate)
            if k < response.size:
                response[k] += random.uniform(0.3, 0.7)
    response[0] = 1.0
    return response


def _noise(random: np.random.Generator, n: int, rate: int) -> np.ndarray:
    """Noise of the mean square 1 whose power falls as f^-a, from 20 Hz on."""
    size = 1 << (n - 1).bit_length()
    f = np.fft.rfftfreq(size, 1 / rate)
    shape = np.maximum(f, 20.0) ** (-random.uniform(0, 1.5) / 2)
    x = np.fft.irfft(np.fft.rfft(random.normal(size=size)) * shape, size)[:n]
    return x / np.sqrt(np.mean(x**2))


def _hum(random: np.random.Generator, n: int, rate: int) -> np.ndarray:
    t, f = np.arange(n) / rate, random.choice([50.0, 60.0])
    x = sum(
        10 ** (-random.uniform(0, 1.0) * (k - 1) / 2)
        * np.sin(2 * np.pi * (k * f * t + random.random()))
        for k in range(1, 7)
    )
    return x / np.sqrt(np.mean(x**2))


def _speech(random: np.random.Generator, n: int, rate: int) -> np.ndarray:
    """Syllables: pulses of a voice through two formants, and hisses, with pauses."""
    t, x = np.arange(n) / rate, np.zeros(n)
    at = random.uniform(0, 0.3)
    while at < n / rate:
        length = random.uniform(0.08, 0.3)
        k = slice(int(at * rate), min(int((at + length) * rate), n))
        if random.random() < 0.7:
            pitch = random.uniform(90, 220) * (1 + random.uniform(-0.1, 0.1) * (t[k] - at) / length)
            source = np.diff(np.floor(np.cumsum(pitch) / rate), prepend=0.0)
        else:
            source = 0.2 * random.normal(size=t[k].size)
        for low, high in ((250, 900), (900, min(2800, 0.4 * rate))):
            f, width = random.uniform(low, high), random.uniform(60, 150)
            r = np.exp(-np.pi * width / rate)
            source = signal.lfilter(
                [1 - r], [1, -2 * r * np.cos(2 * np.pi * f / rate), r**2], source
            )
        if source.size:
            source = source * np.sin(np.pi * np.arange(source.size) / source.size) ** 0.5
            x[k] += source / (np.sqrt(np.mean(source**2)) + 1e-12)
        at += length + random.exponential(0.12)
    return x / np.sqrt(np.mean(x**2) + 1e-12)


def as_wave(truth: Truth) -> bytes:
    """A WAV file of 16 bits."""
    file = io.BytesIO()
    with wave.open(file, "wb") as out:
        out.setnchannels(1)
        out.setsampwidth(2)
        out.setframerate(truth.rate)
        out.writeframes(np.round(truth.samples * 32768).clip(-32768, 32767).astype("<i2").tobytes())
    return file.getvalue()


SEED = 20
DRAWS = 2000
EACH = 200
SAME = 3e-3
"""In s: a time that is further from every impact is invented."""

STANDS_OUT = 6.0
FEW = 20
LEVELS = (10, 20, 30, 40)


def constant_e(
    recording: jc.Recording, flight: Flight | None = None
) -> tuple[float, float, int] | None:
    """ln e, the half of its 95 % interval, and the number of pairs; None where they are too few.

    Generalised least squares, as `calibrate` fits a constant e (see `compared`).
    """
    pairs = make_pairs(recording, flight or Flight())
    if len(pairs) < LEAST_PAIRS:
        return None
    outliers = find_outliers(pairs)
    keep = ~outliers.flagged
    if keep.sum() < LEAST_PAIRS:
        return None
    errors = errors_of(pairs, outliers, keep)
    size = errors.sigma
    whole = (errors.correlation * np.outer(size, size))[np.ix_(keep, keep)]
    y, n = np.log(pairs.restitution[keep]), int(keep.sum())
    factor = np.linalg.cholesky(whole)
    one, z = np.linalg.solve(factor, np.ones(n)), np.linalg.solve(factor, y)
    mean = float(one @ z / (one @ one))
    scale = float(np.sum((z - one * mean) ** 2)) / (n - 1)
    return mean, float(stdtrit(n - 1, 0.975)) * math.sqrt(scale / float(one @ one)), n


def heard(truth: Truth) -> tuple[jc.Recording | None, np.ndarray, np.ndarray]:
    """The recording, the times that are used, and the doubtful ones that are listed."""
    try:
        recording = jc.read_recording(io.BytesIO(as_wave(truth)))
    except jc.RecordingError:
        return None, np.zeros(0), np.zeros(0)
    sound = recording.sound
    used = np.array([one.time for drop in sound.drops for one in drop])
    doubtful = np.array([one.time for one in sound.others if one.doubtful])
    return recording, used, doubtful


def one_of(random: np.random.Generator, **how: bool) -> dict:
    """What came of one simulated recording."""
    truth = draw(random, **how)
    recording, used, doubtful = heard(truth)

    def near(times: np.ndarray) -> np.ndarray:
        return np.array([times.size and np.min(np.abs(times - t)) < SAME for t in truth.time], bool)

    strong = truth.level >= STANDS_OUT
    invented = [t for t in used if not (truth.time.size and np.min(abs(truth.time - t)) < SAME)]
    found = None if recording is None else constant_e(recording)
    return {
        "snr": truth.snr,
        "rate": truth.rate,
        "scatter": truth.scatter,
        "strong": int(strong.sum()),
        "used": int((near(used) & strong).sum()),
        "found": int(((near(used) | near(doubtful)) & strong).sum()),
        "invented": bool(invented),
        "fitted": found is not None,
        "holds": found is not None and bool(abs(found[0] - math.log(truth.e)) <= found[1]),
        "half": None if found is None else found[1],
        "pairs": 0 if found is None else found[2],
    }


def summary(rows: list[dict]) -> dict:
    """Counts and shares of some recordings."""
    fitted = [row for row in rows if row["fitted"]]
    strong = sum(row["strong"] for row in rows)
    half = [row["half"] for row in fitted]
    return {
        "recordings": len(rows),
        "fitted": len(fitted),
        "in interval": sum(row["holds"] for row in fitted) / max(len(fitted), 1),
        "half interval of e, relative, median": float(np.median(half)) if half else None,
        "bounces above 6 dB": strong,
        "found": sum(row["found"] for row in rows) / max(strong, 1),
        "found and used": sum(row["used"] for row in rows) / max(strong, 1),
        "none invented": 1 - sum(row["invented"] for row in rows) / max(len(rows), 1),
    }


GROUPS: dict[str, Callable[[dict], bool]] = {
    **{
        f"{low} to {high} dB": lambda row, low=low, high=high: low <= row["snr"] < high
        for low, high in itertools.pairwise(LEVELS)
    },
    "no scatter of e": lambda row: row["scatter"] == 0,
    "scatter of e": lambda row: row["scatter"] > 0,
    "4 to 6 pairs": lambda row: 4 <= row["pairs"] <= 6,
    "7 pairs and more": lambda row: row["pairs"] > 6,
    "8 to 16 kHz": lambda row: row["rate"] <= 16000,
    "22 to 48 kHz": lambda row: row["rate"] > 16000,
}
OTHERS = {
    "with speech": {"speech": True},
    "no ball": {"bounces": False},
    "speech, no ball": {"bounces": False, "speech": True},
}


def measure(known: dict | None, only: int | None) -> dict:
    """All recordings: whole, in groups, and the other kinds."""
    return grouped(SEED, one_of, summary, GROUPS, OTHERS, DRAWS, EACH, only)


HALF = "half interval of e, relative, median"
COLUMNS = {
    "recordings": lambda row: f"{row['name']}: {row['recordings']}",
    "of them fitted": lambda row: row["fitted"],
    "e in its 95 % interval": lambda row: percent(row["in interval"], row["fitted"] < FEW),
    "median half interval of e": lambda row: percent(row[HALF], row["fitted"] < FEW, ".2g"),
    "bounces above 6 dB": lambda row: row["bounces above 6 dB"],
    "found": lambda row: percent(row["found"], not row["bounces above 6 dB"]),
    "found and used": lambda row: percent(row["found and used"], not row["bounces above 6 dB"]),
    "none invented": lambda row: percent(row["none invented"]),
}
STUDY = study_of(__file__, __doc__, measure, COLUMNS)
