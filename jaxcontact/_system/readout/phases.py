"""The table of phases in which contacts stick or slide, from the log of a run."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array

from ..log import SystemLog
from ..problem import SystemState


def phases_of(log: SystemLog, start: SystemState) -> dict[str, Array]:
    """Return the columns of the phases in order of their starts, blank rows last."""
    rows = jax.tree.map(lambda first, rows: jnp.concatenate([first[None], rows]), start, log.states)
    assert rows.slide is not None
    changes = rows.slide[1:] != rows.slide[:-1]
    begins = jnp.concatenate([start.closed[None], (log.touches | changes) & log.written[:, None]])
    # What changes again at the same time has no duration.
    lasts = jnp.concatenate(
        [~begins[1:] | (rows.time[1:] > rows.time[:-1])[:, None], begins[:1] | True]
    )
    valid = (begins & rows.closed & lasts).ravel()
    gaps = jnp.broadcast_to(jnp.arange(rows.closed.shape[1]), rows.closed.shape)
    columns = {
        "gap": gaps.ravel(),
        "time": jnp.broadcast_to(rows.time[:, None], rows.closed.shape).ravel(),
        "direction": rows.slide.ravel().astype(jnp.int32),
        "valid": valid,
    }
    order = jnp.argsort(jnp.where(valid, columns["time"], jnp.inf), stable=True)
    return {name: values[order] for name, values in columns.items()}
