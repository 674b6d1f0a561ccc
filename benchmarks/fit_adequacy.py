"""Rate at which right and wrong models are called inadequate: `python -m benchmarks fit_adequacy`.

Levels: right models, with false alarms at 5 %. Power: a smooth misfit of known size is added to a
line or a parabola,

    λ = Σ (misfit left after the best fit / σ)²,

and the fraction of fits that are called inadequate is counted. Every draw is a call of `jc.fit`, as
a user makes it. docs/trust.md is written from the result and from those of fit_coverage.py,
fit_design.py, choice_confusion.py and nist.py.
"""

from __future__ import annotations

import contextlib
import io
import math
import platform
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np

import jaxcontact as jc
from benchmarks import fit_coverage, fit_design, nist
from benchmarks.lab import choice_confusion
from benchmarks.study import Study, lines, table

SEED = 1
SIGMA = 0.1
LEVELS = {8: 2000, 25: 2000, 200: 2000, 2000: 2000}
"""Draws by number of points."""
MISFITS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "square": np.square,
    "cube": lambda x: x**3,
    "sine": lambda x: np.sin(np.pi * x),
    "cosine": lambda x: np.cos(np.pi * x),
    "kink": lambda x: np.abs(x - 0.3),
    "exponential": lambda x: np.exp(2 * x),
}
"""Of x from -1 to 1: none slower than half a period, none faster than one."""
WANTED = (
    (12, 60, False),
    (25, 60, False),
    (50, 60, False),
    (100, 60, False),
    (400, 120, False),
    (25, 35, True),
    (100, 60, True),
)
"""Points, λ, and whether σ is known: 95 % wanted."""
CURVE = (0, 5, 10, 15, 20, 25, 30, 35, 45, 60, 80, 120)


def line(p, x):
    return p["a"] + p["b"] * x


def parabola(p, x):
    return p["a"] + p["b"] * x + p["c"] * x**2


def decay(p, x):
    return p["a"] * jnp.exp(-p["b"] * (x + 1))


MODELS: dict[str, tuple[Callable, dict[str, float]]] = {
    "line": (line, {"a": 1.0, "b": 2.0}),
    "parabola": (parabola, {"a": 1.0, "b": 2.0, "c": 0.5}),
    "decay": (decay, {"a": 3.0, "b": 1.2}),
}


def found(model: str, x: np.ndarray, y: np.ndarray, **how: Any) -> jc.Fit:
    predict, start = MODELS[model]
    return jc.fit(predict, y, start, x=x, throw=False, **how)


def truth(model: str, x: np.ndarray) -> np.ndarray:
    predict, start = MODELS[model]
    return np.asarray(predict(start, x))


def level(random: np.random.Generator, kind: str, n: int, draws: int) -> float:
    """The share of right models that are called inadequate."""
    model = "decay" if kind == "decay" else "line"
    how: dict[str, Any] = {"sigma": {"sigma": SIGMA}, "huber": {"loss": jc.Huber()}}.get(kind, {})
    x = np.linspace(-1, 1, n)
    if kind == "repeated":
        x = np.repeat(np.linspace(-1, 1, n // 4), 4)
    groups = None
    if kind == "trials":
        x, groups = np.tile(np.linspace(-1, 1, 4), n // 4), np.repeat(np.arange(n // 4), 4)
    clean, bad = truth(model, x), 0
    for _ in range(draws):
        noise = random.normal(size=n)
        if groups is not None:
            noise += 2 * random.normal(size=n // 4)[groups]
        bad += found(model, x, clean + SIGMA * noise, groups=groups, **how).adequate is False
    return bad / draws


def power(
    random: np.random.Generator,
    model: str,
    misfit: str,
    n: int,
    size: float,
    known: bool,
    draws: int,
) -> float:
    """The share of fits that are called inadequate with a misfit of λ = `size`."""
    x = np.linspace(-1, 1, n)
    columns = np.vander(x, 2 if model == "line" else 3)
    left = MISFITS[misfit](x)
    left = left - columns @ np.linalg.lstsq(columns, left, rcond=None)[0]
    left *= SIGMA * math.sqrt(size) / np.linalg.norm(left)
    how = {"sigma": SIGMA} if known else {}
    clean, seen = truth(model, x) + left, 0
    for _ in range(draws):
        seen += found(model, x, clean + SIGMA * random.normal(size=n), **how).adequate is False
    return seen / draws


def cells(model: str) -> list[str]:
    """The misfits that a model does not describe."""
    return [name for name in MISFITS if (model, name) != ("parabola", "square")]


def measure(known: dict | None, draws: int) -> Iterator[dict[str, Any]]:
    random = np.random.default_rng(SEED)
    result: dict[str, Any] = {"seed": SEED, "python": platform.python_version()}
    result |= {"levels": {}, "power": [], "curves": {}}
    few = max(draws // 5, 1)
    for n, known_size in ((25, False), (100, False), (25, True), (100, True)):
        curve = [power(random, "line", "square", n, size, known_size, few) for size in CURVE]
        result["curves"][f"{n} points, σ {'known' if known_size else 'unknown'}"] = curve
        print(n, known_size, curve, flush=True)
    for n, size, known_size in WANTED:
        shares = {
            f"{model} + {name}": power(random, model, name, n, size, known_size, few)
            for model in ("line", "parabola")
            for name in cells(model)
        }
        row = {"points": n, "lambda": size, "known": known_size, "draws": few, "shares": shares}
        result["power"].append(row)
        print(n, size, known_size, min(shares.items(), key=lambda one: one[1]), flush=True)
        yield result
    for kind in KINDS:
        sizes = [n for n in LEVELS if n < 2000 or kind == "unknown"]
        if kind in ("repeated", "trials"):
            sizes = [32, 200]
        for n in sizes:
            share = level(random, kind, n, draws)
            result["levels"].setdefault(kind, {})[str(n)] = {"share": share, "draws": draws}
            print(kind, n, share, flush=True)
            yield result


KINDS = {
    "unknown": "σ unknown",
    "sigma": "σ known",
    "huber": "Huber's loss",
    "repeated": "four points at each x",
    "trials": "trials of four points, correlated",
    "decay": "a decay instead of a line",
}


def page(result: dict[str, Any]) -> str:
    """docs/trust.md: words from fit_adequacy.md, and the tables of a result."""
    sizes = sorted({int(n) for row in result["levels"].values() for n in row})
    levels = [
        [name, *(percent(result["levels"][kind].get(str(n), {}).get("share")) for n in sizes)]
        for kind, name in KINDS.items()
    ]
    curves = [[name, *map(percent, shares)] for name, shares in result["curves"].items()]
    draws = {row["draws"] for kind in result["levels"].values() for row in kind.values()}
    words = Path(__file__).with_suffix(".md").read_text()
    coverage, plans = fit_coverage.STUDY.result(), fit_design.STUDY.result()
    choice, problems = choice_confusion.STUDY.result(), nist.STUDY.result()
    numbers = {
        "NIST": nist.table(problems),
        "NIST_LEAST": f"{min(row['digits'] for row in problems):.1f}",
        "CHOICE_SEED": str(choice["seed"]),
        "CHOICE_TABLES": f"{sum(cell['tables'] for cell in choice['cells'].values()):,}",
        "CONFUSION": confusion_table(choice),
        "SURE": sure_table(choice),
        **right_numbers(choice),
        "LEVELS": lines(["false alarms in %", *(f"n = {n}" for n in sizes)], levels),
        "POWER": table(POWER, result["power"]),
        "CURVES": lines(["seen in %, λ =", *map(str, CURVE)], curves),
        "DRAWS": f"{max(draws):,}",
        "FEW": f"{result['power'][0]['draws']:,}",
        "SEED": str(result["seed"]),
        "COVERAGE_SEED": str(coverage["seed"]),
        "COVERAGE": table(COVERAGE, coverage["cells"].items()),
        "DESIGN": design_table(plans),
        "DESIGN_DRAWS": str(plans["draws"]),
        "EXAMPLE": printed(words.split("```python\n")[1].split("```")[0]),
    }
    for name, text in numbers.items():
        words = words.replace("{" + name + "}", text)
    return words


def of_shares(shares: dict[str, float]) -> tuple[float, str, str]:
    """The mean of some shares, the least one, and those below 95 %."""
    worst = min(shares, key=shares.__getitem__)
    low = (f"{name} {percent(share)}" for name, share in shares.items() if share < 0.95)
    mean = sum(shares.values()) / len(shares)
    return mean, f"{percent(shares[worst])} ({worst})", ", ".join(low)


POWER: dict[str, Callable[[dict], Any]] = {
    "points": lambda row: row["points"],
    "λ": lambda row: row["lambda"],
    "σ": lambda row: "known" if row["known"] else "unknown",
    "mean, %": lambda row: percent(of_shares(row["shares"])[0]),
    "least, %": lambda row: of_shares(row["shares"])[1],
    "below 95 %": lambda row: of_shares(row["shares"])[2],
}


def confusion_table(result: dict[str, Any]) -> str:
    sums, found = choice_confusion.shares(result), choice_confusion.confusion(result)
    kinds = list(dict.fromkeys(kind for counts in found.values() for kind in counts))
    order = [truth.kind for truth in choice_confusion.TRUTHS.values()]
    kinds.sort(key=order.index)
    rows = []
    for truth, counts in found.items():
        count = sums.get(truth, {"tables": 1})["tables"]
        of = [percent(counts[kind] / count) if counts[kind] else "" for kind in kinds]
        rows.append([truth, *of, percent(1 - counts.total() / count)])
    return lines(["truth", *kinds, "not sure"], rows)


def sure_table(result: dict[str, Any]) -> str:
    rows = []
    for part, sums in sorted(choice_confusion.shares(result).items(), key=_place):
        most = 0.02 if part == "all" else 0.05
        wrong = sums["wrong"] / sums["tables"]
        text = percent(wrong) if wrong <= most else f"**{percent(wrong)}**"
        strict = percent(sums["strict"] / sums["tables"])
        right = sums["clear and right"] / sums["clear"] if sums["clear"] else None
        good = percent(right) if right is None or right >= 0.8 else f"**{percent(right)}**"
        rows.append([part, str(sums["tables"]), text, strict, str(sums["clear"]), good])
    header = ["tables", "number", "sure and wrong, %", "strict"]
    return lines([*header, "clear", "of these sure and right, %"], rows)


def right_numbers(result: dict[str, Any]) -> dict[str, str]:
    """How often the truth leaves the band of the right law, in all tables, the smallest and the
    largest ones; and how often its curve is strictly off.
    """
    sums = choice_confusion.shares(result)
    few, many = (f"{n} points" for n in (min(choice_confusion.SIZES), max(choice_confusion.SIZES)))
    parts = {"LEFT": "all", "LEFT_FEW": few, "LEFT_MANY": many}
    of = {name: percent(sums[part]["left"] / sums[part]["right"]) for name, part in parts.items()}
    of["STRICTLY"] = percent(sums["all"]["strictly left"] / sums["all"]["right"])
    return {"RIGHT": f"{sums['all']['right']:,}", **of}


def _place(part: tuple[str, Any]) -> int:
    """In the order of the study."""
    first = ["all", "fewer than 8 trials", "the others", *choice_confusion.TRUTHS]
    rest = [f"{n} points" for n in choice_confusion.SIZES]
    rest += [f"noise {noise}" for noise in choice_confusion.NOISES]
    return [*first, *rest, *(f"e {level}" for level in choice_confusion.LEVELS)].index(part[0])


def held(shares: dict[str, float]) -> str:
    """The shares of intervals that hold the truth, in bold where they are not as wanted."""
    found = []
    for what, share in shares.items():
        wanted = share >= 0.99 if what == "no better grid point" else 0.93 <= share <= 0.97
        found.append(f"{what} {percent(share)}" if wanted else f"{what} **{percent(share)}**")
    return ", ".join(found)


COVERAGE: dict[str, Callable[[tuple[str, dict]], Any]] = {
    "data": lambda cell: cell[0],
    "fits": lambda cell: f"{cell[1]['draws']:,}",
    "converged, %": lambda cell: percent(cell[1]["converged"]),
    "held, %": lambda cell: held(cell[1]["shares"]),
}


def design_table(result: dict[str, Any]) -> str:
    rows = []
    for name, plan in result["plans"].items():
        for parameter, expected in plan["expected"].items():
            seen, even = plan["seen"][parameter], plan["even"][parameter]
            ratio = f"{seen / expected:.2f}"
            rows.append([name, parameter, f"{expected:.3g}", ratio, f"{even:.3g}"])
    header = ["plan", "parameter", "± expected", "seen/expected", "± spread evenly"]
    return lines(header, rows)


def printed(code: str) -> str:
    """What a piece of code prints."""
    with contextlib.redirect_stdout(io.StringIO()) as out:
        exec(code, {})
    return out.getvalue().rstrip()


def percent(share: float | None) -> str:
    return "" if share is None else f"{100 * share:.1f}"


OPTIONS = {"--draws": {"type": int, "default": 2000, "help": "fits a cell; power: a fifth"}}
STUDY = Study(__file__, __doc__, measure, page, "trust", OPTIONS, whole=True)
