"""The package's answers to a job, by its public door."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import jaxcontact as jc
from jaxcontact._laws import AbstractOscillator

from .collocation import EXTENDED, Array
from .grid import Job, Lanes, units_of
from .kinds import KINDS
from .motion_oracle import QUANTITIES

AT_ONCE = 4096


class GivenRatio(AbstractOscillator):
    """The oscillator laws by their one number ζ."""

    zeta: jax.Array

    def damping_ratio(self, contact=None):
        return self.zeta


class GivenRatioOnApproach(GivenRatio):
    """Jankowski's law by its number."""

    approach_only = True


def law_of(kind_name: str, damping: Any) -> jc.AbstractLaw:
    """The law of a kind with its number."""
    kind = KINDS[kind_name]
    if kind.family == "hunt_crossley":
        return jc.Damped(alpha=damping, tension=kind.tension)
    if kind.family == "kuwabara_kono":
        return jc.KuwabaraKono(A=damping, tension=kind.tension)
    if kind.approach:
        return GivenRatioOnApproach(zeta=damping)
    return GivenRatio(zeta=damping, tension=kind.tension)


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
