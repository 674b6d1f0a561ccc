"""Coverage of intervals of e and K for impacts in long records: `python benchmarks/records.py`.

Records of force plates and accelerometers are simulated with known impacts (see record_truths.py).
They are read as a user would, and fitted like `calibrate` with the true kind of law. The study
counts the impacts found, records with an invented impact, and the coverage of 95 % intervals. These
cover the e and the v of each impact, and the e and the K of all. Records without impacts follow.
The results are written to benchmarks/records.json. `--only N` draws fewer and writes nothing,
`--page` writes the table of docs/records.md from the result.
"""

from __future__ import annotations

import json
import math
import sys
import time
from pathlib import Path

import jax
import numpy as np
from scipy.special import stdtrit

# Works from another folder too.
sys.path.insert(0, str(Path(__file__).parents[1]))

import jaxcontact as jc
from benchmarks.record_truths import GRAVITY, Truth, draw
from benchmarks.study import command
from jaxcontact._flight import Flight
from jaxcontact.lab.choice.kinds import kinds_of
from jaxcontact.lab.choice.table import ChoiceTable
from jaxcontact.lab.pairs.pairs import LEAST_PAIRS
from jaxcontact.lab.records.impacts import Fitted, errors_of_impacts, fitted_impacts

SEED = 31
DRAWS = 380
EMPTY = 100
STANDS_OUT = 10.0
SURE = 1.959964
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


def inside(value: float, error: float, truth: float, quantile: float = SURE) -> bool:
    """Whether the 95 % interval holds the truth."""
    return bool(abs(value - truth) <= quantile * error)


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
                "K": inside(*one.stiffness, truth.stiffness),
                "error": one.restitution.error / one.restitution.value,
                "adequate": one.adequate is not False,
            }
        )
    agrees = any("agrees with the n" in note for note in found.notes)
    told = any("of the clearest record has n" in note for note in found.notes)
    whole = one_law(truth, found)
    return {
        "fitted": True,
        "each": each,
        "whole": whole,
        "n": len(found.fits),
        "exponent": agrees or not told,
    }


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

    def share(some: list[dict], name: str) -> float | None:
        return sum(one[name] for one in some) / len(some) if some else None

    return {
        "records": len(rows),
        "fitted": len(whole),
        "impacts": sum(row["strong"] for row in rows),
        "found": sum(row["found"] for row in rows) / max(sum(row["strong"] for row in rows), 1),
        "none invented": sum(not row["invented"] for row in rows) / max(len(rows), 1),
        "impacts fitted": len(each),
        "e of each": share(each, "e"),
        "v of each": share(each, "v"),
        "K of each": share(each, "K"),
        "described": share(each, "adequate"),
        "exponent agrees": share([row for row in rows if row["fitted"]], "exponent"),
        "error of e, median": float(np.median([one["error"] for one in each])) if each else None,
        "e of all": share(whole, "e"),
        "K of all": share(whole, "K"),
        "half interval of e, median": (
            float(np.median([one["half e"] for one in whole])) if whole else None
        ),
        "half interval of K, median": (
            float(np.median([one["half K"] for one in whole])) if whole else None
        ),
    }


def study(draws: int, empty: int) -> dict:
    """All records: whole, and by what was done to them."""
    begin, rows = time.process_time(), []
    nothing = (draw(np.random.default_rng([SEED, 1, k]), impacts=False) for k in range(empty))
    quiet = sum(read(one) is None for one in nothing)
    for k in range(draws):
        rows.append(one_of(np.random.default_rng([SEED, k])))
        if k % 10 == 9:
            print(k + 1, json.dumps(summary(rows)), file=sys.stderr, flush=True)
    seconds = time.process_time() - begin
    parts = {
        "1 impact": [row for row in rows if row.get("n") == 1],
        "2 or 3 impacts": [row for row in rows if row.get("n") in (2, 3)],
        "4 impacts and more": [row for row in rows if row.get("n", 0) > 3],
        "20 to 100 readings a contact": [row for row in rows if row["per contact"] < 100],
        "100 to 500": [row for row in rows if row["per contact"] >= 100],
        "noise of 0.2 to 1 %": [row for row in rows if row["noise"] < 0.01],
        "1 to 5 %": [row for row in rows if row["noise"] >= 0.01],
        "with hum": [row for row in rows if row["hum"] > 0],
        "cut off by the instrument": [row for row in rows if row["clipped"]],
        "the ball lies there at the end": [row for row in rows if row["lies"]],
        "a constant e": [row for row in rows if row["kind"] == "constant e"],
        "a constant c": [row for row in rows if row["kind"] == "constant c"],
    }
    return {
        "seed": SEED,
        "draws": len(rows),
        "all": summary(rows),
        **{name: summary(some) for name, some in parts.items()},
        "records without impacts": empty,
        "of them none is invented": quiet / max(empty, 1),
        "seconds of one core": round(seconds, 1),
    }


def page(result: dict) -> str:
    """The table of docs/records.md."""
    head = (
        "| records | impacts | found | none invented | e of each | v of each | e of all | K of all "
        "| half interval of e | of K |"
    )
    lines = [head, "|---|" + "---:|" * 9]

    def percent(number: float | None, few: bool = False) -> str:
        return "-" if number is None or few else f"{100 * number:.1f} %"

    for name, row in result.items():
        if not isinstance(row, dict):
            continue
        few = row["fitted"] < FEW
        cells = (
            f"{name}: {row['records']}",
            str(row["impacts"]),
            percent(row["found"]),
            percent(row["none invented"]),
            percent(row["e of each"], few),
            percent(row["v of each"], few),
            percent(row["e of all"], few),
            percent(row["K of all"], few),
            *(
                "-" if few else f"{100 * row[f'half interval of {one}, median']:.2g} %"
                for one in ("e", "K")
            ),
        )
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


if __name__ == "__main__":
    title = __doc__.split("\n")[0]
    command("records", study, page, draws=DRAWS, others=EMPTY, title=title)
