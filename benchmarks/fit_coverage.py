"""Coverage of intervals: `python -m benchmarks fit_coverage`.

Data are simulated from a known truth and fitted as a user would. The study counts how often the 95
% interval of each parameter, and the bands of the prediction, contain the truth. An interrupted run
continues. `python -m benchmarks fit_adequacy --page` writes docs/trust.md from the result.
"""

from __future__ import annotations

import math
import time
import zlib
from collections.abc import Callable, Iterator

import jax.numpy as jnp
import numpy as np

import jaxcontact as jc
from benchmarks.fit_truths import bounces, drops, held, records, trials
from benchmarks.study import Study
from jaxcontact._fit.uncertainty.interval import held_at, quantile_of

SEED = 1
WANTED = 0.93, 0.97

Draw = Callable[[np.random.Generator], dict[str, bool | None]]
"""One simulated measurement: for each quantity, whether its interval holds the truth; None where
the fit did not converge.
"""


def decay(p, x):
    return p["a"] * jnp.exp(-p["b"] * x) + p["c"]


def slowing(p, v):
    """The restitution 1 - b v^p."""
    return 1 - p["b"] * v ** p["p"]


def curves() -> Iterator[tuple[str, Draw]]:
    """Small samples: two curves, at 5, 8 and 20 points, with the noise known and unknown."""
    models = {
        "decay": (decay, {"a": 2.5, "b": 1.3, "c": 0.5}, (0.0, 4.0), 0.05, None),
        "1 - b v^p": (slowing, {"b": 0.2, "p": 0.25}, (0.05, 5.0), 0.004, jc.Positive()),
    }
    for name, (model, truth, ends, sigma, transforms) in models.items():
        for n in (5, 8, 20):
            for known in (False, True):
                noise = "known" if known else "unknown"
                draw = curve_of(model, truth, ends, sigma, transforms, n, known)
                yield f"{name}, {n} points, σ {noise}", draw


def curve_of(model, truth, ends, sigma, transforms, n, known) -> Draw:
    x = np.geomspace(*ends, n) if ends[0] > 0 else np.linspace(*ends, n)
    places = np.quantile(x, (0.1, 0.5, 0.9))
    clean, there = np.asarray(model(truth, x)), np.asarray(model(truth, places))
    start = {name: 0.8 * value for name, value in truth.items()}
    how = {"sigma": sigma} if known else {}

    def draw(random: np.random.Generator) -> dict[str, bool | None]:
        y = clean + sigma * random.normal(size=n)
        found = jc.fit(model, y, start, x=x, transforms=transforms, throw=False, **how)
        new = there + sigma * random.normal(size=places.size)
        if not found.converged:
            return dict.fromkeys([*truth, "curve", "new reading"])
        shown = held(found, truth)
        for name, band, value in (
            ("curve", found.confidence_band, there),
            ("new reading", found.prediction_band, new),
        ):
            low, high = band(places)
            # One place per draw, so that the draws are independent.
            i = int(random.integers(places.size))
            shown[name] = bool(low[i] <= value[i] <= high[i])
        return shown

    return draw


def record_cells() -> Iterator[tuple[str, Draw]]:
    for name, simulate, truth in records():

        def draw(random: np.random.Generator, simulate=simulate, truth=truth):
            found = simulate(random)
            if not found.converged:
                return dict.fromkeys(truth)
            return beyond(found, truth)

        yield f"record, {name}", draw


def beyond(found: jc.Fit, truth: dict[str, float]) -> dict[str, bool | None]:
    """Whether the ends of intervals lie beyond the truth, which needs no search for them."""
    rows = np.diag([truth.get(name, np.nan) for name in found.names])
    rows[rows == 0] = np.nan
    deviation, _ = held_at(found, rows, np.tile(found._theta, (len(rows), 1)))
    inside = deviation <= quantile_of(found._absolute, found.dof, 0.95)
    return {name: bool(inside[found.names.index(name)]) for name in truth}


def cells() -> dict[str, Draw]:
    wrong = ((f"bounces, {name}", draw) for name, draw in bounces())
    shared = ((f"triggers, {name}", draw) for name, draw in trials())
    heights = ((f"heights, {name}", draw) for name, draw in drops())
    return dict([*curves(), *record_cells(), *wrong, *shared, *heights])


def run(name: str, draw: Draw, draws: int, seed: int) -> dict:
    """The share of draws in which each quantity is held, of those that converged."""
    random = np.random.default_rng([seed, zlib.crc32(name.encode())])
    begun = time.perf_counter()
    found = [draw(random) for _ in range(draws)]
    good = [one for one in found if None not in one.values()]
    shares = {key: float(np.mean([one[key] for one in good])) for key in found[0]} if good else {}
    return {
        "draws": draws,
        "converged": len(good) / draws,
        "shares": shares,
        "seconds": round(time.perf_counter() - begun, 1),
    }


def shown(cell: dict) -> str:
    # Two standard deviations of a fraction of the draws.
    blur = 2 * math.sqrt(0.95 * 0.05 / cell["draws"])
    parts = []
    for name, share in cell["shares"].items():
        off = "" if WANTED[0] <= share <= WANTED[1] else " !" if abs(share - 0.95) > blur else " ?"
        parts.append(f"{name} {100 * share:.1f}{off}")
    return f"converged {100 * cell['converged']:.1f}; " + ", ".join(parts)


def measure(known: dict | None, draws: int, only: str) -> Iterator[dict]:
    result = known or {"seed": SEED, "cells": {}}
    for name, draw in cells().items():
        count = draws // 4 if name.startswith("bounces") else draws
        if only in name and result["cells"].get(name, {}).get("draws") != count:
            result["cells"][name] = cell = run(name, draw, count, SEED)
            print(f"{name}: {shown(cell)}", flush=True)
            yield result


OPTIONS = {"--draws": {"type": int, "default": 2000}, "--only": {"default": ""}}
STUDY = Study(__file__, __doc__, measure, options=OPTIONS)
