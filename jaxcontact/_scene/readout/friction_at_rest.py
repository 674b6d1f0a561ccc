"""The friction of spheres that rest on walls: the work of walls, and the energy lost by sliding.

A friction a = F/m gives a sphere the power m a·(u + w). The wall, which moves at w along itself,
does m a·w of it, and -m a·u is lost. The slip u changes at a constant rate until the next event.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from ..._coupled.rows import rows_of
from ..._coupled.scalars import Number
from ..arrays.flight import Flying
from ..pair_impact.instantaneous import Choice
from ..pair_impact.rolling import begins_to_roll, footing, give_way
from ..run_record import RunRecord
from .wall_work import spheres_at_rest


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
