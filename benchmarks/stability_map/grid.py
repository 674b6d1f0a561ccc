"""The impacts of the map: all corners, and random lanes with a fixed seed for every job.

All jobs, with their numbers of lanes.
"""

from __future__ import annotations

import itertools
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import jaxcontact as jc
from benchmarks.stability_map.collocation import EXTENDED, Array
from benchmarks.stability_map.kinds import KINDS, QUANTITIES
from tests.test_impact.support import given_ratio

CONCRETE = (1.0, 1.5, 2.0, 3.0)
STRONGEST_PUSH = 1e4
# Ranges of README: kg, N/m^n and m/s.
MASS, STIFFNESS, SPEED = (1e-12, 1e6), (1e-3, 1e15), (1e-6, 1e3)
WEAKEST = 1e-9
"""The damping and push below which random lanes do not go; 0 and 1e-12 are corners."""


@dataclass(frozen=True)
class Job:
    """A program of the package: one kind, one exponent (None: traced), one method and precision."""

    kind: str
    exponent: float | None
    pushed: bool
    method: str
    precision: str
    lanes: int
    seed: int = 0

    @property
    def name(self) -> str:
        n = "traced" if self.exponent is None else f"{self.exponent:g}"
        return "/".join(
            (self.kind, f"n={n}", "pushed" if self.pushed else "free", self.method, self.precision)
        )


@dataclass
class Lanes:
    """Numbers as the package gets them, in its precision: SI, and the damping of the law's kind."""

    damping: Array
    n: Array
    push: Array
    mass: Array
    stiffness: Array
    speed: Array


def lanes_of(job: Job) -> Lanes:
    """The lanes of a job: the corners first."""
    random = np.random.default_rng(zlib.crc32(job.name.encode()) + job.seed)
    kind = KINDS[job.kind]

    def logarithmic(low: float, high: float, count: int) -> Array:
        return np.exp(random.uniform(np.log(low), np.log(high), count))

    top = kind.strongest
    dampings = sorted(
        {0.0, 1e-12, 1e-5, 0.1 * min(top, 1), 0.7 * min(top, 1), top}
        | ({5.0, 300.0, 1e4} if top > 1e4 else set())
    )
    pushes = [s * g for s in (-1, 1) for g in (1e-12, 1e-4, 1.0, 1e4)] if job.pushed else [0.0]
    ns = (1.0, 1.2, 1.5, 3.0) if job.exponent is None else (job.exponent,)
    units = list(itertools.product(MASS, STIFFNESS, SPEED))
    corners = []
    for k, (damping, push, n) in enumerate(itertools.product(dampings, pushes, ns)):
        # Units scale out: every corner has two of the eight, and all eight occur with all numbers.
        corners += [(damping, n, push, *units[k % 8]), (damping, n, push, *units[(3 * k + 5) % 8])]
    corners = np.array(corners)[: job.lanes]
    count = job.lanes - len(corners)
    low = min(WEAKEST, top)
    damping = logarithmic(low, top, count)
    # Half of them in the range of most applications.
    usual = random.random(count) < 0.4
    damping = np.where(usual, random.uniform(0, min(top, 10), count), damping)
    n = random.uniform(1, 3, count) if job.exponent is None else np.full(count, job.exponent)
    push = np.zeros(count)
    if job.pushed:
        push = logarithmic(1e-12, STRONGEST_PUSH, count) * random.choice([-1, 1], count)
    columns = [damping, n, push, *(logarithmic(*r, count) for r in (MASS, STIFFNESS, SPEED))]
    whole = np.concatenate([corners, np.stack(columns, 1)])
    dtype = np.dtype(job.precision)
    damping, n, push, mass, stiffness, speed = whole.T
    lanes = Lanes(damping, n, push, *(x.astype(dtype) for x in (mass, stiffness, speed)))
    lanes.n = lanes.n.astype(dtype)
    scale = units_of(lanes)
    # The inputs of the package: a material time for Kuwabara and Kono, a force in N.
    if kind.family == "kuwabara_kono":
        lanes.damping = (lanes.damping * scale.time).astype(dtype)
    else:
        lanes.damping = np.minimum(lanes.damping, top).astype(dtype)
    lanes.push = (lanes.push * scale.force).astype(dtype)
    return lanes


@dataclass
class Units:
    """X, X/v0 and m v0²/X in extended precision."""

    length: Array
    time: Array
    force: Array


def units_of(lanes: Lanes) -> Units:
    mass, stiffness, speed, n = (
        x.astype(EXTENDED) for x in (lanes.mass, lanes.stiffness, lanes.speed, lanes.n)
    )
    length = np.exp(np.log(mass * speed * speed / stiffness) / (n + 1))
    return Units(length, length / speed, mass * speed * speed / length)


def scaled(job: Job, lanes: Lanes) -> tuple[Array, Array, Array]:
    """Damping, n and Γ of the scaled problem, from the rounded numbers of the package."""
    scale = units_of(lanes)
    damping = lanes.damping.astype(EXTENDED)
    if KINDS[job.kind].family == "kuwabara_kono":
        damping = damping / scale.time
    return damping, lanes.n.astype(EXTENDED), lanes.push.astype(EXTENDED) / scale.force


PRECISIONS = ("float64", "float32")
EXPONENTS = (*CONCRETE, None)
# Lanes of a job: a million if the truth comes from a table, 2e4 per law if it is integrated.
BY_TABLE = {"exact": 40_000, "phase": 20_000, "event": 20_000}
BY_MOTION = {"hunt_crossley": 2000, "kuwabara_kono": 500, "oscillator": 1000}


def _exponents(kind: str) -> tuple[float | None, ...]:
    # Jankowski's law is made for 3/2.
    return (1.5,) if KINDS[kind].approach else EXPONENTS


def all_jobs() -> list[Job]:
    """In the order in which they are run."""
    jobs = []
    for precision in PRECISIONS:
        for kind, described in KINDS.items():
            for n in _exponents(kind):
                jobs += [
                    Job(
                        kind,
                        n,
                        False,
                        method,
                        precision,
                        BY_TABLE[method] if described.has_table(n) else BY_MOTION[described.family],
                    )
                    for method in _free_methods(kind)
                ]
                lanes = BY_MOTION[described.family] * (2 if described.approach else 1)
                jobs.append(Job(kind, n, True, "event", precision, lanes))
    # The most common cases first, so that an interrupted run has covered them.
    first = {1.5: 0, None: 1, 1.0: 2, 3.0: 3, 2.0: 4}
    return sorted(jobs, key=lambda job: (job.precision != "float64", first[job.exponent]))


def _free_methods(kind: str) -> tuple[str, ...]:
    described = KINDS[kind]
    if kind == "hunt_crossley_tension":  # never pulls in a free impact
        return ()
    phase = ("phase",) if described.tension or described.family == "hunt_crossley" else ()
    exact = () if described.family == "kuwabara_kono" else ("exact",)
    return (*exact, "event", *phase)


def by_table(jobs: list[Job]) -> list[list[Job]]:
    """The jobs in groups that share a table of free impacts; the others alone.

    In the order of the first of each group.
    """
    groups: dict[object, list[Job]] = {}
    for job in jobs:
        shared = not job.pushed and KINDS[job.kind].has_table(job.exponent)
        groups.setdefault((job.kind, job.exponent) if shared else job, []).append(job)
    return list(groups.values())


AT_ONCE = 512


def law_of(kind_name: str, damping: Any) -> jc.AbstractLaw:
    """The law of a kind with its number."""
    kind = KINDS[kind_name]
    if kind.family == "hunt_crossley":
        return jc.Damped(alpha=damping, tension=kind.tension)
    if kind.family == "kuwabara_kono":
        return jc.KuwabaraKono(A=damping, tension=kind.tension)
    ending = "approach" if kind.approach else "tension" if kind.tension else "clamped"
    return given_ratio(damping, ending)


def answers(job: Job, lanes: Lanes) -> tuple[Array, dict[str, Array]]:
    """Status and outcomes in scaled units, the same number of lanes in every call."""
    status, found = np.zeros(job.lanes, int), {q: np.zeros(job.lanes, EXTENDED) for q in QUANTITIES}
    for index in blocks(job, lanes.damping):
        hit = _solve(job, lanes, index)
        status[index] = np.asarray(hit.status)
        for q, value in outcomes(hit).items():
            found[q][index] = value
    return status, in_units(found, units_of(lanes))


def outcomes(hit: jc.Impact) -> dict[str, Array]:
    names = ("restitution", *QUANTITIES[1:])
    return {q: np.asarray(getattr(hit, name)) for q, name in zip(QUANTITIES, names, strict=True)}


def in_units(found: dict[str, Array], unit: Units) -> dict[str, Array]:
    units = (1, unit.time, unit.time, unit.length, unit.force)
    return {q: found[q].astype(EXTENDED) / x for q, x in zip(QUANTITIES, units, strict=True)}


def blocks(job: Job, damping: Array) -> Iterator[Array]:
    """The lanes in blocks of one size, each of similar damping: they take as long as their slowest.

    The last one is filled up with its last lane.
    """
    order, at_once = np.argsort(damping, kind="stable"), min(AT_ONCE, job.lanes)
    for start in range(0, damping.size, at_once):
        yield order[np.minimum(np.arange(start, start + at_once), damping.size - 1)]


def _solve(job: Job, lanes: Lanes, index: Array) -> jc.Impact:
    def of(numbers: Array) -> jax.Array:
        return jnp.asarray(numbers[index])

    n = of(lanes.n) if job.exponent is None else job.exponent
    contact = jc.Contact(of(lanes.mass), of(lanes.stiffness), n)
    force = of(lanes.push) if job.pushed else None
    law = law_of(job.kind, of(lanes.damping))
    return jc.impact(law, contact, of(lanes.speed), method=job.method, external_force=force)
