"""Coverage of intervals of e, scale and tilt for video tracks: `python -m benchmarks tracks`.

Tracks are simulated with known impacts, independently of the library: a ball falls, bounces and
drifts, a rolled camera records it with an exposure that blurs, and a tracker reads its centre with
noise and mistakes. They are read as a user would; the constant e is fitted like `calibrate`. The
study counts the impacts found, tracks with an invented impact, and the coverage of 95 % intervals.
These cover the e of each impact and of all, the scale and the tilt. Tracks without an impact, in
air, and of a rolled camera without x follow.
"""

from __future__ import annotations

import io
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

import jaxcontact as jc
from benchmarks.lab.sound import constant_e
from benchmarks.study import grouped, inside, middle, percent, share, study_of
from jaxcontact._flight import Flight
from jaxcontact.lab.recordings import make_pairs, tracks_of

GRAVITY = 9.81
RATES = (30, 50, 60, 100, 120, 240, 500, 1000)
KINDS = ("opencv", "trackpy", "tracker", "heights")
"""How a track is saved: frames and pixels downwards (two), seconds and metres, heights alone."""

SHORTEST = 0.02
"""In s: with shorter flights the ball lies still."""

_PARTS, _STEPS = 8, 200


class Truth(NamedTuple):
    """What was simulated: `text` of the file and its `kind`; the times `impact` (m,) of it in s, in
    the middle of each contact, and the `flight` (m + 1,) in s before and after each; `seen`
    (m + 1,), how many frames of each flight the file has, and its `height` over the noise; the e of
    each impact, `ratio` (m,), their median `e`, and the `scatter` of ln e; the `noise` in pixels;
    `scale` of a unit of the file in m; `tilt` in degrees, NaN without x; `terminal` speed in m/s.
    """

    text: str
    kind: str
    rate: int
    impact: np.ndarray
    flight: np.ndarray
    seen: np.ndarray
    height: np.ndarray
    ratio: np.ndarray
    e: float
    scatter: float
    noise: float
    outliers: float
    scale: float
    tilt: float
    terminal: float


class Air(NamedTuple):
    """Flights with quadratic drag, by the `terminal` speed in m/s, infinite in a vacuum."""

    terminal: float

    def rising(self, launch: np.ndarray) -> np.ndarray:
        """The time to the top of a flight."""
        if np.isinf(self.terminal):
            return launch / GRAVITY
        return self.terminal / GRAVITY * np.arctan(launch / self.terminal)

    def top(self, launch: np.ndarray) -> np.ndarray:
        """The height of a flight."""
        if np.isinf(self.terminal):
            return launch**2 / (2 * GRAVITY)
        return self.terminal**2 / (2 * GRAVITY) * np.log1p((launch / self.terminal) ** 2)

    def landing(self, launch: np.ndarray) -> np.ndarray:
        """The speed with which a flight ends."""
        return launch / np.sqrt(1 + (launch / self.terminal) ** 2)

    def duration(self, launch: np.ndarray) -> np.ndarray:
        """Of a whole flight."""
        if np.isinf(self.terminal):
            return 2 * launch / GRAVITY
        fallen = np.arctanh(self.landing(launch) / self.terminal)
        return self.rising(launch) + self.terminal / GRAVITY * fallen

    def height(self, since: np.ndarray, launch: np.ndarray) -> np.ndarray:
        """At a time since the launch, before the landing."""
        if np.isinf(self.terminal):
            return since * (launch - GRAVITY / 2 * since)
        rate, rising = GRAVITY / self.terminal, self.rising(launch)
        up, down = np.minimum(since, rising), np.maximum(since - rising, 0)
        left = np.cos(rate * (rising - up)) / np.cos(rate * rising)
        return self.terminal**2 / GRAVITY * (np.log(left) - np.log(np.cosh(rate * down)))

    def drifted(
        self, edge: np.ndarray, start: np.ndarray, launch: np.ndarray, drift: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Times, and places along the floor: the speed falls by e^(-g s/v²) on a way s up and down.

        Flight k begins at `start` with the speed `drift`, and ends in the last of two edges.
        """
        times, places = [edge[:1]], [np.zeros(1)]
        for k in range(start.size):
            t = np.linspace(edge[k], edge[k + 1], _STEPS)
            way = np.abs(np.diff(self.height(np.maximum(t - start[k], 0), launch[k]), prepend=0.0))
            way[0] = 0.0
            speed = drift[k] * np.exp(-GRAVITY / self.terminal**2 * np.cumsum(way))
            x = places[-1][-1] + np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(t))
            times.append(t[1:])
            places.append(x)
        return np.concatenate(times), np.concatenate(places)


def draw(
    random: np.random.Generator,
    *,
    kind: str | None = None,
    bounces: bool = True,
    air: bool = False,
    rolled: float | None = None,
    swings: bool = False,
    rises: float = 0.0,
    nearer: float = 0.0,
) -> Truth:
    """One track; without bounces the ball is let go and caught, or swings.

    The camera is rolled by up to `rolled` degrees: 10, but heights alone are taken level. While it
    looks, the floor `rises` in the picture by a part of the first height; the ball comes `nearer`
    by a part of its distance, seen from as high as it falls.
    """
    kind = kind or str(random.choice(KINDS))
    if rolled is None:
        rolled = 0.0 if kind == "heights" else 10.0
    rate = int(random.choice(RATES))
    e = random.uniform(0.5, 0.95)
    scatter = 0.0 if random.random() < 0.5 else 10 ** random.uniform(-3, -2)
    height = random.uniform(0.3, 1.5)
    air_of = Air(random.uniform(7, 20) if air else np.inf)
    speed = [np.sqrt(2 * GRAVITY * height)]  # of launches
    most = int(random.integers(1, 9)) if bounces else 0
    ratios = []
    while len(speed) <= most and 2 * speed[-1] * e / GRAVITY > SHORTEST:
        ratios.append(e * np.exp(scatter * random.normal()))
        speed.append(air_of.landing(speed[-1]) * ratios[-1])
    speed = np.array(speed)
    count = speed.size - 1
    height = float(air_of.top(speed[0]))
    flight, rising = air_of.duration(speed), float(air_of.rising(speed[0]))
    power = random.uniform(0, 0.2)  # of a shell, and by Hertz
    landing = air_of.landing(speed[:-1])
    contact = 10 ** random.uniform(-3.3, -2.1) * (landing / landing[:1]) ** -power
    held = random.uniform(0.1, 0.5) if random.random() < 0.6 else 0.0
    release = held + random.uniform(0.0, 0.1)
    start = np.zeros(count + 1)  # of each flight; the first is virtual
    start[0] = release - rising
    for k in range(count):
        start[k + 1] = start[k] + flight[k] + contact[k]
    # It is caught in the last flight and held for a while, or the camera stops before.
    caught = start[-1] + flight[-1] * random.uniform(0.35 if count else 0.6, 0.9)
    if swings:
        caught += random.uniform(1, 3)
    end = caught + (random.uniform(0.1, 0.4) if random.random() < 0.5 else 0.0)
    begin = 0.0 if held or random.random() < 0.5 else release + 0.25 * random.random() * flight[0]
    drift = random.uniform(-0.4, 0.4) * np.cumprod(np.r_[1, random.uniform(0.6, 1.05, count)])
    # Friction acts in the middle of a contact.
    edge = np.r_[release, start[1:] - contact / 2, caught]
    drifted = air_of.drifted(edge, start, speed, drift)

    def height_at(t: np.ndarray) -> np.ndarray:
        t = np.minimum(t, caught)
        k = np.clip(np.searchsorted(start[1:], t, "right"), 0, count)
        since = t - start[k]
        y = air_of.height(since, speed[k])
        if count:
            # In contact before flight k + 1: half a sine below the floor.
            one = np.minimum(k, count - 1)
            part = np.clip((since - flight[k]) / contact[one], 0, 1)
            dip = -landing[one] * contact[one] / np.pi * np.sin(np.pi * part)
            y = np.where((since > flight[k]) & (k < count), dip, y)
        return np.where(t < release, height, y)

    n = max(int((end - begin) * rate), 1)
    frame = np.arange(n)
    time = begin + (frame + random.random()) / rate
    blur = random.uniform(0.05, 0.9) / rate * (np.arange(_PARTS) - (_PARTS - 1) / 2) / _PARTS
    many = time[:, None] + blur
    y, x = height_at(many).mean(axis=1), np.interp(many, *drifted).mean(axis=1)
    if swings:
        many *= random.uniform(0.5, 3)
        y = height * (1 + np.exp(-many / 5) * np.cos(2 * np.pi * many)).mean(axis=1) / 2
    since = (time - time.mean()) / max(float(np.ptp(time)), 1e-9) if n > 1 else 0 * time
    y = y + rises * height * since + nearer * since * (y - height)
    pixels = random.uniform(150, 1200) / height  # per metre
    tilt = np.radians(random.uniform(-1, 1) * rolled)
    u, v = x * np.cos(tilt) - y * np.sin(tilt), x * np.sin(tilt) + y * np.cos(tilt)
    noise = 10 ** random.uniform(-1, np.log10(2.0))
    place = pixels * np.stack([u, v], axis=1) + noise * random.normal(size=(n, 2))
    share = random.uniform(0, 0.05) if random.random() < 0.6 else 0.0
    off = random.random(n) < share
    low, high = place.min(axis=0) - 50, place.max(axis=0) + 50
    place[off] = random.uniform(low, high, size=(int(off.sum()), 2))
    there = random.random(n) >= random.uniform(0, 0.1) * (random.random() < 0.5)
    text, scale = _file(random, kind, frame, rate, place, there, pixels)
    k = np.searchsorted(start[1:], time, "right")
    inside = (time > start[k] + 0.5 / rate) & (time < (start + flight)[k] - 0.5 / rate)
    inside &= (time > release) & (time < caught) & there & ~off
    return Truth(
        text,
        kind,
        rate,
        (start[1:] - contact / 2) - time[0] if n else np.zeros(0),
        flight,
        np.bincount(k[inside], minlength=count + 1),
        pixels * air_of.top(speed) / noise,
        np.array(ratios),
        e,
        scatter,
        noise,
        share,
        scale,
        float(np.degrees(tilt)) if kind != "heights" else np.nan,
        air_of.terminal,
    )


def _file(
    random: np.random.Generator,
    kind: str,
    frame: np.ndarray,
    rate: int,
    place: np.ndarray,
    there: np.ndarray,
    pixels: float,
) -> tuple[str, float]:
    """The text of a file, and what a unit of its lengths is in m."""
    down = place * [1, -1] + [400, 1000]
    if kind == "opencv":
        # A frame without the ball has empty cells.
        lines = [
            f"{k},{a:.2f},{b:.2f}" if ok else f"{k},,"
            for k, (a, b), ok in zip(frame, down, there, strict=True)
        ]
        return "\n".join(["frame,x,y", *lines]) + "\n", 1 / pixels
    if kind == "trackpy":
        head = ",y,x,mass,size,ecc,signal,raw_mass,ep,frame,particle"
        lines = [
            f"{k},{b:.3f},{a:.3f},900.1,2.1,0.1,30.0,1200.0,0.1,{k},0"
            for k, (a, b), ok in zip(frame, down, there, strict=True)
            if ok
        ]
        return "\n".join([head, *lines]) + "\n", 1 / pixels
    wrong = 1 + random.uniform(-0.03, 0.03)  # how well the stick of Tracker was laid
    up = place / pixels * wrong
    if kind == "tracker":
        lines = [
            f"{k / rate:.6E}\t{a:.6E}\t{b:.6E}"
            for k, (a, b), ok in zip(frame, up, there, strict=True)
            if ok
        ]
        return "\n".join(["mass_A", "t\tx\ty", *lines]) + "\n", 1 / wrong
    lines = [
        f"{k / rate:.6f};{b:.5f}" for k, (_, b), ok in zip(frame, up, there, strict=True) if ok
    ]
    return "\n".join(["time (s);height (m)", *lines]) + "\n", 1 / wrong


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
