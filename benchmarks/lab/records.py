"""Coverage of intervals of e and K for impacts in long records: `python -m benchmarks records`.

Records of force plates and accelerometers are simulated with known impacts, independently of the
library: SciPy integrates each impact, m δ'' = -K δ^(3/2) (1 + a δ'), with a constant a (constant
damping) or a = α/v₀ (constant e). They are read as a user would, and fitted like `calibrate` with
the true kind of law. The study counts the impacts found, records with an invented impact, and the
coverage of 95 % intervals. These cover the e and the v of each impact, and the e and the K of all.
Records without impacts follow.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import jax
import numpy as np
from scipy.special import stdtrit

import jaxcontact as jc
from benchmarks.study import SURE, grouped, inside, middle, percent, share, study_of
from benchmarks.until_event import contact
from jaxcontact._flight import Flight
from jaxcontact.lab.choice.kinds import kinds_of
from jaxcontact.lab.choice.table import ChoiceTable
from jaxcontact.lab.pairs.pairs import LEAST_PAIRS
from jaxcontact.lab.records.impacts import Fitted, errors_of_impacts, fitted_impacts

GRAVITY = 9.81


class Truth(NamedTuple):
    """What was simulated: readings (n,) in N or m/s² at a `rate` in Hz, the `quantity`; the mass in
    kg, the stiffness in N/m^(3/2), a law's `kind`; of each impact time in s, closing speed in m/s,
    e, and the largest force over the noise of one reading; and what else was done, in words.
    """

    rate: float
    reading: np.ndarray
    quantity: str
    mass: float
    stiffness: float
    kind: str
    time: np.ndarray
    velocity: np.ndarray
    e: np.ndarray
    height: np.ndarray
    words: dict[str, float | bool]


def impact(mass: float, stiffness: float, a: float, speed: float) -> tuple[np.ndarray, ...]:
    """Times (m,) and forces (m,) of one impact, and the speed after it."""
    scale = (mass * speed**2 / stiffness) ** 0.4
    unit = scale / speed

    # In units of the speed, and of the indentation of an elastic collision.
    found = contact(
        lambda x, v: -(x**1.5) * (1 + a * speed * v), 1e-10, atol=1e-3, stop=60, first=1e-3,
        dense_output=True,
    )  # fmt: skip
    t = np.linspace(0, found.t[-1], 4000)
    depth, velocity = found.sol(t)
    force = np.maximum(depth, 0) ** 1.5 * (1 + a * speed * velocity)
    return t * unit, np.maximum(force, 0) * stiffness * scale**1.5, -found.y[1, -1] * speed


def draw(random: np.random.Generator, *, impacts: bool = True) -> Truth:
    """One record: bounces that follow each other, or impacts at times of their own."""
    mass = 10 ** random.uniform(-2.3, 0)
    speed = random.uniform(1.0, 5.0)
    count = int(random.integers(1, 9))
    duration = 10 ** random.uniform(-3.7, -2.3)
    stiffness = mass * (2.94 / duration) ** 2.5 / (1.25 * speed**0.5)
    per = 10 ** random.uniform(np.log10(20), np.log10(500))
    rate = float(np.clip(per / duration, 2e3, 2e5))
    noise = 10 ** random.uniform(np.log10(0.002), np.log10(0.05))
    kind = str(random.choice(["constant e", "constant c"]))
    first = random.uniform(0.5, 0.95)
    alpha = 1.5 * (1 - first) / first
    quantity = str(random.choice(["force", "acceleration"]))
    bounces = bool(random.random() < 0.7)
    pieces, speeds, ratios, times = [], [], [], []
    at = random.uniform(3, 20) * duration
    for _ in range(count):
        a = alpha / speed if kind == "constant e" else alpha / (speeds[0] if speeds else speed)
        time, force, after = impact(mass, stiffness, a, speed)
        if bounces and 2 * after / GRAVITY < 4 * time[-1]:
            break
        pieces.append((at, time, force))
        times.append(at)
        speeds.append(speed)
        ratios.append(after / speed)
        # Long flights are shortened: they are empty, and the record would have millions of
        # readings.
        flight = 2 * after / GRAVITY if bounces else np.inf
        at += time[-1] + min(flight, random.uniform(10, 60) * duration)
        speed = after if bounces else speed * random.uniform(0.6, 1.1)
    end = at + random.uniform(6, 30) * duration
    clock = np.arange(int(end * rate)) / rate
    contact = np.zeros(clock.size)
    for start, time, force in pieces if impacts else []:
        contact += np.interp(clock - start, time, force, left=0, right=0)
    top = max(float(force.max()) for _, _, force in pieces)
    lies = bool(random.random() < 0.3) and quantity == "force"
    if lies:
        contact[clock > end - 3 * duration] += mass * GRAVITY
    hum = float(random.choice([0.0, random.uniform(0, 3) * noise]))
    sigma = noise * top
    reading = contact + hum * top * np.sin(2 * np.pi * 50 * clock + random.uniform(0, 6))
    reading += random.uniform(-1, 1) * top + sigma * random.normal(size=clock.size)
    # The largest impact is clipped at 70 to 95 % of its height.
    clipped = bool(random.random() < 0.15)
    if clipped:
        limit = float(np.median(reading)) + random.uniform(0.7, 0.95) * top
        reading = np.minimum(reading, limit)
    if quantity == "acceleration":
        reading = reading / mass
    turned = bool(random.random() < 0.5) and not clipped
    height = np.array([float(force.max()) for _, _, force in pieces]) / sigma
    words = {
        "noise": noise,
        "per contact": float(rate * duration),
        "hum": hum,
        "clipped": clipped,
        "lies": lies,
        "bounces": bounces,
    }
    return Truth(
        *(rate, -reading if turned else reading, quantity, mass, stiffness, kind),
        *map(np.array, (times, speeds, ratios)),
        *(height, words),
    )


SEED = 31
DRAWS = 380
EMPTY = 100
STANDS_OUT = 10.0
FEW = 20


def read(truth: Truth) -> jc.Recording | None:
    """The recording; None where nothing is found in it."""
    columns = {truth.quantity: truth.reading}
    try:
        return jc.read_recording(rate=truth.rate, **columns)
    except jc.RecordingError:
        return None


def found_in(truth: Truth, recording: jc.Recording | None) -> tuple[np.ndarray, int, int]:
    """Which impacts (m,) were found, which number were listed as doubtful, which were invented."""
    if recording is None:
        return np.zeros(truth.time.size, bool), 0, 0
    duration = [one.duration for one in recording.records]
    at = np.array([one.trace.time[0] + one.touch * one.trace.step for one in recording.records])
    near = np.abs(at[:, None] - truth.time) < 0.5 * np.median(duration)
    return (
        near.any(axis=0),
        len(recording.records[0].trace.doubtful),
        int((~near.any(axis=1)).sum()),
    )


def calibrated(truth: Truth, recording: jc.Recording) -> dict:
    """What intervals hold, of each impact and of all."""
    with jax.enable_x64(True):
        try:
            contact = jc.Contact(truth.mass, 1.0, 1.5)
            found = fitted_impacts(recording, contact, Flight(GRAVITY, None), lambda text: None)
        except jc.RecordingError:
            return {"fitted": False}
    each = []
    for one in found.fits:
        k = int(np.argmin(np.abs(truth.time - one.touch)))
        each.append(
            {
                "e": inside(*one.restitution, float(truth.e[k])),
                "v": inside(*one.velocity, float(truth.velocity[k])),
            }
        )
    return {"fitted": True, "each": each, "whole": one_law(truth, found), "n": len(found.fits)}


def one_law(truth: Truth, found: Fitted) -> dict:
    """Whether the intervals of the law's parameter and of K hold the truth.

    The fit of the true kind of law is made as `calibrate` makes it, without the others.
    """
    constant_e, constant_c = kinds_of("constant_damping", 1.5)
    kind = constant_e if truth.kind == "constant e" else constant_c
    keep = np.ones(len(found.fits), bool)
    few = len(keep) < LEAST_PAIRS
    errors = errors_of_impacts(found, keep)._replace(absolute=few)
    fit = ChoiceTable(found.pairs, keep, errors, found.contact, options={"groups": None}).fit(kind)
    if not fit.converged or not np.isfinite(fit.covariance).all():
        return {"converged": False}
    quantile = SURE if few else float(stdtrit(fit.dof, 0.975))
    name = next(iter(kind.parameters))
    value, error = (float(one[name]) for one in (fit.params, fit.standard_errors))
    k, error_k = (float(one["stiffness"]) for one in (fit.params, fit.standard_errors))
    # For c the contact that defines its units is given.
    scale = 1 / float(found.contact.stiffness) if name == "c" else 1.0
    expected = float(truth.e[0]) if name == "e" else slope_of(truth)
    return {
        "converged": True,
        "e": inside(scale * value, scale * error, expected, quantile),
        "K": inside(k, error_k, truth.stiffness, quantile),
        "half e": quantile * error / value,
        "half K": quantile * error_k / k,
    }


def slope_of(truth: Truth) -> float:
    """c/K of a constant damping, from the e of the first impact: α (1 + e) = ln((1 + α)/(1 - α e)).

    The equation is that of Hunt and Crossley's force, solved by bisection.
    """
    e, low, high = float(truth.e[0]), 1e-9, 1 / float(truth.e[0]) - 1e-9
    for _ in range(200):
        middle = (low + high) / 2
        more = math.log((1 + middle) / (1 - middle * e)) > middle * (1 + e)
        low, high = (low, middle) if more else (middle, high)
    return low / float(truth.velocity[0])


def one_of(random: np.random.Generator, *, fit: bool = True) -> dict:
    """What came of one simulated record."""
    truth = draw(random)
    recording = read(truth)
    found, doubtful, invented = found_in(truth, recording)
    strong = truth.height >= STANDS_OUT
    row = {
        **truth.words,
        "kind": truth.kind,
        "strong": int(strong.sum()),
        "found": int((found & strong).sum()),
        "doubtful": doubtful,
        "invented": invented,
        "fitted": False,
    }
    return row | (calibrated(truth, recording) if fit and recording is not None else {})


def summary(rows: list[dict]) -> dict:
    """Counts and shares of some records."""
    each = [one for row in rows if row["fitted"] for one in row["each"]]
    whole = [row["whole"] for row in rows if row["fitted"] and row["whole"]["converged"]]

    def of(some: list[dict], name: str) -> float | None:
        return share([one[name] for one in some])

    return {
        "records": len(rows),
        "fitted": len(whole),
        "impacts": sum(row["strong"] for row in rows),
        "found": sum(row["found"] for row in rows) / max(sum(row["strong"] for row in rows), 1),
        "none invented": sum(not row["invented"] for row in rows) / max(len(rows), 1),
        "impacts fitted": len(each),
        "e of each": of(each, "e"),
        "v of each": of(each, "v"),
        "e of all": of(whole, "e"),
        "K of all": of(whole, "K"),
        "half interval of e, median": middle([one["half e"] for one in whole]),
        "half interval of K, median": middle([one["half K"] for one in whole]),
    }


GROUPS: dict[str, Callable[[dict], bool]] = {
    "1 impact": lambda row: row.get("n") == 1,
    "2 or 3 impacts": lambda row: row.get("n") in (2, 3),
    "4 impacts and more": lambda row: row.get("n", 0) > 3,
    "20 to 100 readings a contact": lambda row: row["per contact"] < 100,
    "100 to 500": lambda row: row["per contact"] >= 100,
    "noise of 0.2 to 1 %": lambda row: row["noise"] < 0.01,
    "1 to 5 %": lambda row: row["noise"] >= 0.01,
    "with hum": lambda row: row["hum"] > 0,
    "cut off by the instrument": lambda row: row["clipped"],
    "the ball lies there at the end": lambda row: row["lies"],
    "a constant e": lambda row: row["kind"] == "constant e",
    "a constant c": lambda row: row["kind"] == "constant c",
}


def measure(known: dict | None, only: int | None) -> dict:
    """All records, whole and by what was done to them, and those without impacts."""
    found = grouped(SEED, one_of, summary, GROUPS, {}, DRAWS, 0, only)
    empty = max(only // 10, 5) if only else EMPTY
    nothing = (draw(np.random.default_rng([SEED, 1, k]), impacts=False) for k in range(empty))
    quiet = sum(read(one) is None for one in nothing)
    return {
        **found,
        "records without impacts": empty,
        "of them none is invented": quiet / empty,
    }


def known_of(name: str, digits: str = ".1f") -> Callable[[dict], str]:
    return lambda row: percent(row[name], row["fitted"] < FEW, digits)


COLUMNS = {
    "records": lambda row: f"{row['name']}: {row['records']}",
    "impacts": lambda row: row["impacts"],
    "found": lambda row: percent(row["found"]),
    "none invented": lambda row: percent(row["none invented"]),
    **{name: known_of(name) for name in ("e of each", "v of each", "e of all", "K of all")},
    "half interval of e": known_of("half interval of e, median", ".2g"),
    "of K": known_of("half interval of K, median", ".2g"),
}
STUDY = study_of(__file__, __doc__, measure, COLUMNS)
