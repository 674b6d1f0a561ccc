"""The log of a solve: a row for each time at which contacts begin or end."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._coupled.scalars import Index
from .problem import SystemState


class SystemLog(NamedTuple):
    """The rows of a solve (R, ...): the states just after events, with the contacts that begin and
    end there. `count` rows are written.
    """

    states: SystemState
    touches: Bool[Array, "R m"]
    opens: Bool[Array, "R m"]
    count: Index

    @property
    def rows(self) -> int:
        return self.touches.shape[0]

    @property
    def written(self) -> Bool[Array, " R"]:
        return jnp.arange(self.rows, dtype=self.count.dtype) < self.count

    @property
    def times(self) -> Float[Array, " R"]:
        """The times of the rows in s, infinite for blank ones."""
        return jnp.where(self.written, self.states.time, jnp.inf)


def empty_log(state: SystemState, rows: int) -> SystemLog:
    """Return a log without rows written."""
    blank = jax.tree.map(lambda x: jnp.zeros((rows, *x.shape), x.dtype), state)
    none = jnp.zeros((rows, *state.closed.shape), bool)
    return SystemLog(blank, none, none, jnp.zeros((), jnp.int32))


def with_event(
    log: SystemLog,
    state: SystemState,
    touches: Bool[Array, " m"],
    opens: Bool[Array, " m"],
    slides: Bool[Array, " m"] | None = None,
) -> SystemLog:
    """Return the log with a row if any contact begins or ends, or begins to stick or to slip. The
    row after the last one is overwritten in any case, which costs less than a choice.
    """

    def put(rows: Array, row: Array) -> Array:
        return jax.lax.dynamic_update_index_in_dim(rows, row, log.count, 0)

    states, began, ended = jax.tree.map(
        put, (log.states, log.touches, log.opens), (state, touches, opens)
    )
    event = jnp.any(touches | opens if slides is None else touches | opens | slides)
    return SystemLog(states, began, ended, log.count + event.astype(log.count.dtype))
