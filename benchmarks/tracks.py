"""Coverage of intervals of e, scale and tilt for video tracks: `python -m benchmarks tracks`.

Tracks are simulated with known impacts (see track_truths.py) and read as a user would; the constant
e is fitted like `calibrate`. The study counts the impacts found, tracks with an invented impact,
and the coverage of 95 % intervals. These cover the e of each impact and of all, the scale and the
tilt. Tracks without an impact, in air, and of a rolled camera without x follow.
"""

from __future__ import annotations

import io
import math
from collections.abc import Callable

import numpy as np

import jaxcontact as jc
from benchmarks.sound import constant_e
from benchmarks.study import percent
from benchmarks.study_of_draws import grouped, inside, middle, share, study_of
from benchmarks.track_truths import GRAVITY, Truth, draw
from jaxcontact._flight import Flight
from jaxcontact.lab.recordings import make_pairs, tracks_of

SEED = 47
DRAWS = 800
EACH = 80
FRAMES, STANDS_OUT = 5, 10.0
"""A clear impact has so many frames of both flights, which rise so many times the noise."""

FEW = 20


def read(truth: Truth) -> jc.Recording | None:
    """The recording; None where nothing is found in it."""
    rate = truth.rate if truth.kind in ("opencv", "trackpy") else None
    try:
        return jc.read_recording(io.StringIO(truth.text), rate=rate)
    except jc.RecordingError:
        return None


def flight_of(truth: Truth) -> Flight:
    """With the drag that was simulated, which is said to be known."""
    if not math.isfinite(truth.terminal):
        return Flight(GRAVITY, None)
    drag = jc.Drag(mass=1.0, radius=1.0, coefficient=1.0)
    mass = (truth.terminal / drag.terminal_speed(GRAVITY)) ** 2
    return Flight(GRAVITY, jc.Drag(mass=mass, radius=1.0, coefficient=1.0))


def clear(truth: Truth) -> np.ndarray:
    """Which impacts (m,) have flights on both sides that can be seen."""
    good = (truth.seen >= FRAMES) & (truth.height >= STANDS_OUT)
    return good[:-1] & good[1:]


def each_impact(truth: Truth, recording: jc.Recording) -> list[tuple[int, bool, float]]:
    """The number of each impact that is used, -1 where it is invented; whether the interval holds
    its e; and the relative error of its e.
    """
    pairs = make_pairs(recording, flight_of(truth))
    found = []
    for k, (first, _) in enumerate(pairs.records):
        off = np.abs(truth.impact - first.drop.impact[first.number])
        near = int(np.argmin(off)) if off.size and off.min() < 1 / truth.rate else -1
        error = math.sqrt(pairs.covariance[k, k])
        log = math.log(pairs.restitution[k])
        found.append((near, near >= 0 and inside(log, error, math.log(truth.ratio[near])), error))
    return found


def one_of(random: np.random.Generator, **how: object) -> dict:
    """What came of one simulated track."""
    truth = draw(random, **how)
    recording = read(truth)
    visible = clear(truth)
    row = {
        "rate": truth.rate,
        "noise": truth.noise,
        "along": truth.kind != "heights",
        "scatter": truth.scatter,
        "misread": truth.outliers > 0,
        "clear": int(visible.sum()),
        "found": 0,
        "invented": False,
        "impacts": [],
        "cameras": [],
        "fitted": False,
    }
    if recording is None:
        return row
    each = each_impact(truth, recording)
    there = {near for near, _, _ in each}
    row["found"] = sum(int(k) in there for k in np.flatnonzero(visible))
    row["invented"] = -1 in there
    row["impacts"] = [(holds, error) for near, holds, error in each if near >= 0]
    for drop in tracks_of(recording.records)[0].drops:
        camera = drop.camera
        scale = inside(camera.fall * truth.scale, camera.fall_error * truth.scale, GRAVITY)
        tilt = None
        if camera.tilt is not None:
            tilt = inside(math.degrees(camera.tilt), math.degrees(camera.tilt_error), truth.tilt)
        row["cameras"].append((scale, tilt))
    whole = constant_e(recording, flight_of(truth))
    if whole is not None:
        holds = abs(whole[0] - math.log(truth.e)) <= whole[1]
        row |= {"fitted": True, "holds": holds, "half": whole[1]}
    return row


def summary(rows: list[dict]) -> dict:
    """Counts and shares of some tracks."""
    fitted = [row for row in rows if row["fitted"]]
    visible = sum(row["clear"] for row in rows)
    impacts = [one for row in rows for one in row["impacts"]]
    cameras = [one for row in rows for one in row["cameras"]]
    tilts = [tilt for _, tilt in cameras if tilt is not None]
    return {
        "tracks": len(rows),
        "clear impacts": visible,
        "found": sum(row["found"] for row in rows) / visible if visible else None,
        "none invented": 1 - sum(row["invented"] for row in rows) / max(len(rows), 1),
        "impacts": len(impacts),
        "e of an impact in its interval": share([holds for holds, _ in impacts]),
        "error of e of an impact, relative, median": middle([error for _, error in impacts]),
        "fitted": len(fitted),
        "constant e in its interval": share([row["holds"] for row in fitted]),
        "half interval of the constant e, relative, median": middle([r["half"] for r in fitted]),
        "cameras": len(cameras),
        "scale in its interval": share([one[0] for one in cameras]),
        "tilt in its interval": share(tilts),
    }


GROUPS: dict[str, Callable[[dict], bool]] = {
    "30 to 60 frames/s": lambda row: row["rate"] <= 60,
    "100 to 240 frames/s": lambda row: 100 <= row["rate"] <= 240,
    "500 and 1000 frames/s": lambda row: row["rate"] >= 500,
    "noise of 0.1 to 0.5 px": lambda row: row["noise"] < 0.5,
    "noise of 0.5 to 2 px": lambda row: row["noise"] >= 0.5,
    "with x": lambda row: row["along"],
    "heights alone": lambda row: not row["along"],
    "no scatter of e": lambda row: row["scatter"] == 0,
    "scatter of e": lambda row: row["scatter"] > 0,
    "no misreadings": lambda row: not row["misread"],
    "misreadings": lambda row: row["misread"],
}


OTHERS = {
    "in air, known": {"air": True},
    "heights alone, camera rolled by up to 3°": {"kind": "heights", "rolled": 3.0},
    "let go and caught, no impact": {"bounces": False},
    "a pendulum, no impact": {"bounces": False, "swings": True},
    "the floor rises by 2.3 % of the first height": {"rises": 0.023},
    "the ball comes nearer by 2.3 %": {"nearer": 0.023},
}


def measure(known: dict | None, only: int | None) -> dict:
    """All tracks: whole, in groups, and the other kinds."""
    return grouped(SEED, one_of, summary, GROUPS, OTHERS, DRAWS, EACH, only)


def known_of(name: str, count: str, digits: str = ".1f") -> Callable[[dict], str]:
    return lambda row: percent(row[name], row[count] < FEW, digits)


COLUMNS = {
    "tracks": lambda row: f"{row['name']}: {row['tracks']}",
    "clear impacts": lambda row: row["clear impacts"],
    "found": known_of("found", "clear impacts"),
    "none invented": known_of("none invented", "tracks"),
    "e of an impact in its interval": known_of("e of an impact in its interval", "impacts"),
    "constant e in its interval": known_of("constant e in its interval", "fitted"),
    "scale": known_of("scale in its interval", "cameras"),
    "tilt": known_of("tilt in its interval", "cameras"),
    "median error of e of an impact": known_of(
        "error of e of an impact, relative, median", "impacts", ".2f"
    ),
}
STUDY = study_of(__file__, __doc__, measure, COLUMNS)
