"""A million lanes without an oracle: energy balances, and one method against another.

In every lane that is not flagged no energy is gained. If a contact ends at zero indentation, the
remaining and the lost energy add up to the initial one. Free impacts with a closed form are solved
by event and by that form; all others by event at two tolerances. The second answer may be wrong as
well, so a miss can belong to either.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import jax.numpy as jnp
import numpy as np

import jaxcontact as jc

from .collocation import EXTENDED, Array
from .grid import Job, Lanes, lanes_of, scaled, units_of
from .kinds import KINDS, SEPARATED, SETTLED
from .package_lanes import blocks, law_of
from .verdict import SMALLEST_E

LANES = 1_000_000
LEAST = 256
SEED = 7
"""Not the lanes that the map compares with its oracles."""
BOUND = 1e-8
"""README's, of the event method: restitution and duration."""
FINER = 1e-11
MOVED = 1e-8
"""Relative change of damping and push that a solve at rtol 1e-9 may be wrong by: ten tolerances."""
WORST = 5
ENERGY = (
    "energy lost is negative",
    "more energy than before",
    "energies do not add up",
)
METHOD = ("e", "duration", "status")


def balance_jobs(factor: float) -> list[Job]:
    """Every kind, free and pushed, of which all together have a million lanes times `factor`."""
    jobs = [
        Job(kind, n, pushed, "event", "float64", 0, SEED)
        for kind, described in KINDS.items()
        # Jankowski's law is made for 3/2.
        for n in ((1.5,) if described.approach else (1.5, None))
        for pushed in (False, True)
    ]
    count = max(math.ceil(LANES * factor / len(jobs)), LEAST)
    return [replace(job, lanes=count) for job in jobs]


def run_balance(job: Job) -> dict[str, Any]:
    lanes = lanes_of(job)
    closed = not job.pushed and KINDS[job.kind].family != "kuwabara_kono"
    other = "exact" if closed else jc.Event(rtol=FINER)
    first, second = _solved(job, lanes, "event"), _solved(job, lanes, other)
    sound = (first["status"] < 2) & (second["status"] < 2)
    excess = _energy_excess(job, first) | _method_excess(first, second)
    excess = {name: np.where(sound, values, 0) for name, values in excess.items()}
    doubtful = np.flatnonzero(np.max(list(excess.values()), 0) > 1)
    if doubtful.size:
        few = _at(lanes, doubtful)
        centre = {q: x[doubtful] for q, x in second.items()}
        for moved in _nearby(job, few):
            there = _solved(job, moved, other)
            for name, share in _moves(centre, there).items():
                values = excess[name][doubtful]
                excess[name][doubtful] = np.where(share >= values / 3, 0, values)
    stack = np.stack([excess[name] for name in (*ENERGY, *METHOD)])
    misses = stack > 1
    worst = np.argsort(-stack.max(0), kind="stable")[:WORST]
    damping, n, push = scaled(job, lanes)
    return {
        "lanes": job.lanes,
        "separated": int((sound & (first["status"] == SEPARATED)).sum()),
        "settled": int((sound & (first["status"] == SETTLED)).sum()),
        "flagged": int((~sound).sum()),
        "flagged by event": int((first["status"] >= 2).sum()),
        "energy misses": int(misses[: len(ENERGY)].any(0).sum()),
        "method misses": int(misses[len(ENERGY) :].any(0).sum()),
        "against": other if closed else f"event, rtol {FINER:g}",
        "worst": [
            {
                "damping": float(damping[i]),
                "n": float(n[i]),
                "push": float(push[i]),
                "miss": (*ENERGY, *METHOD)[stack[:, i].argmax()],
                "times allowed": _plain(stack[:, i].max()),
                "status": [int(x["status"][i]) for x in (first, second)],
                "e": [_plain(x["e"][i], 12) for x in (first, second)],
                "duration": [_plain(x["duration"][i], 12) for x in (first, second)],
                "energy lost": _plain(first["lost"][i], 12),
            }
            for i in worst
            if stack[:, i].max() > 1
        ],
    }


def _energy_excess(job: Job, hit: dict[str, Array]) -> dict[str, Array]:
    """How far the energies are off, in units of what the accuracy of e leaves open."""
    kind = KINDS[job.kind]
    e, lost = hit["e"], hit["lost"]
    at_zero = kind.tension or (kind.family == "hunt_crossley" and not job.pushed)
    at_zero = at_zero & (hit["status"] == SEPARATED)
    return {
        # Except for rounding, a loss is a sum of terms that cannot be negative.
        ENERGY[0]: np.where(lost < 0, np.inf, 0),
        ENERGY[1]: np.where(at_zero, (e - 1) / BOUND, 0),
        ENERGY[2]: np.where(at_zero, np.abs(e * e + lost - 1) / (2 * BOUND), 0),
    }


def _method_excess(first: dict[str, Array], second: dict[str, Array]) -> dict[str, Array]:
    """Differences of two answers in units of the bound."""
    differs = first["status"] != second["status"]
    both = ~differs & (first["status"] == SEPARATED)
    e = np.abs(first["e"] - second["e"]) / np.maximum(second["e"], SMALLEST_E)
    with np.errstate(invalid="ignore"):
        duration = np.abs(first["duration"] / second["duration"] - 1)
    return {
        "e": np.where(both, e / BOUND, 0),
        "duration": np.where(both, duration / BOUND, 0),
        "status": np.where(differs, np.inf, 0),
    }


def _moves(centre: dict[str, Array], there: dict[str, Array]) -> dict[str, Array]:
    """How far a small change of the numbers moves an outcome, in units of its bound.

    Infinite where it changes the status, or the solve gives up.
    """
    by = _method_excess(centre, there)
    change = np.isinf(by["status"]) | (there["status"] >= 2)
    e = np.where(change, np.inf, by["e"])
    energy = np.abs(there["e"] ** 2 - centre["e"] ** 2) + np.abs(there["lost"] - centre["lost"])
    energy = np.where(change, np.inf, energy / (2 * BOUND))
    return {
        ENERGY[0]: np.where(change, np.inf, 0),
        ENERGY[1]: e,
        ENERGY[2]: energy,
        "e": e,
        "duration": np.where(change, np.inf, by["duration"]),
        "status": np.where(change, np.inf, 0),
    }


def _nearby(job: Job, lanes: Lanes) -> Iterator[Lanes]:
    for by in (1 + MOVED, 1 - MOVED):
        # The strongest damping of a law with a range is the end of the range.
        highest = KINDS[job.kind].strongest if KINDS[job.kind].family == "oscillator" else np.inf
        yield replace(lanes, damping=np.minimum(lanes.damping * by, highest))
        if job.pushed:
            yield replace(lanes, push=lanes.push * by)


def _at(lanes: Lanes, index: Array) -> Lanes:
    fields = ("damping", "n", "push", "mass", "stiffness", "speed")
    return Lanes(*(getattr(lanes, f)[index] for f in fields))


def _solved(job: Job, lanes: Lanes, method: Any) -> dict[str, Array]:
    """Status, e, duration and the energy lost of any number of lanes, in scaled units."""
    found = np.zeros((4, lanes.damping.size), EXTENDED)
    for index in blocks(job, lanes.damping):
        some = _at(lanes, index)
        n = jnp.asarray(some.n) if job.exponent is None else job.exponent
        contact = jc.Contact(jnp.asarray(some.mass), jnp.asarray(some.stiffness), n)
        law = law_of(job.kind, jnp.asarray(some.damping))
        push = jnp.asarray(some.push) if job.pushed else None
        hit = jc.impact(law, contact, jnp.asarray(some.speed), method=method, external_force=push)
        fields = (hit.status, hit.restitution, hit.duration, hit.energy_loss)
        found[:, index] = [np.asarray(x) for x in fields]
    status, e, duration, lost = found
    energy = lanes.mass.astype(EXTENDED) * lanes.speed.astype(EXTENDED) ** 2 / 2
    return {
        "status": status.astype(int),
        "e": e.astype(float),
        "duration": (duration / units_of(lanes).time).astype(float),
        "lost": (lost / energy).astype(float),
    }


def _plain(x: float, digits: int = 3) -> float | None:
    return float(f"{x:.{digits}g}") if np.isfinite(x) else None
