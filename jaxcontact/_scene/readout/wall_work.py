"""The work of moving walls, in contacts and on spheres that rest on them."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array

from ..._coupled.scalars import Index, Number
from ..result import Ending, nan_unless
from ..run_record import RunRecord
from .states import last_impacts


def work_of(record: RunRecord, status: Index, reached: Number) -> Number:
    """Return the work of moving walls in a run in J; NaN if the impacts are not all known."""
    figures, counts = record.log.figures, record.counts
    work = jnp.sum(jnp.where(counts, figures.outcome.wall_work, 0))
    if figures.coupled is not None:
        work = work + jnp.sum(jnp.where(counts, figures.coupled.work, 0))
    if record.layout.gravity and any(record.layout.moving):
        work = work + _work_at_rest(record, reached)
    complete = (status != int(Ending.INVALID_INPUT)) & (status != int(Ending.TOO_MANY_IMPACTS))
    return nan_unless(work, complete)


def _work_at_rest(record: RunRecord, reached: Number) -> Number:
    """Return the work on spheres at rest on walls: the power -m (g·n) w times the duration."""
    layout, numbers, (figures, facts) = record.layout, record.numbers, record.log
    assert numbers.motion is not None
    inverse = numbers.inverse_mass[: layout.spheres]
    free = inverse > 0
    mass = jnp.where(free, 1 / jnp.where(free, inverse, 1), 0)
    weight = -jnp.sum(numbers.normal * numbers.gravity[None], axis=-1)
    power = weight * numbers.motion.speed

    def of(who: Array, support: Array, time: Array, counts: Array) -> Array:
        lifts = power[jnp.maximum(support, 0)] * mass[jnp.minimum(who, layout.spheres - 1)]
        return jnp.sum(jnp.where(counts & (support >= 0), lifts * time, 0))

    rows = record.counts[:, None]
    who = jnp.stack([facts.choice.first, facts.choice.second], axis=1)
    passed = figures.outcome.time[:, None] - figures.before.time
    # A wall has no row of its own.
    impacts = rows & (who < layout.spheres)
    total = jnp.zeros((), numbers.dtype)
    if facts.call is not None and figures.coupled is not None:
        called, together = facts.call, figures.coupled
        impacts = impacts & ~called.is_call[:, None]
        seats = called.decided.seats
        came = called.decided.change.joined | called.decided.starts[:, None]
        joins = rows & called.is_call[:, None] & seats.present & came
        before = together.began.time[:, None] - together.spheres.time
        total = total + of(seats.who, called.support, before, joins)
    total = total + of(who, facts.choice.support, passed, impacts)
    last = last_impacts(record, reached[None])
    everyone = jnp.arange(layout.spheres)[None]
    return total + of(everyone, last.support, reached - last.began, jnp.asarray(True))
