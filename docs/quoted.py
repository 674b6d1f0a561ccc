"""Numbers quoted on several pages, each read from its result.

In a page a number stands between `<!--NAME-->` and `<!--/-->`. `python docs/quoted.py` writes all
of them into the README and the pages; a test compares.
"""

from __future__ import annotations

import functools
import itertools
import json
import math
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[1]
# Also works when run as a file.
sys.path.insert(0, str(ROOT))

from benchmarks.lab import choice_confusion
from benchmarks.study import percent
from benchmarks.time_and_error.reading import FAMILIES, cheapest, number, some

MARK = re.compile(r"<!--(?P<name>[a-z_]+)-->(?P<text>.*?)<!--/-->", re.DOTALL)

_TENS = "", "", "twenty", "thirty", "forty"
_ONES = "", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine"


def pages() -> list[Path]:
    """Return the README and the pages that quote a number."""
    every = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    return [page for page in every if MARK.search(page.read_text(encoding="utf-8"))]


def numbers() -> dict[str, str]:
    """Return every number by name, as it is written."""
    parts = _choice(), _coverage(), _instruments(), _times(), _mechanisms(), _lanes()
    parts = *parts, _friction(), _many()
    return {"laws": _laws()} | {name: text for part in parts for name, text in part.items()}


def _result(name: str) -> Any:
    return json.loads((ROOT / "benchmarks" / f"{name}.json").read_text(encoding="utf-8"))


def _laws() -> str:
    """Return the number of laws in words."""
    from jaxcontact import list_laws

    tens, ones = divmod(len(list_laws()), 10)
    return "-".join(filter(None, [_TENS[tens], _ONES[ones]]))


def _choice() -> dict[str, str]:
    """Return how often a choice among laws is sure and wrong."""
    parts = choice_confusion.shares(_result("choice_confusion"))
    wrong = {name: parts[name]["wrong"] / parts[name]["tables"] for name in parts}
    truth = max(choice_confusion.TRUTHS, key=lambda name: wrong.get(name, 0.0))
    return {
        "sure_and_wrong": percent(wrong["all"]),
        "choice_tables": f"{parts['all']['tables']:,}",
        "worst_sure_and_wrong": percent(wrong[truth]),
    }


def _coverage() -> dict[str, str]:
    """Return the smallest share of 95 % intervals that contain the truth."""
    cells = _result("fit_coverage")["cells"].values()
    shares = [
        share
        for cell in cells
        for what, share in cell["shares"].items()
        if what != "no better grid point"
    ]
    return {"least_held": percent(min(shares))}


def _instruments() -> dict[str, str]:
    """Return the size and the outcome of the studies of simulated recordings."""
    keys = {
        "sound": ("recordings", "in interval", "half interval of e, relative, median"),
        "tracks": (
            "tracks",
            "constant e in its interval",
            "half interval of the constant e, relative, median",
        ),
        "records": ("records", "e of all", "half interval of e, median"),
    }
    found = {}
    for name, (draws, held, width) in keys.items():
        row = _result(name)["all"]
        found[f"{name}_draws"] = f"{row[draws]:,}"
        found[f"{name}_found"] = percent(row["found"])
        found[f"{name}_held"] = percent(row[held])
        found[f"{name}_width"] = f"{100 * row[width]:.2g} %"
    return found


@functools.cache
def _impacts() -> list[dict[str, Any]]:
    rows = _result("run_time_error")["rows"].values()
    return [row for row in rows if row["group"] == "impacts"]


def _cost(problem: str, batch: int, error: float, **which: str) -> float:
    row = cheapest(some(_impacts(), problem=problem, batch=batch, **which), error)
    assert row is not None, (problem, batch, error, which)
    return row["cost"]


def _span(ratios: list[float]) -> str:
    return f"{number(min(ratios))} to {number(max(ratios))}"


def _times() -> dict[str, str]:
    """Return ratios of run times: in the largest batch within 1e-9, one by one within 1e-6."""
    assert {"numba", "diffrax", "ours"} <= set(FAMILIES)
    batch, error = 100_000, 1e-9
    closed = {"hunt_crossley": "hunt_crossley", "kuwabara_kono": "kuwabara_kono"}
    closed["oscillator"] = "spring_dashpot"
    found = {
        f"{name}_times_numba": number(
            _cost(problem, batch, error, family="numba") / _cost(problem, batch, error, way="exact")
        )
        for problem, name in closed.items()
    }
    # A user's own law and a push have no closed form.
    events = {p: _cost(p, batch, error, way="event") for p in ("own", "pushed")}
    of = {
        family: {p: _cost(p, batch, error, family=family) for p in events}
        for family in ("diffrax", "numba")
    }
    found["event_times_diffrax"] = _span([of["diffrax"][p] / events[p] for p in events])
    found["numba_times_event"] = _span([events[p] / of["numba"][p] for p in events])
    alone = [
        _cost(p, 1, 1e-6, family="ours") / _cost(p, 1, 1e-6, family="numba")
        for p in (*closed, *events)
    ]
    found["numba_times_alone"] = _span(alone)
    return found


def _mechanisms() -> dict[str, str]:
    """Return run times for an error of 1e-9 relative to ours within jit, those of batches, and
    missed touches.
    """
    known = _result("systems")

    def cost(problem: str, method: str) -> float:
        rows = [r for r in known["rows"] if (r["problem"], r["method"]) == (problem, method)]
        points = sorted((math.log(r["error"]), math.log(r["ms"])) for r in rows if "error" in r)
        assert points[0][0] <= math.log(1e-9), (problem, method)
        return math.exp(np.interp(math.log(1e-9), *np.transpose(points)))

    peers = {"numba": "numba, by hand", "diffrax": "diffrax Dopri8, restarted"}
    peers |= {"scipy": "SciPy DOP853, restarted", "no_jit": "jaxcontact"}
    problems = {"pendulum": "double pendulum", "crank": "slider-crank"}
    found = {
        f"{short}_{peer}": f"{cost(problem, method) / cost(problem, 'jaxcontact, in jit'):.2g}"
        for short, problem in problems.items()
        for peer, method in peers.items()
    }
    batch, prices = known["lanes"], known["prices"]
    found["crank_lanes"] = f"{batch['alone'] / batch['lane']:.2g}"
    for mode in ("forward", "reverse"):
        found[f"mechanism_{mode}"] = _span([row[mode] for row in prices])
    coarse, default, _ = _result("touches")
    found["touches"] = f"{default['touched']:,}"
    found["touches_missed"], found["touches_invented"] = map(
        str, (default["missed"], default["invented"])
    )
    found["touches_missed_coarse"] = str(coarse["missed"])
    gpu = _result("gpu")
    rows = [r for r in gpu["rows"] if r["group"] == "mechanisms" and r["platform"] == "gpu"]
    found["card"] = gpu["machine"]["card"]
    for short, problem in problems.items():
        rates = [r["rate"] for r in rows if r["what"].startswith(problem)]
        found[f"{short}_gpu"] = f"{float(f'{max(rates):.2g}'):,.0f}"
    return found


def _lanes() -> dict[str, str]:
    """Return lanes of the stability map, and those flagged without need; no lane may be wrong."""
    results = {name: _result(f"stability{name}") for name in ("", "_seed", "_laws")}
    jobs = [job for known in results.values() for job in known.values()]
    assert not any(job["counts"]["wrong without a flag"] for job in jobs)
    found = {"law_lanes": f"{sum(job['lanes'] for job in results['_laws'].values()):,}"}
    for seed, precision in itertools.product(("", "_seed"), ("float64", "float32")):
        asked = [job for name, job in results[seed].items() if name.endswith(precision)]
        lanes = sum(job["lanes"] for job in asked)
        needless = sum(job["counts"]["flagged without need"] for job in asked)
        name = f"{'double' if precision == 'float64' else 'single'}{seed}"
        found[f"needless_{name}"] = f"{needless:,}"
        if not seed:
            found[f"needless_{name}_share"] = f"{100 * needless / lanes:.3f}"
            found |= {"stability_lanes": f"{lanes / 1e6:.1f} million", "lanes_of_map": f"{lanes:,}"}
    return found


def _friction() -> dict[str, str]:
    """Return the differences of friction laws from measured rebounds, and their run times."""
    known = _result("oblique_rebounds")
    back = known["returned"]["force"]
    found = {
        "returned_at_zero": f"{back['at_zero']:.4f}",
        "returned_most": f"{back['largest']:.4f}",
    }
    times = {name: law["us"] for name, law in known["laws"].items()}
    # The forms of one spring differ by less than their times scatter.
    forms = [times.pop(name) for name in ("displacement", "force", "rescaled")]
    for name, law in known["laws"].items():
        found[f"rebounds_{name}"] = f"{law['rms']:.4f}"
        found[f"spins_{name}"] = f"{law['rms_spin']:.0f}"
    for name, microseconds in (times | {"spring": min(forms)}).items():
        found[f"rebound_us_{name}"] = f"{microseconds:.1g}"
    return found


def _many() -> dict[str, str]:
    """Return how many times as fast `fit_many` is as a loop, and how far apart their results."""
    known = _result("fit_many")
    return {
        "many_balls": f"{known['balls']:,}",
        "many_times": f"{known['ratio']:.2g}",
        "many_away": f"{known['away']:.0e}",
    }


def written(text: str, known: dict[str, str]) -> str:
    """Return a page with its numbers inserted. Raises KeyError for an unknown name.

    A mark at the beginning of a line would end the paragraph, so it goes to the end of the one
    before.
    """
    text = re.sub(r"(?<=[^\n|]) *\n *(?=<!--[a-z_]+-->)", " ", text)
    return MARK.sub(lambda m: f"<!--{m['name']}-->{known[m['name']]}<!--/-->", text)


if __name__ == "__main__":
    found = numbers()
    for page in pages():
        page.write_text(written(page.read_text(encoding="utf-8"), found), encoding="utf-8")
