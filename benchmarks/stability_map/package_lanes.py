"""The package's answers to a job, by its public door."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import jaxcontact as jc

from .collocation import EXTENDED, Array
from .grid import Job, Lanes, units_of
from .kinds import KINDS
from .motion import QUANTITIES

ROOT = Path(__file__).resolve().parents[2]
AT_ONCE = 4096


def law_of(kind_name: str, damping: Any) -> jc.AbstractLaw:
    """The law of a kind with its number."""
    kind = KINDS[kind_name]
    if kind.family == "hunt_crossley":
        return jc.Damped(alpha=damping, tension=kind.tension)
    if kind.family == "kuwabara_kono":
        return jc.KuwabaraKono(A=damping, tension=kind.tension)
    # Those of the tests, as the benchmark of sweeps takes their oracle.
    sys.path.insert(0, str(ROOT))
    from tests.test_impact.support import given_ratio

    ending = "approach" if kind.approach else "tension" if kind.tension else "clamped"
    return given_ratio(damping, ending)


def answers(job: Job, lanes: Lanes) -> tuple[Array, dict[str, Array]]:
    """Status and outcomes in scaled units, the same number of lanes in every call."""
    at_once = min(AT_ONCE, job.lanes)
    status, found = [], {q: [] for q in QUANTITIES}
    for start in range(0, job.lanes, at_once):
        # The last block is filled up with lanes of the block before.
        index = np.minimum(np.arange(start, start + at_once), job.lanes - 1)
        hit = _solve(job, lanes, index)
        count = min(at_once, job.lanes - start)
        status.append(np.asarray(hit.status)[:count])
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
            found[q].append(np.asarray(value)[:count])
    scale = units_of(lanes)
    unit = dict(
        zip(QUANTITIES, (1, scale.time, scale.time, scale.length, scale.force), strict=True)
    )
    return np.concatenate(status), {
        q: np.concatenate(values).astype(EXTENDED) / unit[q] for q, values in found.items()
    }


def _solve(job: Job, lanes: Lanes, index: Array) -> jc.Impact:
    def of(numbers: Array) -> jax.Array:
        return jnp.asarray(numbers[index])

    n = of(lanes.n) if job.exponent is None else job.exponent
    contact = jc.Contact(of(lanes.mass), of(lanes.stiffness), n)
    force = of(lanes.push) if job.pushed else None
    law = law_of(job.kind, of(lanes.damping))
    return jc.impact(law, contact, of(lanes.speed), method=job.method, external_force=force)
