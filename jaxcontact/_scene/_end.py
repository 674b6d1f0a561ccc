"""What a run ends with, and how another one goes on from there."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from ._company import pace_of
from ._coupled import as_flags, stored_energy
from ._log import Log
from ._progress import Coupling, Rules
from ._slots import Seats
from ._start import Contacts, Start
from ._states import looked_up
from ._system import Layout, Numbers


@eqx.filter_jit
def end_of(
    layout: Layout, numbers: Numbers, rules: Rules, log: Log, written: Int[Array, ""], time: Array
) -> tuple[Start, Bool[Array, ""]]:
    """What a run ends with, for another run to go on from; whether an isolated impact is on then,
    from which none can.
    """
    figures, facts = log
    counts = jnp.arange(facts.tied.shape[0]) < written
    late = jnp.where(counts, jnp.max(figures.outcome.after.time, axis=1), 0)
    last = jax.tree.map(
        lambda x: x[0], looked_up(layout, numbers, log, written, time[None], rules.soft)
    )
    start = Start(last.support, last.held, None, rules.soft)
    if facts.call is None or figures.coupled is None:
        return start, rules.soft & jnp.any(late > time)
    called = facts.call.is_call & counts
    row = jnp.max(jnp.where(called, jnp.arange(counts.shape[0]), -1))
    place = jnp.maximum(row, 0)
    one, decided, choice = jax.tree.map(
        lambda x: x[place], (figures.coupled, facts.call.decided, facts.choice)
    )
    state, seats, zero = as_flags(one.end), decided.seats, jnp.zeros_like(one.end.lost)
    closing = jnp.max(jnp.where(state.closed, state.latched, 0))
    contacts = Contacts(
        active=(row >= 0) & ~facts.call.ends[place],
        who=seats.who,
        present=seats.present,
        shift=seats.shift,
        pace=pace_of(layout, numbers, choice, closing),
        reserve=stored_energy(layout, numbers, rules.members, seats, state),
        # What was lost so far belongs to the run that ended.
        state=state._replace(
            time=state.time - time,
            since=state.since - time,
            force_until=state.force_until - time,
            lost=zero,
        ),
    )
    start = Start(last.support, last.held, contacts, rules.soft)
    return start, jnp.any(late > time)


def going_on(coupling: Coupling, start: Start | None) -> Coupling:
    """The coupling at the start of a run, with the contacts that it begins in."""
    if start is None or start.contacts is None:
        return coupling
    known = start.contacts
    begun = coupling._replace(
        active=known.active,
        seats=Seats(known.who, known.present, known.shift),
        pace=known.pace,
        reserve=known.reserve,
        state=known.state,
    )
    return jax.tree.map(lambda a, b: jnp.where(known.active, a, b), begun, coupling)
