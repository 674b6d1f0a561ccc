"""The coupled solve within a run: its start, its calls, and the other spheres meanwhile."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..arrays.arrays import Layout, Numbers
from ..arrays.flight import Flying, at_once
from ..arrays.rows import rows_of
from ..cluster.problem import APART, AT_REST, PAUSED, TIME_IS_UP
from ..cluster.problem import NOT_CONVERGED as FAILED
from ..pair_impact.instantaneous import Choice, Outcome
from .cluster_members import company_of, pace_of
from .cluster_slots import change_of, index_of, places
from .coupled import Call, as_numbers, call, masses, meets, touching, work_of_walls
from .event_queue import out_of_date
from .log import Called, Facts, Figures, Together
from .next_event import OUT_OF_DATE, among_others, seated, simultaneous
from .state import (
    ACCUMULATED,
    CROWDED,
    NOT_CONVERGED,
    OVER,
    PATIENCE,
    RUNNING,
    Coupling,
    Rules,
    State,
)


def begins(
    layout: Layout,
    numbers: Numbers,
    before: Coupling,
    starts: Bool[Array, ""],
    choice: Choice,
    closing: Float[Array, ""],
) -> Coupling:
    """Return the coupling after a touch that is not isolated, if it `starts` or joins a solve."""
    pace = pace_of(layout, numbers, choice, closing)
    pace = jnp.where(before.active, jnp.minimum(before.pace, pace), pace)
    after = before._replace(
        active=starts, starts=~before.active, touches=starts, choice=choice, pace=pace
    )
    return jax.tree.map(lambda a, b: jnp.where(starts, a, b), after, before)


def calls_first(state: State) -> Bool[Array, ""]:
    """Return whether the next call of the active solve precedes all events of other spheres. A
    known touch is part of that call.
    """
    coupling = state.coupling
    assert coupling is not None
    sooner = coupling.state.time < jnp.min(state.events.time)
    return coupling.active & (coupling.touches | sooner)


def called(
    layout: Layout,
    numbers: Numbers,
    rules: Rules,
    state: State,
    end: Float[Array, ""],
    tolerance: Float[Array, ""],
    needed: Bool[Array, ""],
) -> tuple[State, Figures, Facts, Bool[Array, ""]]:
    """Make one call of the coupled solve, until a pair touches or opens or other events are due."""
    count, members, coupling = layout.spheres, rules.members, state.coupling
    assert coupling is not None
    now = jnp.where(coupling.starts, coupling.choice.time, coupling.state.time)
    company = company_of(layout, numbers, members, state, now)
    seats = company.seats
    change = change_of(layout, members, coupling.seats, seats, coupling.starts)
    who, index = jnp.minimum(seats.who, count - 1), index_of(layout, seats)
    spheres = rows_of(Flying(state.position, state.velocity, state.time), who)
    support, held, counts = rows_of((state.support, state.held, state.count), who)
    there = at_once(layout, numbers, who, spheres, support, now)[0]
    closed = touching(layout, numbers, members, seats, there, support, now)
    closed = closed | (coupling.touches & meets(layout, members, seats, coupling.choice))

    # A sphere that leaves is searched before anything else.
    going_on = coupling._replace(seats=seats)
    inside = seated(layout, going_on)
    leaves = seated(layout, coupling) & ~inside & ~coupling.starts
    events = among_others(layout, numbers, going_on, state.events, now)
    expected = jnp.where(inside, jnp.inf, jnp.where(leaves, now, events.time))
    events = events._replace(time=expected, partner=jnp.where(leaves, OUT_OF_DATE, events.partner))
    waiting = jnp.where(state.time > now + simultaneous(numbers, now), state.time, jnp.inf)
    until = jnp.minimum(jnp.minimum(jnp.min(expected), jnp.min(waiting)), now + company.alone)
    sooner = until < end
    until = jnp.minimum(until, end)
    no = jnp.asarray(False)
    decided = Call(coupling.starts, coupling.choice, seats, change, closed, until, no)
    began, done = call(
        layout, numbers, members, spheres, support, held, coupling.state,
        decided.where(needed & calls_first(state)), tolerance, rules.v0, derived=False,
    )  # fmt: skip
    after, status = done.state, done.status
    apart, rest = status == APART, status == AT_REST
    first, second = places(layout, members)
    flat = second >= members
    # At rest each sphere in contact is held by one wall.
    on_wall = after.closed & flat
    walls = jnp.where(on_wall, second - members, -1)
    resting = jnp.full(members, -1).at[first].max(walls)
    ends = apart | rest
    over = (status == TIME_IS_UP) & ~sooner
    failed = (status == FAILED) | ~jnp.isfinite(after.time)
    latched = jnp.zeros(members, numbers.dtype).at[first].max(jnp.where(on_wall, after.latched, 0))

    idle = jnp.where(after.time > state.now, 0, state.idle + 1)
    stop = jnp.where(over, OVER, jnp.where(idle > PATIENCE * count, ACCUMULATED, RUNNING))
    stop = jnp.where(company.crowded, CROWDED, stop)
    stop = jnp.where(failed, NOT_CONVERGED, stop)
    position = after.position[:members] + seats.shift * numbers.period[None]
    # A bound on the energy stored in contacts: the missing kinetic energy plus the work received.
    mass = masses(layout, numbers, seats)
    motion = [jnp.sum(jnp.square(x.velocity[:members]), axis=-1) for x in (began, after)]
    missing = jnp.sum(mass * (motion[0] - motion[1])) / 2 + jnp.maximum(done.work, 0)
    reserve = jnp.maximum(jnp.where(coupling.starts, 0, coupling.reserve) + missing, 0)
    # During the solve nothing else happens to the spheres in it.
    time, known = jnp.broadcast_to(after.time, (members,)), rows_of(events, who)
    state = (
        state._replace(events=events)
        .written(
            index,
            position=position,
            velocity=after.velocity[:members],
            time=time,
            support=jnp.where(rest, resting, -1),
            held=jnp.where(rest, latched, 0),
            count=counts + 1,
            owed=jnp.zeros(members, numbers.dtype),
            events=jax.tree.map(lambda a, b: jnp.where(ends, a, b), out_of_date(time), known),
        )
        ._replace(
            now=jnp.maximum(state.now, began.time),
            idle=idle,
            status=stop,
            coupling=Coupling(~ends, no, no, coupling.choice, seats, coupling.pace, reserve, after),
        )
    )
    zero = jnp.zeros((), numbers.dtype)
    two = jnp.zeros((2, layout.dimensions), numbers.dtype)
    nobody = Flying(two, two, jnp.zeros(2, numbers.dtype))
    outcome = Outcome(nobody, began.time, *[zero] * (len(Outcome._fields) - 2))
    work = work_of_walls(layout, numbers, seats, began, done)
    together = Together(spheres, held, as_numbers(began), as_numbers(after), work, done.error)
    blank, decided = jnp.full(2, -1), decided._replace(choice=None)
    called = Called(jnp.asarray(True), support, decided, ends, rest, status == PAUSED)
    figures = Figures(nobody, outcome, together)
    facts = Facts(coupling.choice, blank, no, jnp.full_like(zero, jnp.inf), called)
    return state, figures, facts, ~company.crowded
