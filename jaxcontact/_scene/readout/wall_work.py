"""The work of moving walls, in contacts and on spheres that rest on them, and the energy that these
lose by sliding.

A friction a = F/m gives a sphere the power m a·(u + w). The wall, which moves at w along itself,
does m a·w of it, and -m a·u is lost. The slip u changes at a constant rate until the next event.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from ..._coupled.rows import rows_of
from ..._coupled.scalars import Index, Number
from ..._functions import ratio
from ..arrays.flight import Flying
from ..pair_impact.instantaneous import Choice
from ..pair_impact.rolling import begins_to_roll, footing, give_way
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


def spheres_at_rest(record: RunRecord, reached: Number) -> list[tuple]:
    """Return all spheres before each of their events, and at the end of the run. A part has their
    state, who they are, the walls on which they rest or -1, how long, and which of them count.
    """
    layout, (figures, facts) = record.layout, record.log
    choice, before, together = facts.choice, figures.before, figures.coupled
    # A wall has no row of its own.
    who = jnp.stack([choice.first, choice.second], axis=1)
    counts = record.counts[:, None] & (who < layout.spheres)
    lasted = figures.outcome.time[:, None] - before.time
    parts = [(before, who, choice.support, lasted, counts)]
    if facts.call is not None and together is not None:
        # Members of a coupled solve, until they join it.
        called = facts.call
        came = called.decided.change.joined | called.decided.starts[:, None]
        joins = record.counts[:, None] & called.is_call[:, None] & called.decided.seats.present
        lasted = together.began.time[:, None] - together.spheres.time
        who = called.decided.seats.who
        parts.append((together.spheres, who, called.support, lasted, joins & came))
        parts[0] = (*parts[0][:-1], counts & ~called.is_call[:, None])
    last, everyone = last_impacts(record, reached[None]), jnp.arange(layout.spheres)[None]
    now = Flying(last.position, last.velocity, last.began, last.turning)
    parts.append((now, everyone, last.support, reached - last.began, jnp.ones_like(everyone, bool)))
    return parts


def _work_at_rest(record: RunRecord, reached: Number) -> Number:
    """Return the work on spheres at rest on walls: the power -m (g·n) w times the duration."""
    layout, numbers = record.layout, record.numbers
    assert numbers.motion is not None
    mass = ratio(1.0, numbers.inverse_mass[: layout.spheres])
    power = -jnp.sum(numbers.normal * numbers.gravity[None], axis=-1) * numbers.motion.speed
    total = jnp.zeros((), numbers.dtype)
    for _, who, support, lasted, counts in spheres_at_rest(record, reached):
        lifts = power[jnp.maximum(support, 0)] * mass[jnp.minimum(who, layout.spheres - 1)]
        total = total + jnp.sum(jnp.where(counts & (support >= 0), lifts * lasted, 0))
    return total


def friction_at_rest(record: RunRecord, reached: Number) -> tuple[Number, Number]:
    """Return the work of walls by friction on spheres at rest on them, and the energy lost by
    sliding on them, in J.
    """
    layout, (figures, facts) = record.layout, record.log
    if not layout.walls or not (layout.settles or record.rules.members):
        zero = jnp.zeros((), record.numbers.dtype)
        return zero, zero
    # With one axis for all spheres of all rows.
    parts = jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), spheres_at_rest(record, reached))
    done = [_of(record, *part) for part in parts]
    work, loss = (sum(column) for column in zip(*done, strict=True))
    if record.rules.soft and layout.gravity:
        rolls = record.counts & begins_to_roll(layout, facts.choice)
        rolls = rolls if record.calls is None else rolls & ~record.calls
        first = jax.tree.map(lambda x: x[:, 0], figures.before)
        loss = loss + jnp.sum(jnp.where(rolls, _fallen(record, first, facts.choice), 0))
    return jnp.asarray(work), jnp.asarray(loss)


def _fallen(record: RunRecord, sliding: Flying, choice: Choice) -> Array:
    """Return the energies in J that soft balls lose as they give way at the end of sliding."""
    layout, numbers, support = record.layout, record.numbers, choice.support[:, 0]
    way = give_way(layout, numbers, choice.first, support, sliding)
    inverse = rows_of(numbers.inverse_mass, choice.first)
    slope = rows_of(numbers.pull, jnp.maximum(support, 0) + 1)
    return jnp.sum(slope * way, axis=1) / jnp.where(inverse > 0, inverse, 1)


def _of(
    record: RunRecord,
    flying: Flying,
    who: Int[Array, " M"],
    support: Int[Array, " M"],
    lasted: Array,
    counts: Bool[Array, " M"],
) -> tuple[Number, Number]:
    layout, numbers = record.layout, record.numbers
    assert flying.turning is not None
    sure = jnp.minimum(who, layout.spheres - 1)
    inverse = rows_of(numbers.inverse_mass, sure)
    rests = counts & (support >= 0) & (inverse > 0)
    on = jnp.maximum(support, 0)
    foot, drag = footing(layout, numbers, sure, on, flying), flying.turning.drag
    lasted = jnp.where(rests, lasted, 0)[:, None]
    force = drag / jnp.where(inverse > 0, inverse, 1)[:, None]
    way = foot.slip * lasted + foot.slip_rate(drag) * jnp.square(lasted) / 2
    work = jnp.where(rests[:, None], force * foot.drift * lasted, 0)
    return jnp.sum(work), jnp.sum(jnp.where(rests[:, None], -force * way, 0))
