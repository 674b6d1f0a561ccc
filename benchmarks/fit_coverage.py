"""Coverage of intervals: `python -m benchmarks fit_coverage`.

Data are simulated from a known truth and fitted as a user would. The study counts how often the 95
% interval of each parameter, and the bands of the prediction, contain the truth. An interrupted run
continues. `python -m benchmarks fit_adequacy --page` writes docs/trust.md from the result.
"""

from __future__ import annotations

import functools
import math
import time
import zlib
from collections.abc import Callable, Iterator

import jax
import jax.numpy as jnp
import numpy as np
from scipy import signal

import jaxcontact as jc
from benchmarks.study import Study
from benchmarks.until_event import contact
from jaxcontact._fit.uncertainty.interval import held_at, quantile_of

MASS, STIFFNESS, DAMPING, SPEED = 0.2, 5e7, 6e6, 1.5
TOUCH, FORCE_ZERO, DEPTH_ZERO = 3.1e-4, 12.0, 4e-6
TIME = np.linspace(0, 2.2e-3, 150)
CUTOFF = 2500.0
"""Of a sensor in Hz: times the duration of the contact, about 3."""

NOISE = {"force": 0.03, "indentation": 0.002}
"""Relative to the largest reading."""

Simulate = Callable[[np.random.Generator], jc.Fit]


def force_of(depth: np.ndarray, speed: np.ndarray) -> np.ndarray:
    power = np.maximum(depth, 0) ** 1.5
    return STIFFNESS * power + DAMPING * power * speed


def held(found: jc.Fit, truth: dict[str, float]) -> dict[str, bool | None]:
    """Whether the 95 % interval of each parameter holds its truth; None without a fit."""
    if not found.converged:
        return dict.fromkeys(truth)
    ends = found.interval()
    return {name: bool(ends[name][0] <= value <= ends[name][1]) for name, value in truth.items()}


@functools.cache
def motion() -> tuple[Callable[[np.ndarray], np.ndarray], float, float]:
    """Indentation and its rate over the time since touch, by SciPy, and both at the end."""
    run = contact(
        lambda x, v: -force_of(x, v) / MASS, 1e-12, speed=SPEED, stop=1.0, atol=1e-2, first=None,
        dense_output=True,
    )  # fmt: skip
    return run.sol, run.t[-1], run.y[1, -1]


def course(time: np.ndarray) -> dict[str, np.ndarray]:
    """Force and indentation at moments, with free flight before and after."""
    path, end, last = motion()
    since = time - TOUCH
    depth, speed = path(np.clip(since, 0, end))
    inside = (since > 0) & (since < end)
    gap = np.where(since < end, SPEED * since, last * (since - end))
    force = np.where(inside, force_of(depth, speed), 0)
    return {"force": force, "indentation": np.where(inside, depth, gap)}


@functools.cache
def clean_record() -> dict[str, np.ndarray]:
    """Force and indentation at `TIME`, with the zero errors of both instruments."""
    clean = course(TIME)
    return {
        "force": clean["force"] + FORCE_ZERO,
        "indentation": clean["indentation"] + DEPTH_ZERO,
    }


def records() -> Iterator[tuple[str, Simulate, dict[str, float]]]:
    """Kinds of records of one impact: a name, a simulated fit, and the truth."""
    truth = {"law.c": DAMPING, "contact.stiffness": STIFFNESS}
    truth |= {"velocity": SPEED, "start_time": TOUCH}
    offsets = {"force": FORCE_ZERO, "indentation": DEPTH_ZERO}
    for columns in (("force",), ("indentation",), ("force", "indentation")):
        for known in (False, True):
            name = f"{' and '.join(columns)}, noise {'known' if known else 'unknown'}"
            own = truth | {f"{c}_offset": offsets[c] for c in columns}
            yield name, functools.partial(record_fit, columns=columns, known=known), own
    own = truth | {"force_offset": FORCE_ZERO}
    of_force = functools.partial(record_fit, columns=("force",), known=False)
    for part in (0.7, 0.9):
        name = f"force cut at {100 * part:.0f} % of its maximum"
        yield name, functools.partial(of_force, cut=part), own
    for steps in (1.0, 5.0):
        name = f"force in steps of {steps:g} times its noise"
        yield name, functools.partial(of_force, steps=steps), own
    yield "force through a low-pass", functools.partial(filtered_fit, fitted=False), own
    name = "force through a low-pass whose cut-off is fitted, and indentation"
    more = {"low_pass_force.cutoff": CUTOFF, "indentation_offset": DEPTH_ZERO}
    yield name, functools.partial(filtered_fit, fitted=True), own | more


def record_fit(
    random: np.random.Generator,
    columns: tuple[str, ...],
    known: bool,
    cut: float | None = None,
    steps: float | None = None,
) -> jc.Fit:
    clean = clean_record()
    size = {c: NOISE[c] * np.ptp(clean[c][(TIME > TOUCH)]) for c in columns}
    if steps is not None:
        # The steps stay the same; the zero is uniformly distributed.
        step = size["force"]
        size["force"] /= steps
    if "indentation" in columns:
        # The flights before and after belong to the column, but not to its largest indentation.
        size["indentation"] = NOISE["indentation"] * clean["indentation"].max()
    table = {c: clean[c] + size[c] * random.normal(size=TIME.size) for c in columns}
    if cut is not None:
        table["force"] = np.minimum(table["force"], cut * clean["force"].max())
    if steps is not None:
        zero = random.uniform(0, step)
        table["force"] = step * np.round((table["force"] - zero) / step) + zero
    sigma = {f"sigma_{c}": size[c] for c in columns} if known else {}
    law, contact = jc.ConstantDamping(c=3e6), jc.Contact(mass=MASS, stiffness=4e7)
    with jax.enable_x64(True):
        return jc.fit_record(law, contact, TIME, 1.2, **table, **sigma, throw=False)


ORDER, DENSE, BEFORE = 2, 16, 40
"""Of the filter; its steps between two readings, and readings of noise that it passes before."""


@functools.cache
def filter_of(dense: int) -> np.ndarray:
    """SciPy's Butterworth filter for so many steps between two readings."""
    rate = dense / (TIME[1] - TIME[0])
    return signal.butter(ORDER, CUTOFF, fs=rate, output="sos")


@functools.cache
def clean_force(dense: int = 100) -> np.ndarray:
    """The force at `TIME` behind the filter."""
    time = np.linspace(TIME[0], TIME[-1], dense * (TIME.size - 1) + 1)
    return signal.sosfilt(filter_of(dense), course(time)["force"])[::dense] + FORCE_ZERO


def filtered_fit(random: np.random.Generator, fitted: bool) -> jc.Fit:
    """Force and its noise pass a low-pass filter, the indentation does not."""
    white = random.normal(size=DENSE * (TIME.size + BEFORE))
    noise = signal.sosfilt(filter_of(DENSE), white)[DENSE * BEFORE :: DENSE]
    # At this order a filter passes π/(2 √2) of its cut-off of the power.
    passed = np.pi / np.sqrt(8) * CUTOFF * 2 * (TIME[1] - TIME[0]) / DENSE
    clean = clean_record()
    size = NOISE["force"] * clean["force"].max() / np.sqrt(passed)
    table = {"force": clean_force() + size * noise}
    fixed = ("mass",) if fitted else ("mass", "low_pass_force")
    if fitted:
        depth = clean["indentation"]
        table["indentation"] = depth + NOISE["indentation"] * depth.max() * random.normal(
            size=TIME.size
        )
    law, contact = jc.ConstantDamping(c=3e6), jc.Contact(mass=MASS, stiffness=4e7)
    low_pass = jc.LowPass(0.8 * CUTOFF if fitted else CUTOFF, ORDER)
    with jax.enable_x64(True):
        how = {"low_pass_force": low_pass, "fixed": fixed, "throw": False}
        return jc.fit_record(law, contact, TIME, 1.2, **table, **how)


GRAVITY = 9.80665
BOUNCES, TRIALS = 10, 12
JITTER, SCATTER = 3e-4, 0.004
CONTACT = jc.Contact(mass=0.05, stiffness=1e7)
BALLS = {
    "constant e": ("law.e", 0.85, jc.ExactRestitution(e=0.6), np.linspace(0.3, 0.999, 700)),
    "constant c": ("law.c", 1.2e6, jc.ConstantDamping(c=5e5), np.geomspace(1e4, 1e8, 700)),
}
"""A parameter, its truth, the law to start from, and a dense grid of the parameter."""


@functools.cache
def _delivered() -> tuple[np.ndarray, np.ndarray]:
    """ln(1 + α) and the restitution of a damping factor α."""
    alpha = np.concatenate([[0], np.geomspace(1e-5, 1e3, 4000)])
    with jax.enable_x64(True):
        return np.log1p(alpha), np.asarray(jc.restitution(jc.Damped(alpha=alpha)))


def e_of(ball: str, value: float, speed: np.ndarray) -> np.ndarray:
    """The restitution of a ball whose parameter is `value`."""
    if ball == "constant e":
        return np.full_like(speed, value)
    return np.interp(np.log1p(value * speed / CONTACT.stiffness), *_delivered())


def triggers(random: np.random.Generator, ball: str, wrong: float) -> np.ndarray:
    """The times in s of one trial, of which a share `wrong` is missed or spurious, half each."""
    truth = BALLS[ball][1]
    speed, times = np.array(random.uniform(2.0, 4.5)), [0.0]
    for _ in range(BOUNCES):
        times.append(times[-1] + 2 * float(speed) / GRAVITY)
        speed = speed * e_of(ball, truth, speed) * np.exp(SCATTER * random.normal())
    times = np.array(times) + JITTER * random.normal(size=len(times))
    kept = times[random.random(len(times)) > wrong / 2]
    extra = random.uniform(times[0], times[-1], random.binomial(len(times), wrong / 2))
    return np.sort(np.concatenate([kept, extra]))


def bounces() -> Iterator[tuple[str, Callable[[np.random.Generator], dict[str, bool | None]]]]:
    """Recordings with wrong triggers: whether the truth is held, and no grid point is better."""
    for ball in BALLS:
        for wrong in (0.0, 0.05, 0.1, 0.2):
            name = f"{ball}, {100 * wrong:.0f} % of the triggers wrong"
            yield name, functools.partial(bounces_fit, ball=ball, wrong=wrong)


def bounces_fit(random: np.random.Generator, ball: str, wrong: float) -> dict[str, bool | None]:
    name, truth, start, grid = BALLS[ball]
    flights = [np.diff(triggers(random, ball, wrong)) for _ in range(TRIALS)]
    first = np.concatenate([t[:-1] for t in flights])
    second = np.concatenate([t[1:] for t in flights])
    trial = np.repeat(np.arange(TRIALS), [len(t) - 1 for t in flights])
    found = jc.fit_bounces(
        start, CONTACT, first, second, gravity=GRAVITY, loss=jc.Huber(), groups=trial, throw=False
    )
    if not found.converged:
        return {name: None, "no better grid point": None}
    factor, speed = np.asarray(found.problem.factor), GRAVITY * first / 2

    def loss(value: float) -> float:
        z = factor * (np.log(first * e_of(ball, value, speed)) - np.log(second))
        k = jc.Huber().threshold
        return float(np.sum(np.where(abs(z) < k, z**2 / 2, k * abs(z) - k**2 / 2)))

    best = loss(float(found.values[0]))
    # Interpolation blurs a loss by less than this.
    better = min(map(loss, grid)) < best * (1 - 1e-6)
    return held(found, {name: truth}) | {"no better grid point": not better}


NOISES = {"mixed": (3e-4, 0.004), "triggers": (1e-3, 0.001), "scatter": (1e-4, 0.01)}
"""Errors of triggers in s, and the relative scatter of a bounce."""


def trials() -> Iterator[tuple[str, Callable[[np.random.Generator], dict[str, bool | None]]]]:
    """Recordings of one and of some trials, whose intervals share triggers."""
    for count, length in ((1, 10), (1, 20), (5, 8), (12, 10)):
        for kind, noise in NOISES.items():
            times = "trial" if count == 1 else "trials"
            name = f"{count} {times} of {length} bounces, {kind}"
            yield name, functools.partial(trials_fit, count=count, length=length, noise=noise)


def trials_fit(
    random: np.random.Generator, count: int, length: int, noise: tuple[float, float]
) -> dict[str, bool | None]:
    name, truth, start, _ = BALLS["constant e"]
    jitter, scatter = noise
    first, second = [], []
    for _ in range(count):
        ratios = truth * np.exp(scatter * random.normal(size=length - 1))
        flights = 2 * random.uniform(2.0, 4.5) / GRAVITY * np.cumprod([1, *ratios])
        times = np.cumsum([0, *flights]) + jitter * random.normal(size=length + 1)
        first.append(np.diff(times)[:-1])
        second.append(np.diff(times)[1:])
    columns = np.concatenate(first), np.concatenate(second)
    found = jc.fit_bounces(start, CONTACT, *columns, gravity=GRAVITY, throw=False)
    return held(found, {name: truth})


PINGPONG = jc.Drag(mass=0.0027, radius=0.02, coefficient=0.5)
DROPS, EACH = np.linspace(0.3, 1.8, 6), 10
READ, KEPT = 0.004, 0.01
"""Error of a rebound's height in m, and the relative scatter of e² of a bounce."""


def drops() -> Iterator[tuple[str, Callable[[np.random.Generator], dict[str, bool | None]]]]:
    """Heights of rebounds: ten drops from each of six heights, whose error they share."""
    for off in (0.002, 0.01):
        name = f"ten drops from each of six, which are off by {1e3 * off:.0f} mm"
        yield name, functools.partial(drops_fit, off=off)


def drops_fit(random: np.random.Generator, off: float) -> dict[str, bool | None]:
    truth = {"law.e": 0.93, "drag_coefficient": PINGPONG.coefficient}
    scale = PINGPONG.terminal_speed(GRAVITY) ** 2 / (2 * GRAVITY)
    fallen = np.repeat(DROPS + off * random.normal(size=DROPS.size), EACH)
    landing = -np.expm1(-fallen / scale)
    kept = truth["law.e"] ** 2 * np.exp(KEPT * random.normal(size=fallen.size))
    rebound = scale * np.log1p(kept * landing) + READ * random.normal(size=fallen.size)
    found = jc.fit_bounces(
        jc.ExactRestitution(e=0.8),
        CONTACT,
        np.repeat(DROPS, EACH),
        rebound,
        kind="heights",
        gravity=GRAVITY,
        drag=PINGPONG,
        fixed=("mass", "stiffness"),
        throw=False,
    )
    return held(found, truth)


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
