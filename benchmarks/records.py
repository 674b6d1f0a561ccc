"""Coverage of intervals of e and K for impacts in long records: `python -m benchmarks records`.

Records of force plates and accelerometers are simulated with known impacts (see record_truths.py).
They are read as a user would, and fitted like `calibrate` with the true kind of law. The study
counts the impacts found, records with an invented impact, and the coverage of 95 % intervals. These
cover the e and the v of each impact, and the e and the K of all. Records without impacts follow.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import jax
import numpy as np
from scipy.special import stdtrit

import jaxcontact as jc
from benchmarks.record_truths import GRAVITY, Truth, draw
from benchmarks.study import percent
from benchmarks.study_of_draws import SURE, grouped, inside, middle, share, study_of
from jaxcontact._flight import Flight
from jaxcontact.lab.choice.kinds import kinds_of
from jaxcontact.lab.choice.table import ChoiceTable
from jaxcontact.lab.pairs.pairs import LEAST_PAIRS
from jaxcontact.lab.records.impacts import Fitted, errors_of_impacts, fitted_impacts

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
