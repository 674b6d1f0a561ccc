"""Right, flagged and wrong impacts of laws with a memory: `python -m benchmarks memory_map`.

Every lane has its own mass, stiffness and speed over the whole range of the package, and its own
parameters: from an elastic contact to e near 0, and for JKR to bodies that stick. The truths are
quadratures over the indentation in extended precision, which share no code with the package.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import jaxcontact as jc
from benchmarks.study import Study, table

LANES = 100_000
EXTENDED = np.longdouble
MASS, STIFFNESS, SPEED = (1e-12, 1e6), (1e-3, 1e15), (1e-6, 1e3)
ALLOWED = {
    ("exact", "float64"): 1e-11,
    ("exact", "float32"): 1e-4,
    ("event", "float64"): 1e-7,
}
"""Of every number, relative; e relative to 1. Page docs/accuracy.md states the same or more."""
NUMBERS = "restitution", "duration", "compression_time", "max_indentation"
NODES = 16
"""Of each panel of a quadrature."""

Array = np.ndarray


class Truth(NamedTuple):
    """The numbers of scaled impacts; `sticks` where the bodies stay together."""

    restitution: Array
    duration: Array
    compression_time: Array
    max_indentation: Array
    sticks: Array


def quad(function: Callable[[Array], Array], low: Array, high: Array, panels: int = 5) -> Array:
    """Gauss-Legendre sums of lanes (L,), with panels that halve towards both ends."""
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    nodes, weights = ((x.astype(EXTENDED)) for x in ((1 + nodes) / 2, weights / 2))
    shares = np.append(0, EXTENDED(0.5) ** np.arange(panels, 0, -1))
    cuts = np.unique(np.append(shares, 1 - shares))
    total = np.zeros_like(low)
    for start, end in itertools.pairwise(cuts):
        for node, weight in zip(nodes, weights, strict=True):
            place = start + (end - start) * node
            total += weight * (end - start) * function(low + (high - low) * place)
    return total * (high - low)


def speed_at(energy: Array, alpha: Array, sign: int) -> Array:
    """The s ≥ 0 with ∫_0^s u du/(1 + sign α u) = energy, by Newton's steps in ln(1 + sign α s)."""
    if np.all(alpha == 0):
        return np.sqrt(2 * energy)
    weak = alpha < 1e-6
    a = np.where(weak, 1, alpha)
    z = sign * np.sqrt(2 * energy) * a
    z = np.where(z > 1, np.log1p(z + z * z / 2), np.where(z < -2, -1 - z * z / 2, z - z * z / 6))
    for _ in range(12):
        slope = np.expm1(z)
        flat = np.abs(z) < 1e-18
        z = np.where(flat, z, z - (slope - z - a * a * energy) / np.where(flat, 1, slope))
    strong = sign * np.expm1(z) / a
    root = np.sqrt(2 * energy)
    return np.where(weak, root + sign * alpha * root**2 / 3, strong)


def yielding(r: Array, alpha: Array) -> Truth:
    """Thornton's force with r = v_y/v0, times 1 + αv."""
    y = (EXTENDED(5) / 4 * r * r) ** (EXTENDED(2) / 5)
    root, most = np.sqrt(y), r * r / 2
    weak = alpha < 1e-6
    a = np.where(weak, 1, alpha)
    energy = np.where(weak, EXTENDED(0.5) - alpha / 3, (a - np.log1p(a)) / (a * a))
    plastic = energy > most
    elastic_end = (EXTENDED(5) / 2 * energy) ** (EXTENDED(2) / 5)
    force = np.sqrt(y**3 + 3 * root * np.maximum(energy - most, 0))
    beyond = 2 * np.maximum(energy - most, 0) / (force + root**3)
    deepest = np.where(plastic, y + beyond, elastic_end)
    force = np.where(plastic, force, elastic_end ** EXTENDED(1.5))
    # x = x_e sin² φ, with the turn x_e of the elastic contact.
    last = np.arcsin(np.sqrt(np.minimum(y / elastic_end, 1)))

    def until_yield(phase: Array) -> Array:
        sine, cosine = np.sin(phase), np.cos(phase)
        left = energy * sine_to_five(cosine)
        return 2 * elastic_end * sine * cosine / speed_at(left, alpha, 1)

    way_in = quad(until_yield, np.zeros_like(r), last)
    # F = F_m sin φ.
    begin = np.arctan2(root**3, np.sqrt(3 * root * np.maximum(energy - most, 0)))

    def until_turn(phase: Array) -> Array:
        kinetic = (force * np.cos(phase)) ** 2 / (3 * root)
        return force * np.cos(phase) / (1.5 * root) / speed_at(kinetic, alpha, 1)

    half = 2 * np.arctan(EXTENDED(1)) + 0 * r
    after = quad(until_turn, np.where(plastic, begin, half - 1), half, panels=12)
    way_in = way_in + np.where(plastic, after, 0)
    depth = force / np.sqrt(deepest)
    stored = EXTENDED(2) / 5 * force * depth

    def back(phase: Array) -> Array:
        sine, cosine = np.sin(phase), np.cos(phase)
        return 2 * depth * sine * cosine / speed_at(stored * sine_to_five(cosine), alpha, -1)

    way_out = quad(back, np.zeros_like(r), half, panels=12)
    none = np.zeros(r.shape, bool)
    return Truth(speed_at(stored, alpha, -1), way_in + way_out, way_in, deepest, none)


def sine_to_five(cosine: Array) -> Array:
    """1 - sin⁵ φ by its cosine, which may be small."""
    square = cosine * cosine
    return -np.expm1(EXTENDED(5) / 2 * np.log1p(-np.minimum(square, 1 - EXTENDED(1e-19))))


def bilinear(factor: Array) -> Truth:
    """Walton and Braun's two springs, with K_u/K."""
    quarter, e = 2 * np.arctan(EXTENDED(1)), 1 / np.sqrt(factor)
    one = np.ones_like(factor)
    return Truth(e, quarter * (1 + e), quarter * one, one, np.zeros(factor.shape, bool))


def adhesive(factor: Array, adhesion: Array) -> Truth:
    """Luding's contact with K_u/K and K_c/K, by its kinetic energies."""
    quarter = 2 * np.arctan(EXTENDED(1))
    end, least = 1 - 1 / factor, (factor - 1) / (factor + adhesion)
    # Twice the kinetic energy where adhesion begins, and at the end.
    before = factor * (1 / factor - (least - end)) * (1 / factor + (least - end))
    square = before - adhesion * least * least
    sticks = square <= 0
    e = np.sqrt(np.where(sticks, 0, square))
    way_out = np.arccos(np.clip(factor * (least - end), -1, 1)) / np.sqrt(factor)
    # v² = e² + η x².
    root = np.sqrt(adhesion)
    way_out = way_out + np.arcsinh(root * least / np.where(sticks, 1, e)) / root
    one = np.ones_like(factor)
    return Truth(e, quarter + way_out, quarter * one, one, sticks)


def neck(mu: Array) -> Truth:
    """JKR with the root μ of its pull-off force over m v0²/X, by the contact radius."""
    third = EXTENDED(1) / 3

    def energy(q: Array) -> Array:
        return q**4 * (2 * q**6 / 5 - 4 * mu * q**3 / 3 + 2 * mu**2 / 3)

    touch, snap = (4 * mu / 3) ** third, (mu / 3) ** third
    lost = 2 * (energy(snap) - energy(touch))
    sticks = lost >= 1
    low, high = touch, touch + (10 * mu / 3) ** third + 2
    for _ in range(80):
        middle = (low + high) / 2
        above = energy(middle) - energy(touch) > EXTENDED(0.5)
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    turn = (low + high) / 2

    def from_turn(start: Array) -> Array:
        def function(share: Array) -> Array:
            q = turn - (turn - start) * share * share
            kinetic = 2 * np.maximum(energy(turn) - energy(q), 0)
            slope = (4 * q**3 - 4 * mu / 3) * 2 * (turn - start) * share
            return slope / np.sqrt(np.where(kinetic > 0, kinetic, 1))

        # The difference of energies has no digits at the turn itself.
        return quad(function, np.full_like(mu, 1e-5), np.ones_like(mu), 12) + 1e-5 * function(
            np.full_like(mu, 1e-5)
        )

    e = np.sqrt(np.where(sticks, 0, 1 - lost))
    way_in, way_out = from_turn(touch), from_turn(snap)
    return Truth(e, way_in + way_out, way_in, turn * (turn**3 - 4 * mu / 3), sticks)


def pulled(pull: Array) -> Truth:
    """DMT with the pull-off force over m v0²/X, by its energies: ∫ F dx = 2/5 x^(5/2) - φ x."""
    low, high = np.zeros_like(pull), 2 + (5 * pull / 2) ** (EXTENDED(2) / 3)
    for _ in range(80):
        middle = (low + high) / 2
        above = 2 * middle ** EXTENDED(2.5) / 5 - pull * middle > EXTENDED(0.5)
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    turn = (low + high) / 2
    half = 2 * np.arctan(EXTENDED(1)) + 0 * pull

    def until_turn(phase: Array) -> Array:
        # x = x_m sin² φ.
        cosine = np.cos(phase)
        kinetic = 2 * turn ** EXTENDED(2.5) / 5 * sine_to_five(cosine) - pull * turn * cosine**2
        return 2 * turn * np.sin(phase) * cosine / np.sqrt(2 * kinetic)

    way_in = quad(until_turn, np.zeros_like(pull), half)
    one = np.ones_like(pull)
    return Truth(one, 2 * way_in, way_in, turn, np.zeros(pull.shape, bool))


class Law(NamedTuple):
    """A law: random parameters of scaled lanes, their truth, and the parameters in SI."""

    cls: Callable[..., Any]
    draw: Callable[[np.random.Generator, int], dict[str, Array]]
    truth: Callable[..., Truth]
    make: Callable[..., dict[str, Array]]
    exponent: float


def logarithmic(random: np.random.Generator, low: float, high: float, count: int) -> Array:
    return np.exp(random.uniform(np.log(low), np.log(high), count))


LAWS = {
    "thornton_plastic": Law(
        jc.ThorntonPlastic,
        lambda random, n: {"r": logarithmic(random, 1e-4, 10, n)},
        lambda r: yielding(r, np.zeros_like(r)),
        lambda at, r: {"yield_speed": r * at.speed},
        1.5,
    ),
    "viscoplastic": Law(
        jc.Viscoplastic,
        lambda random, n: {
            "r": logarithmic(random, 1e-4, 10, n),
            "alpha": logarithmic(random, 1e-6, 1e3, n),
        },
        yielding,
        lambda at, r, alpha: {
            "yield_speed": r * at.speed,
            "c": alpha * at.stiffness / at.speed,
        },
        1.5,
    ),
    "walton_braun": Law(
        jc.WaltonBraun,
        lambda random, n: {
            "ratio": 1 + logarithmic(random, 1e-9, 400, n),
            "slope": logarithmic(random, 1e-9, 400, n),
        },
        lambda ratio, slope: bilinear(ratio + slope),
        lambda at, ratio, slope: {"ratio": ratio, "slope": slope / at.length},
        1.0,
    ),
    "luding": Law(
        jc.Luding,
        lambda random, n: {
            "ratio": 1 + logarithmic(random, 1e-9, 40, n),
            "slope": logarithmic(random, 1e-9, 40, n),
            "adhesion": logarithmic(random, 1e-4, 10, n),
        },
        lambda ratio, slope, adhesion: adhesive(ratio + slope, adhesion),
        lambda at, ratio, slope, adhesion: {
            "ratio": ratio,
            "slope": slope / at.length,
            "adhesion": adhesion,
        },
        1.0,
    ),
    "jkr": Law(
        jc.JKR,
        lambda random, n: {"mu": logarithmic(random, 1e-4, 2, n)},
        neck,
        lambda at, mu: {"pull_off": mu**2 * at.force},
        1.5,
    ),
    "dmt": Law(
        jc.DMT,
        lambda random, n: {"pull": logarithmic(random, 1e-4, 10, n)},
        pulled,
        lambda at, pull: {"pull_off": pull * at.force},
        1.5,
    ),
}


class Setting(NamedTuple):
    """SI numbers of lanes, with the units of length, time and force."""

    mass: Array
    stiffness: Array
    speed: Array
    length: Array
    time: Array
    force: Array


def setting(random: np.random.Generator, count: int, exponent: float, dtype: Any) -> Setting:
    mass, stiffness, speed = (
        logarithmic(random, *of, count).astype(dtype).astype(EXTENDED)
        for of in (MASS, STIFFNESS, SPEED)
    )
    length = (mass * speed**2 / stiffness) ** (1 / EXTENDED(exponent + 1))
    force = mass * speed**2 / length
    return Setting(mass, stiffness, speed, length, length / speed, force)


def measure(name: str, method: str, precision: str, count: int) -> dict[str, Any]:
    """The counts of lanes that are right, flagged, and wrong without a flag; the largest error."""
    law, dtype = LAWS[name], np.dtype(precision)
    random = np.random.default_rng([len(name), len(method), len(precision)])
    at = setting(random, count, law.exponent, dtype)
    drawn = law.draw(random, count)
    made = law.make(at, **{key: value.astype(EXTENDED) for key, value in drawn.items()})
    # Parameters in SI as the package gets them, and the scaled numbers that these mean.
    given = {key: value.astype(dtype) for key, value in made.items()}
    hit = jc.impact(
        law.cls(**jax.tree.map(jnp.asarray, given)),
        jc.Contact(*(jnp.asarray(x.astype(dtype)) for x in at[:2]), exponent=law.exponent),
        jnp.asarray(at.speed.astype(dtype)),
        method=method,
    )
    parts = [slice(k, k + 10_000) for k in range(0, count, 10_000)]
    truths = [law.truth(**scaled(name, at, given, part)) for part in parts]
    truth = Truth(*map(np.concatenate, zip(*truths, strict=True)))
    units = {"duration": at.time, "compression_time": at.time, "max_indentation": at.length}
    error = np.zeros(count)
    # A speed within the allowed error of the sticking speed may fall on either side, and a contact
    # that takes for ever there has no duration of that precision.
    near = np.abs(np.square(truth.restitution)) < 10 * ALLOWED[method, precision]
    timeless = truth.sticks | (near if np.any(truth.sticks) else False)
    for number in NUMBERS:
        found = np.asarray(getattr(hit, number)).astype(EXTENDED) / units.get(number, 1)
        expected = getattr(truth, number)
        counts = ~timeless if number == "duration" else np.ones(count, bool)
        unit = np.where(counts, expected, 1) if number in units else np.ones_like(expected)
        miss = np.where(counts, np.abs(found - expected) / unit, 0)
        error = np.maximum(error, np.where(np.isnan(miss), np.inf, miss).astype(float))
    status = np.asarray(hit.status)
    flagged = (status == int(jc.Status.NOT_CONVERGED)) | (status == int(jc.Status.INVALID_INPUT))
    sticks = status == int(jc.Status.SETTLED)
    right = (error <= ALLOWED[method, precision]) & ((sticks == truth.sticks) | near)
    return {
        "law": name,
        "method": method,
        "precision": precision,
        "lanes": count,
        "right": int(np.sum(right & ~flagged)),
        "flagged": int(np.sum(flagged)),
        "wrong": int(np.sum(~right & ~flagged)),
        "error": float(np.max(np.where(flagged, 0, error))),
    }


def scaled(name: str, at: Setting, given: dict[str, Array], part: slice) -> dict[str, Array]:
    """The scaled numbers of a law's SI parameters."""
    own = {key: value.astype(EXTENDED)[part] for key, value in given.items()}
    here = Setting(*(x[part] for x in at))
    if name in ("walton_braun", "luding"):
        return {**own, "slope": own["slope"] * here.length}
    if name == "jkr":
        return {"mu": np.sqrt(own["pull_off"] / here.force)}
    if name == "dmt":
        return {"pull": own["pull_off"] / here.force}
    numbers = {"r": own["yield_speed"] / here.speed}
    if name == "viscoplastic":
        numbers["alpha"] = own["c"] * here.speed / here.stiffness
    return numbers


def jobs() -> list[tuple[str, str, str]]:
    ways = itertools.product(LAWS, ALLOWED)
    # The times of DMT have no formula.
    return [(name, *how) for name, how in ways if name != "dmt" or how[0] == "event"]


COLUMNS: dict[str, Callable[[dict[str, Any]], Any]] = {
    "law": lambda row: f"`{row['law']}`",
    "method": lambda row: row["method"],
    "precision": lambda row: row["precision"],
    "lanes": lambda row: f"{row['lanes']:,}",
    "right": lambda row: f"{row['right']:,}",
    "flagged": lambda row: row["flagged"],
    "wrong": lambda row: row["wrong"],
    "largest error": lambda row: f"{row['error']:.1e}",
    "allowed": lambda row: f"{ALLOWED[row['method'], row['precision']]:.0e}",
}


def measure_all(known: list | None) -> list[dict[str, Any]]:
    rows = []
    for job in jobs():
        # Solves in time are slow; where there is a formula, they check it.
        checks = job[1] == "event" and job[0] != "dmt"
        rows.append(measure(*job, LANES // 10 if checks else LANES))
        print(rows[-1], flush=True)
    return rows


STUDY = Study(__file__, __doc__, measure_all, lambda rows: table(COLUMNS, rows, "---"), "stability")
