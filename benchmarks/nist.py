"""NIST's nonlinear regression problems by `jc.fit` and SciPy: `python -m benchmarks nist`.

`nist_data.json` contains 27 problems with two starts each, and parameters certified to 11 digits.
Source: the Statistical Reference Datasets of the National Institute of Standards and Technology
(public domain), https://www.itl.nist.gov/div898/strd/nls/nls_main.shtml.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy import optimize

import jaxcontact as jc
from benchmarks.study import Study, by_line, lines

DATA = Path(__file__).with_name("nist_data.json")
CERTIFIED, ENOUGH = 11, 6
"""Digits that NIST gives, and that count as found."""


def exponential_rise(b, x):
    return b[0] * (1 - jnp.exp(-b[1] * x))


def decay_over_line(b, x):
    return jnp.exp(-b[0] * x) / (b[1] + b[2] * x)


def peaks(b, x):
    decay = b[0] * jnp.exp(-b[1] * x)
    first = b[2] * jnp.exp(-(((x - b[3]) / b[4]) ** 2))
    return decay + first + b[5] * jnp.exp(-(((x - b[6]) / b[7]) ** 2))


def three_decays(b, x):
    return sum(b[i] * jnp.exp(-b[i + 1] * x) for i in (0, 2, 4))


def cubic_over_cubic(b, x):
    above = b[0] + x * (b[1] + x * (b[2] + x * b[3]))
    return above / (1 + x * (b[4] + x * (b[5] + x * b[6])))


def quadratic_over_quadratic(b, x):
    return (b[0] + x * (b[1] + x * b[2])) / (1 + x * (b[3] + x * b[4]))


def waves(b, x):
    return b[0] + sum(
        b[i] * jnp.cos(2 * jnp.pi * x / period) + b[j] * jnp.sin(2 * jnp.pi * x / period)
        for i, j, period in ((1, 2, 12.0), (4, 5, b[3]), (7, 8, b[6]))
    )


MODELS: dict[str, Callable[[Any, Any], Any]] = {
    "Bennett5": lambda b, x: b[0] * (b[1] + x) ** (-1 / b[2]),
    "BoxBOD": exponential_rise,
    "Chwirut1": decay_over_line,
    "Chwirut2": decay_over_line,
    "DanWood": lambda b, x: b[0] * x ** b[1],
    "ENSO": waves,
    "Eckerle4": lambda b, x: b[0] / b[1] * jnp.exp(-0.5 * ((x - b[2]) / b[1]) ** 2),
    "Gauss1": peaks,
    "Gauss2": peaks,
    "Gauss3": peaks,
    "Hahn1": cubic_over_cubic,
    "Kirby2": quadratic_over_quadratic,
    "Lanczos1": three_decays,
    "Lanczos2": three_decays,
    "Lanczos3": three_decays,
    "MGH09": lambda b, x: b[0] * x * (x + b[1]) / (x * (x + b[2]) + b[3]),
    "MGH10": lambda b, x: b[0] * jnp.exp(b[1] / (x + b[2])),
    "MGH17": lambda b, x: b[0] + b[1] * jnp.exp(-x * b[3]) + b[2] * jnp.exp(-x * b[4]),
    "Misra1a": exponential_rise,
    "Misra1b": lambda b, x: b[0] * (1 - 1 / (1 + b[1] * x / 2) ** 2),
    "Misra1c": lambda b, x: b[0] * (1 - 1 / jnp.sqrt(1 + 2 * b[1] * x)),
    "Misra1d": lambda b, x: b[0] * b[1] * x / (1 + b[1] * x),
    "Nelson": lambda b, x: b[0] - b[1] * x[0] * jnp.exp(-b[2] * x[1]),
    "Rat42": lambda b, x: b[0] / (1 + jnp.exp(b[1] - b[2] * x)),
    "Rat43": lambda b, x: b[0] / (1 + jnp.exp(b[1] - b[2] * x)) ** (1 / b[3]),
    "Roszman1": lambda b, x: b[0] - b[1] * x - jnp.arctan(b[2] / (x - b[3])) / jnp.pi,
    "Thurber": cubic_over_cubic,
}


def problems() -> dict[str, dict[str, Any]]:
    """The starts, certified parameters and data of each problem; Nelson's model is of log y."""
    found = json.loads(DATA.read_text())
    for name, problem in found.items():
        y = np.array(problem["y"])
        problem.update(x=np.array(problem["x"]), y=np.log(y) if name == "Nelson" else y)
    return found


def digits(values: Any, certified: Any) -> float:
    """The digits to which all parameters agree with the certified ones, at most 11."""
    error = np.max(np.abs(np.asarray(values) / np.asarray(certified) - 1))
    return round(float(-np.log10(max(error, 10.0**-CERTIFIED))), 1)


def by_jaxcontact(name: str, problem: dict[str, Any], start: list[float]) -> dict[str, Any]:
    found = jc.fit(MODELS[name], problem["y"], np.array(start), x=problem["x"], throw=False)
    deviations = np.array(list(found.standard_errors.values()))
    return {
        "digits": digits(found.values, problem["certified"]),
        "deviations": digits(deviations, problem["deviations"]),
        "converged": found.converged,
        "steps": found.steps,
        "reason": found.reason,
    }


def by_scipy(name: str, problem: dict[str, Any], start: list[float], best: bool) -> Any:
    """The digits by MINPACK's lm in `curve_fit`, None if it gives up.

    As it is called by most, or at its best: exact derivatives, no tolerance and no limit.
    """
    model = jax.jit(MODELS[name])
    slope = jax.jit(jax.jacfwd(model))
    options: dict[str, Any] = dict.fromkeys(("ftol", "xtol", "gtol"), 1e-15)
    options |= {"maxfev": 100_000, "jac": lambda x, *b: np.asarray(slope(jnp.array(b), x))}
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        try:
            values, _ = optimize.curve_fit(
                lambda x, *b: np.asarray(model(jnp.array(b), x)),
                problem["x"],
                problem["y"],
                start,
                **(options if best else {}),
            )
        except RuntimeError:
            return None
    return digits(values, problem["certified"])


def table(rows: list[dict[str, Any]]) -> str:
    """A line for each problem and its two starts; what does not reach 6 digits is in bold."""

    def shown(number: float | None) -> str:
        if number is None:
            return "**gives up**"
        return f"{number:.1f}" if number >= ENOUGH else f"**{max(number, 0):.1f}**"

    found = []
    for one, two in zip(rows[::2], rows[1::2], strict=True):
        cells = [one["problem"], one["parameters"]]
        for row in (one, two):
            digits = shown(row["digits"]) if row["converged"] else "**says no**"
            cells += [f"{digits} ({row['steps']})", shown(row["scipy"])]
            cells.append(shown(row["scipy at best"]))
        found.append(cells)
    header = ["jc.fit (steps)", "SciPy", "SciPy at best"]
    starts = [f"start {n}: {h}" for n in (1, 2) for h in header]
    return lines(["problem", "parameters", *starts], found)


def measure(known: list | None) -> list[dict[str, Any]]:
    rows = []
    for name, problem in problems().items():
        for number, start in enumerate(problem["starts"], 1):
            row = {"problem": name, "parameters": len(start), "start": number}
            row |= by_jaxcontact(name, problem, start)
            row["scipy"] = by_scipy(name, problem, start, best=False)
            row["scipy at best"] = by_scipy(name, problem, start, best=True)
            print(row, flush=True)
            rows.append(row)
    return rows


STUDY = Study(__file__, __doc__, measure, text=by_line)
