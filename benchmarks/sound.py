"""Coverage of intervals of e for recordings of sound: `python -m benchmarks sound`.

2000 recordings are simulated with known impacts (see sound_truths.py) and read as a user would; the
constant e is fitted like `calibrate`. The study counts the bounces found, recordings with an
invented bounce, and the coverage of the 95 % interval of e. Recordings with speech, and without any
bounce, follow.
"""

from __future__ import annotations

import io
import itertools
import math
from collections.abc import Callable

import numpy as np
from scipy.special import stdtrit

import jaxcontact as jc
from benchmarks.sound_truths import Truth, as_wave, draw
from benchmarks.study import percent
from benchmarks.study_of_draws import grouped, study_of
from jaxcontact._flight import Flight
from jaxcontact.lab.choice.table import errors_of
from jaxcontact.lab.pairs.outliers import find_outliers
from jaxcontact.lab.pairs.pairs import LEAST_PAIRS
from jaxcontact.lab.recordings import make_pairs

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
