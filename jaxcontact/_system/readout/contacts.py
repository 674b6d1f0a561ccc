"""The table of contacts, from the log of a run."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array

from ..log import SystemLog
from ..problem import SystemState


def contacts_of(log: SystemLog, end: SystemState, rows: int | None) -> dict[str, Array]:
    """Return the columns of the contacts in order of their touches, cut to `rows`. A contact in
    progress at the end has no restitution and no duration yet.
    """
    gaps = jnp.arange(end.closed.shape[0])
    written = log.written[:, None]

    def both(of_log: Array, of_end: Array) -> Array:
        return jnp.concatenate([of_log.ravel(), of_end.ravel()])

    def column(name: str) -> Array:
        return both(getattr(log.states, name), getattr(end, name))

    valid = both(log.opens & written, end.closed)
    ended = both(log.opens & written, jnp.zeros_like(end.closed))
    touch, speed = column("since"), column("touch_speed")
    moves = ended & (speed > 0)
    restitution = column("parting") / jnp.where(moves, speed, 1)
    columns = {
        "gap": both(jnp.broadcast_to(gaps, log.opens.shape), gaps),
        "time": touch,
        "closing_speed": speed,
        "restitution": jnp.where(moves, restitution, jnp.nan),
        "duration": jnp.where(ended, column("force_until") - touch, jnp.nan),
        "max_force": column("max_force"),
        "max_depth": column("max_depth"),
        "energy_loss": column("lost"),
        "valid": valid,
    }
    order = jnp.argsort(jnp.where(valid, touch, jnp.inf), stable=True)[:rows]
    return {name: values[order] for name, values in columns.items()}
