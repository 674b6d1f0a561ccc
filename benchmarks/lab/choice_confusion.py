"""Rate at which `choose_law` is sure of a wrong law: `python -m benchmarks choice_confusion`.

Tables of e over the closing speed are simulated from twelve true laws, two of which the choice
does not contain. They have 6 to 200 points, with e near 1 and near 0. The noise has constant size,
is proportional to e, or is shared by the points of a trial. Each table is a call of
`jc.choose_law`, as a user makes it. A sure choice is counted as

- right, if that law is the truth or contains it;
- wrong otherwise. For a truth outside all laws it is wrong if the truth leaves the 95 % band of the
  law's whole curve between the lowest and the highest speed. The band is √(k F) standard errors
  wide, with the 95 % quantile F of Fisher's distribution with k and n - k degrees of freedom
  (Working & Hotelling 1929, doi 10.1080/01621459.1929.10506274). "strict" counts as wrong what is
  anywhere off by more than 2 standard errors.

The same two criteria are counted for sure choices of the law that made the data ("right", of these
"left" and "strictly left").

A table is clear if the best law that does not contain the truth misses it by

    λ = Σ (misfit left after the best fit / σ)² ≥ 40.

An interrupted run continues. `python -m benchmarks fit_adequacy --page` writes docs/trust.md from
the result.
"""

from __future__ import annotations

import itertools
import time
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import jax
import numpy as np
from scipy.stats import f as fisher

import jaxcontact as jc
from benchmarks.study import Study
from jaxcontact._fit import LEAST_GROUPS
from jaxcontact.lab.choice.kinds import kinds_of

SEED = 1
SIZES = 6, 12, 25, 60, 200
NOISES = "constant", "proportional", "by trial"
LEVELS = {"near 1": (0.85, 0.97), "near 0": (0.12, 0.35)}
"""Of e at the middle speed."""
RATIO = 4.0, 20.0
"""Of the fastest to the slowest speed."""
SCATTER = 0.002, 0.03
"""Of e, relative; where it is constant, of e at the middle speed."""
RANGE = 0.06, 1.0
"""Of the true e at all speeds."""
NOISIEST = 0.15
"""Of e, where the size is constant."""
SHARED = 0.5
"""Of the variance, by all points of a trial."""
CLEAR = 40.0
BAND = 0.95
"""Probability with which the band of a right law's curve contains the truth at all speeds."""
STRICT = 2.0
"""Standard errors from which a curve is off by the strict criterion."""
CONTACT = jc.Contact(mass=0.01, stiffness=1e6)

Curve = Callable[[np.ndarray], np.ndarray]


class Truth(NamedTuple):
    """A true law: e(v) of speeds over the middle one and of e there, from random numbers; the kind
    of law that it is; and the levels of e that it has.
    """

    make: Callable[[np.random.Generator, float], Curve]
    kind: str | None = None
    levels: tuple[str, ...] = tuple(LEVELS)

    @property
    def own(self) -> set[str | None]:
        """The kind, and the kinds that contain it."""
        kinds = {kind.name: kind for kind in kinds_of("all", 1.5)}
        wider = (one.name for one in kinds.values() if self.kind and one.contains(kinds[self.kind]))
        return {self.kind, *wider}


def damped(power: float, e: float) -> Curve:
    """α goes as v^(1 + power)."""
    alpha = float(jc.exact_damping_factor(e))
    return lambda v: np.asarray(jc.restitution(jc.Damped(alpha=alpha * v ** (1 + power))))


def viscous(e: float) -> Curve:
    place = np.linspace(0, 2, 2001)
    curve = np.asarray(jc.restitution(jc.KuwabaraKono(A=place), jc.Contact(1.0, 1.0), 1.0))
    strength = float(np.interp(-e, -curve, place))
    return lambda v: np.interp(strength * v**0.2, place, curve)


def yield_speed(e: float) -> float:
    """The yield speed of Thornton's spheres with this e at speed 1."""
    ratio = np.geomspace(1e-6, 1, 4001)
    law = jc.ThorntonPlastic(yield_speed=1.0)
    return float(np.interp(e, np.asarray(law.restitution_at(1 / ratio)), ratio))


def plastic(e: float) -> Curve:
    law = jc.ThorntonPlastic(yield_speed=yield_speed(e))
    return lambda v: np.asarray(law.restitution_at(v))


def both(random: np.random.Generator, e: float) -> Curve:
    """The product of Kuwabara and Kono's e and Thornton's, which no law delivers."""
    share = random.uniform(0.3, 0.7)
    one, other = viscous(e**share), plastic(e ** (1 - share))
    return lambda v: one(v) * other(v)


def viscoplastic(random: np.random.Generator, e: float) -> Curve:
    """The e of `jc.Viscoplastic`, of which Thornton's spheres alone would lose a share."""
    yields = yield_speed(e ** random.uniform(0.3, 0.7))
    place = np.linspace(0, 2 * float(jc.exact_damping_factor(e)), 2001)
    unit = jc.Contact(1.0, 1.0)
    curve = np.asarray(jc.restitution(jc.Viscoplastic(yield_speed=yields, c=place), unit, 1.0))
    law = jc.Viscoplastic(yield_speed=yields, c=float(np.interp(-e, -curve, place)))
    return lambda v: np.asarray(jc.restitution(law, unit, v))


def wet(random: np.random.Generator, e: float) -> Curve:
    """A film of liquid: e = e_dry (1 - v_c/v), Davis et al. 1986, doi 10.1017/S0022112086002392.

    v_c is such that e_dry stays below 1.
    """
    critical = random.uniform(0.2, 1.0) * min(0.3, 1 - e)
    return lambda v: e * (1 - critical / v) / (1 - critical)


def adhesive(random: np.random.Generator, e: float) -> Curve:
    """Sticking spheres: e = e_∞ √(1 - (v_s/v)²), Thornton & Ning 1998, doi
    10.1016/S0032-5910(98)00099-0. v_s is such that e_∞ stays below 1.
    """
    sticks = random.uniform(0.2, 1.0) * min(0.5, float(np.sqrt(1 - e**2)))
    return lambda v: e * np.sqrt((1 - (sticks / v) ** 2).clip(0) / (1 - sticks**2))


def neck(random: np.random.Generator, e: float) -> Curve:
    """The e of `jc.JKR`: e = √(1 - (v_s/v)²)."""
    unit = jc.Contact(1.0, 1.0)
    strength = jc.JKR(pull_off=1.0).sticking_speed(unit)
    law = jc.JKR(pull_off=(np.sqrt(1 - e**2) / strength) ** 1.2)
    return lambda v: np.asarray(jc.restitution(law, unit, v))


def power_of_loss(random: np.random.Generator, e: float) -> Curve:
    power = random.uniform(0.3, 0.8)
    return lambda v: 1 - (1 - e) * v**power


TRUTHS = {
    "constant e": Truth(lambda random, e: lambda v: np.full_like(v, e), "constant e"),
    "constant c": Truth(lambda random, e: damped(0.0, e), "constant c"),
    "c falls": Truth(lambda random, e: damped(random.uniform(-0.6, -0.3), e), "c as a power of v"),
    "c rises": Truth(lambda random, e: damped(random.uniform(0.3, 0.7), e), "c as a power of v"),
    "Kuwabara-Kono": Truth(lambda random, e: viscous(e), "Kuwabara-Kono"),
    "elastic-plastic": Truth(lambda random, e: plastic(e), "elastic-plastic"),
    "viscous and plastic": Truth(viscoplastic, "viscous and plastic"),
    "wet": Truth(wet, "wet"),
    # It sticks at speeds at which e is near 0.
    "adhesive (JKR)": Truth(neck, "adhesive (JKR)", levels=("near 1",)),
    "1 - b v^p": Truth(power_of_loss, "1 - b v^p"),
    "Kuwabara-Kono times plastic": Truth(both),
    "adhesive with losses": Truth(adhesive),
}


class Table(NamedTuple):
    """A simulated table: speeds, e, the noise of each point, trials (or None) and the true e(v)."""

    velocity: np.ndarray
    e: np.ndarray
    sigma: np.ndarray
    trials: np.ndarray | None
    curve: Curve

    @property
    def clean(self) -> np.ndarray:
        return self.curve(self.velocity)


def simulated(random: np.random.Generator, truth: Truth, n: int, noise: str, level: str) -> Table:
    """A table whose true e stays in its range."""
    while True:
        middle = float(np.exp(random.uniform(*np.log([0.3, 3]))))
        ratio = np.exp(random.uniform(*np.log(RATIO)))
        scatter = np.exp(random.uniform(*np.log(SCATTER)))
        v = np.geomspace(ratio**-0.5, ratio**0.5, n)
        level_e = random.uniform(*LEVELS[level])
        made = truth.make(random, level_e)
        clean = made(v)
        if not (RANGE[0] <= clean.min() and clean.max() <= RANGE[1]):
            continue
        sigma = scatter * (level_e if noise == "constant" else clean) * np.ones(n)
        if (sigma / clean).max() > NOISIEST:
            continue
        trials, size = None, random.normal(size=n)
        if noise == "by trial":
            # Each trial covers all speeds.
            trials = np.arange(n) % trials_of(n)
            shared = random.normal(size=n)[trials]
            size = np.sqrt(SHARED) * shared + np.sqrt(1 - SHARED) * size
        e = clean + sigma * size
        if e.min() > 0 and e.max() <= 1.2:
            return Table(middle * v, e, sigma, trials, scaled(made, middle))


def trials_of(n: int) -> int:
    """The number of trials of n points."""
    return max(n // 8, min(n // 2, 12))


def scaled(curve: Curve, middle: float) -> Curve:
    """A curve of speeds in m/s."""
    return lambda v: curve(np.asarray(v) / middle)


def distance(table: Table, truth: Truth) -> float:
    """λ of the best law that does not contain the truth."""
    clean = jc.choose_law(
        CONTACT, table.velocity, table.clean, sigma=table.sigma, mark_outliers=False
    )
    return min(2 * fit.loss for kind, fit in clean.fits.items() if kind not in truth.own)


def off(choice: jc.LawChoice, kind: str, table: Table) -> dict[str, bool]:
    """Whether the curve of a law is off the truth, by its band and strictly."""
    v = np.geomspace(table.velocity[0], table.velocity[-1], 50)
    curve, error = choice.curve(kind, v)
    away = np.abs(curve - table.curve(v))
    k = next(one.k for one in choice.candidates if one.name == kind)
    band = np.sqrt(k * fisher.ppf(BAND, k, choice.fits[kind].dof))
    # What has no standard error is off.
    return {
        name: not np.all(away <= wide * error)
        for name, wide in (("band", band), ("strict", STRICT))
    }


def judged(table: Table, truth: Truth) -> dict[str, Any]:
    """What the choice is sure of, whether that is wrong, and whether the table is clear."""
    found: dict[str, Any] = dict.fromkeys(("wrong", "strict", *RIGHT), False)
    clear, kind = False, None
    try:
        choice = jc.choose_law(CONTACT, table.velocity, table.e, groups=table.trials)
        kind = choice.best if choice.sure else None
    except ValueError as error:
        # A steep curve through few points: the outlier rule left fewer than four.
        if "off the trend" not in str(error):
            raise
        choice = None
    if truth.kind is not None:
        clear = distance(table, truth) >= CLEAR
        found["wrong"] = found["strict"] = kind not in {None, *truth.own}
    if choice is not None and kind is not None and kind == truth.kind:
        away = off(choice, kind, table)
        found |= dict(zip(RIGHT, (True, away["band"], away["strict"]), strict=True))
    elif choice is not None and kind is not None and truth.kind is None:
        away = off(choice, kind, table)
        found["wrong"], found["strict"] = away["band"], away["strict"]
    right = kind is not None and not found["wrong"]
    return {"sure": kind, "clear": clear, "clear and right": clear and right, **found}


def cells() -> Iterator[tuple[str, tuple[str, int, str, str]]]:
    for what in itertools.product(TRUTHS, SIZES, NOISES, LEVELS):
        truth, n, noise, level = what
        if level in TRUTHS[truth].levels:
            yield f"{truth}, {n} points, noise {noise}, e {level}", what


def drawn(name: str, what: tuple[str, int, str, str], i: int) -> Table:
    """A table of a cell, from a seed of its own."""
    random = np.random.default_rng([SEED, zlib.crc32(name.encode()), i])
    return simulated(random, TRUTHS[what[0]], *what[1:])


RIGHT = "right", "left", "strictly left"
"""Sure choices of the law that made the data; of these, the curves that are off the truth."""

COUNTS = "wrong", "strict", "clear", "clear and right", *RIGHT


def more(cell: dict[str, Any], name: str, what: tuple[str, int, str, str], tables: int) -> None:
    """Bring the counts of a cell to so many tables."""
    for i in range(cell["tables"], tables):
        one = judged(drawn(name, what, i), TRUTHS[what[0]])
        cell["tables"] += 1
        for count in COUNTS:
            cell[count] += one[count]
        if one["sure"] is not None:
            cell["sure"][one["sure"]] = cell["sure"].get(one["sure"], 0) + 1


NOTHING = dict.fromkeys(("tables", *COUNTS), 0)


def measure(known: dict | None, tables: int, only: str) -> Iterator[dict[str, Any]]:
    result = known or {"seed": SEED, "cells": {}}
    chosen = [one for one in cells() if only in one[0]]
    begun = time.perf_counter()
    # One table of every cell, then the next: an interrupted run has covered all cells.
    for count in range(1, tables + 1):
        for name, what in chosen:
            cell = result["cells"].setdefault(name, NOTHING | {"sure": {}})
            with jax.enable_x64(True):
                more(cell, name, what, count)
            yield result
        print(f"{count} tables a cell, {time.perf_counter() - begun:.0f} s", flush=True)


def shares(result: dict[str, Any]) -> dict[str, dict[str, float]]:
    """Sums of the counts of all tables, of those with few trials, and of those of each truth, size,
    noise and level.
    """
    found: dict[str, Counter] = {}
    for name, cell in result["cells"].items():
        truth, n, noise, level = name.split(", ")
        few = noise.endswith("by trial") and trials_of(int(n.split()[0])) < LEAST_GROUPS
        groups = f"fewer than {LEAST_GROUPS} trials" if few else "the others"
        for part in ("all", groups, truth, n, noise, level):
            sums = found.setdefault(part, Counter())
            sums.update({key: cell[key] for key in ("tables", *COUNTS)})
            sums["sure"] += sum(cell["sure"].values())
    return {part: dict(sums) for part, sums in found.items()}


def confusion(result: dict[str, Any]) -> dict[str, Counter]:
    """For each truth, the laws that the choice was sure of."""
    found: dict[str, Counter] = {truth: Counter() for truth in TRUTHS}
    for name, cell in result["cells"].items():
        found[name.split(", ")[0]].update(cell["sure"])
    return found


OPTIONS = {
    "--tables": {"type": int, "default": 8, "help": "in each of the cells"},
    "--only": {"default": "", "help": "cells whose name contains this"},
}
STUDY = Study(__file__, __doc__, measure, options=OPTIONS)
