"""The package's answers to a job, through its public functions."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import jaxcontact as jc

from .collocation import EXTENDED, Array
from .grid import Job, Lanes, units_of
from .kinds import KINDS, QUANTITIES

ROOT = Path(__file__).resolve().parents[2]
AT_ONCE = 512


def law_of(kind_name: str, damping: Any) -> jc.AbstractLaw:
    """The law of a kind with its number."""
    kind = KINDS[kind_name]
    if kind.family == "hunt_crossley":
        return jc.Damped(alpha=damping, tension=kind.tension)
    if kind.family == "kuwabara_kono":
        return jc.KuwabaraKono(A=damping, tension=kind.tension)
    # Those of the tests, like the oracle in the benchmark of sweeps.
    sys.path.insert(0, str(ROOT))
    from tests.test_impact.support import given_ratio

    ending = "approach" if kind.approach else "tension" if kind.tension else "clamped"
    return given_ratio(damping, ending)


def answers(job: Job, lanes: Lanes) -> tuple[Array, dict[str, Array]]:
    """Status and outcomes in scaled units, the same number of lanes in every call."""
    status, found = np.zeros(job.lanes, int), {q: np.zeros(job.lanes, EXTENDED) for q in QUANTITIES}
    for index in blocks(job, lanes.damping):
        hit = _solve(job, lanes, index)
        status[index] = np.asarray(hit.status)
        named = dict(
            zip(
                QUANTITIES,
                (
                    hit.restitution,
                    hit.duration,
                    hit.compression_time,
                    hit.max_indentation,
                    hit.max_force,
                ),
                strict=True,
            )
        )
        for q, value in named.items():
            found[q][index] = np.asarray(value)
    scale = units_of(lanes)
    unit = dict(
        zip(QUANTITIES, (1, scale.time, scale.time, scale.length, scale.force), strict=True)
    )
    return status, {q: values / unit[q] for q, values in found.items()}


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
