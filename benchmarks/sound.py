"""Coverage of intervals of e for recordings of sound: `python benchmarks/sound.py`.

2000 recordings are simulated with known impacts (see sound_truths.py) and read as a user would; the
constant e is fitted like `calibrate`. The study counts the bounces found, recordings with an
invented bounce, and the coverage of the 95 % interval of e. Recordings with speech, and without any
bounce, follow. The results are written to benchmarks/sound.json. `--only N` draws fewer and writes
nothing, `--page` writes the table of docs/sound.md from the result.
"""

from __future__ import annotations

import io
import itertools
import math
import sys
import time
from pathlib import Path

import numpy as np
from scipy.special import stdtrit

# Works from another folder too.
sys.path.insert(0, str(Path(__file__).parents[1]))

import jaxcontact as jc
from benchmarks.sound_truths import Truth, as_wave, draw
from benchmarks.study import command
from jaxcontact._flight import Flight
from jaxcontact.lab.choice.table import errors_of
from jaxcontact.lab.pairs.outliers import find_outliers
from jaxcontact.lab.pairs.pairs import LEAST_PAIRS
from jaxcontact.lab.recordings import make_pairs

SEED = 20
DRAWS = 2000
OTHERS = 200
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
        "snr": truth.words["snr"],
        "rate": truth.rate,
        "scatter": truth.scatter,
        "strong": int(strong.sum()),
        "used": int((near(used) & strong).sum()),
        "found": int(((near(used) | near(doubtful)) & strong).sum()),
        "invented": bool(invented),
        "fitted": found is not None,
        "holds": found is not None and bool(abs(found[0] - math.log(truth.e)) <= found[1]),
        "off": None if found is None else (found[0] - math.log(truth.e)) / found[1],
        "half": None if found is None else found[1],
        "pairs": 0 if found is None else found[2],
        "seconds": truth.samples.size / truth.rate,
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


def study(draws: int, others: int) -> dict:
    """All recordings: whole, by noise, and the other two kinds."""
    begin = time.process_time()
    rows = [one_of(np.random.default_rng([SEED, k])) for k in range(draws)]
    seconds = time.process_time() - begin
    by_level = {
        f"{low} to {high} dB": summary([row for row in rows if low <= row["snr"] < high])
        for low, high in itertools.pairwise(LEVELS)
    }
    spread = {
        "no scatter of e": summary([row for row in rows if row["scatter"] == 0]),
        "scatter of e": summary([row for row in rows if row["scatter"] > 0]),
        "4 to 6 pairs": summary([row for row in rows if 4 <= row["pairs"] <= 6]),
        "7 pairs and more": summary([row for row in rows if row["pairs"] > 6]),
        "8 to 16 kHz": summary([row for row in rows if row["rate"] <= 16000]),
        "22 to 48 kHz": summary([row for row in rows if row["rate"] > 16000]),
    }
    speech = [one_of(np.random.default_rng([SEED, 1, k]), speech=True) for k in range(others)]
    silent = [one_of(np.random.default_rng([SEED, 2, k]), bounces=False) for k in range(others)]
    talk = [
        one_of(np.random.default_rng([SEED, 3, k]), bounces=False, speech=True)
        for k in range(others)
    ]
    return {
        "seed": SEED,
        "all": summary(rows),
        **by_level,
        **spread,
        "with speech": summary(speech),
        "no ball": summary(silent),
        "speech, no ball": summary(talk),
        "seconds of sound": sum(row["seconds"] for row in rows),
        "seconds of one core": round(seconds, 1),
        "off, quantiles of 5, 25, 50, 75, 95 %": list(
            np.quantile(
                [row["off"] for row in rows if row["fitted"]], (0.05, 0.25, 0.5, 0.75, 0.95)
            )
        ),
    }


def page(result: dict) -> str:
    """The table of docs/sound.md."""
    head = (
        "| recordings | of them fitted | e in its 95 % interval | median half interval of e "
        "| bounces above 6 dB | found | found and used | none invented |"
    )
    lines = [head, "|---|" + "---:|" * 7]
    for name, row in result.items():
        if not isinstance(row, dict):
            continue
        half = row["half interval of e, relative, median"]
        few = row["fitted"] < FEW
        bounces = row["bounces above 6 dB"]
        cells = (
            f"{name}: {row['recordings']}",
            str(row["fitted"]),
            "-" if few else f"{100 * row['in interval']:.1f} %",
            "-" if few else f"{100 * half:.2g} %",
            str(bounces),
            f"{100 * row['found']:.1f} %" if bounces else "-",
            f"{100 * row['found and used']:.1f} %" if bounces else "-",
            f"{100 * row['none invented']:.1f} %",
        )
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


if __name__ == "__main__":
    title = __doc__.split("\n")[0]
    command("sound", study, page, draws=DRAWS, others=OTHERS, title=title)
