"""The choice of the next event: stale events are searched again until one is an impact."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ..._coupled.modes import Flag, Index, Number
from ..._coupled.rows import rows_of, with_one_or_two
from ..arrays.arrays import SceneArrays, SceneLayout
from ..contact_times.cells import CellGrid, Cells, Shift, fill_cells, move_sphere, shift_of, staying
from .next_event import LEAVES, OUT_OF_DATE, find_next_events, flight_at, simultaneous
from .state import Events, RunState


def reset_events(
    model: SceneArrays,
    state: RunState,
    now: Number,
    grid: CellGrid | None,
    needed: Flag | None = None,
) -> RunState:
    """Return the state with new cells, or none, and all events out of date. Unless `needed`, the
    events are kept.
    """
    cells = None
    if grid is not None:
        cells = fill_cells(model, grid, flight_at(model, state, None, now)[0])
    events = stale_events(jnp.broadcast_to(now, (model.spheres,)))
    if needed is not None:
        events = jax.tree.map(lambda a, b: jnp.where(needed, a, b), events, state.events)
    return state._replace(cells=cells, events=events)


def stale_events(time: Float[Array, " M"]) -> Events:
    """Return events marked out of date, to be searched at given times."""
    far, none = jnp.full_like(time, jnp.inf), jnp.full(time.shape, OUT_OF_DATE, int)
    return Events(time, none, jnp.zeros_like(none), far, far)


class Due(NamedTuple):
    """The next event: its body, its partner, and whether it is an impact. `least` is the least of
    all times; `time` is that of the event, which may differ by rounding.
    """

    least: Number
    time: Number
    first: Index
    partner: Index
    fresh: Flag


def next_event(model: SceneArrays, events: Events, count: Int[Array, " N"]) -> Due:
    """Return the event of least time; of simultaneous ones that with the largest closing speed."""
    least = jnp.min(events.time)
    together = events.time <= least + simultaneous(model, least)
    # Two plain reductions are twice as fast as one that carries an index.
    speed = jnp.where(together, events.speed, -jnp.inf)
    everyone = jnp.arange(model.spheres)
    i = jnp.min(jnp.where(speed == jnp.max(speed), everyone, model.spheres - 1))
    time, partner, met = rows_of((events.time, events.partner, events.count), i)
    is_sphere = (partner >= 0) & (partner < model.spheres)
    is_current = rows_of(count, jnp.clip(partner, 0, model.spheres - 1)) == met
    fresh = (partner >= model.spheres) | (is_sphere & is_current)
    return Due(least, time, i, partner, fresh)


def update_events(
    model: SceneArrays, state: RunState, until: Number, end: Number
) -> tuple[RunState, Due]:
    """Search stale spheres again until the next event is an impact or is later than `until`. Events
    are searched only here. Two spheres are searched at a time, since both bodies of an impact are
    out of date; in small scenes one at a time.
    """

    def unfinished(carry: tuple[Events, Cells | None, Due]) -> Array:
        _, cells, due = carry
        stale = ~due.fresh & (due.least <= until)
        return stale if cells is None else stale & ~cells.full

    def again(carry: tuple[Events, Cells | None, Due]) -> tuple[Events, Cells | None, Due]:
        events, cells, due = carry
        here = state._replace(events=events, cells=cells)
        i, now = due.first, jnp.maximum(due.time, state.now)
        # Always true here; but reads in a branch precede all writes.
        wanted = due.least <= until
        if cells is not None:

            def stay(cells: Cells = cells) -> Shift:
                return staying(cells, i)

            def shift(cells: Cells = cells) -> Shift:
                place = flight_at(model, here, i[None], now)[0]
                return shift_of(model, cells, i, place, due.partner == LEAVES)

            # After an impact a sphere is where it was.
            cells = move_sphere(cells, i, jax.lax.cond(due.partner == OUT_OF_DATE, stay, shift))
            here = here._replace(cells=cells)
        who = rows = i[None]
        if model.spheres > _FEW:
            who, rows = _both(model, events, i, now)
        new = in_branch(wanted, lambda: find_next_events(model, here, who, now, end))
        events = with_one_or_two(events, rows, new)
        return events, cells, next_event(model, events, state.count)

    first = next_event(model, state.events, state.count)
    events, cells, due = jax.lax.while_loop(unfinished, again, (state.events, state.cells, first))
    return state._replace(events=events, cells=cells), due


_FEW = 8
"""The number of spheres up to which one is searched at a time. In a batch of small scenes each row
counts, and all runs wait for the one with most to search."""


def _both(
    layout: SceneLayout, events: Events, i: Index, now: Number
) -> tuple[Int[Array, "2"], Int[Array, "2"]]:
    """Return a sphere and another one that is out of date at the same time, and their rows. If
    there is no other one, its row does not exist.
    """
    everyone = jnp.arange(layout.spheres)
    marked = (events.partner == OUT_OF_DATE) & (events.time <= now) & (everyone != i)
    other = jnp.min(jnp.where(marked, everyone, layout.spheres))
    there = other < layout.spheres
    return jnp.stack([i, jnp.where(there, other, i)]), jnp.stack([i, other])


def in_branch(wanted: Flag, of: Callable[[], Any]) -> Any:
    """Return the result of a function if it is wanted, else zeros; it is traced once."""
    kinds: list[Any] = []

    def yes() -> Any:
        out = of()
        kinds[:] = [jax.eval_shape(lambda: out)]
        return out

    def no() -> Any:
        # JAX traces this branch after the other one.
        return jax.tree.map(lambda kind: jnp.zeros(kind.shape, kind.dtype), kinds[0])

    return jax.lax.cond(wanted, yes, no)
