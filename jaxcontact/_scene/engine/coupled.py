"""The coupled solve of the spheres near a contact, for everything but isolated impacts: its start
and its calls within a run. Every pair that can meet has a slot, so that bodies can join and leave.
A call ends when a pair touches or opens, or at a given time.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array

from ..._coupled.energies import stored_energy
from ..._coupled.modes import APART, AT_REST, NOT_CONVERGED, PAUSED, TIME_IS_UP, Flag, Number
from ..._coupled.rows import rows_of
from ..arrays.arrays import (
    SceneArrays,
    at_once,
    known_contact_of,
    law_of,
)
from ..cluster.problem import ClusterEnd, ClusterState
from ..pair_impact.friction import is_followed
from ..pair_impact.instantaneous import Choice
from .coupled_call import call, meets, touching, walls_under
from .coupled_friction import (
    spin_energy_lost,
)
from .log import (
    Call,
    ClusterDecisions,
    ClusterNumbers,
    LogDecisions,
    LogNumbers,
    as_numbers,
    no_impact,
)
from .near_pairs import with_near_pairs
from .rest import rest_on_walls
from .search import OUT_OF_DATE, in_cluster, simultaneous, stale_events, without_cluster
from .slots import (
    bodies_of,
    fill_slots,
    masses,
    pace_of,
    pairs_of,
    rearrange,
    resting_pairs,
    slot_change,
    slot_pairs,
)
from .state import PATIENCE, Coupling, LoopStatus, RunState, RunTask, Slots, index_of

MOST = 8
"""The default number of slots of a coupled solve."""


def work_of_walls(model: SceneArrays, slots: Slots, began: ClusterState, end: ClusterEnd) -> Number:
    """Return the work of moving walls and fixed spheres in one call, in J. It is all work except
    that of gravity.
    """
    if model.motion is None and not model.driven:
        return jnp.zeros((), model.dtype)
    mass, size = masses(model, slots), slots.size
    fall = end.state.position[:size] - began.position[:size]
    weight = jnp.sum(mass * jnp.sum(fall * model.gravity[None], axis=-1))
    return end.work - weight


def contact_energy(model: SceneArrays, slots: Slots, state: ClusterState) -> Number:
    """Return the elastic energy of all contacts, Σ ∫ F(δ, 0) dδ."""

    def energy(
        i: Array, j: Array, depth: Array, closed: Array, speed: Array, deepest: Array | None
    ) -> Array:
        contact = known_contact_of(model, i, j)
        law = law_of(model, i, j)
        return stored_energy(law, contact, jnp.where(closed, depth, 0), speed, deepest)

    columns = (state.indentation, state.closed, state.latched, state.deepest)
    return jnp.sum(jax.vmap(energy)(*bodies_of(model, slots), *columns))


def start_cluster(
    model: SceneArrays, before: Coupling, starts: Flag, choice: Choice, closing: Number
) -> Coupling:
    """Return the coupling after a touch that is not isolated, if it `starts` or joins a solve."""
    pace = pace_of(model, choice, closing)
    pace = jnp.where(before.active, jnp.minimum(before.pace, pace), pace)
    after = before._replace(
        active=starts, starts=~before.active, touches=starts, choice=choice, pace=pace
    )
    return jax.tree.map(lambda a, b: jnp.where(starts, a, b), after, before)


def cluster_is_next(state: RunState) -> Flag:
    """Return whether the next call of the active solve precedes all events of other spheres. A
    known touch is part of that call.
    """
    coupling = state.coupling
    assert coupling is not None
    sooner = coupling.state.time < jnp.min(state.events.time)
    return coupling.active & (coupling.touches | sooner)


def step_cluster(
    task: RunTask, state: RunState, needed: Flag
) -> tuple[RunState, LogNumbers, LogDecisions, Flag]:
    """Make one call of the coupled solve, until a pair touches or opens or other events are due."""
    model, rules, end = task.model, task.rules, task.end
    count, size, coupling = model.spheres, rules.slots, state.coupling
    assert coupling is not None
    now = jnp.where(coupling.starts, coupling.choice.time, coupling.state.time)
    filled = fill_slots(model, state, now)
    slots = filled.slots
    change = slot_change(model, coupling.slots, slots, coupling.starts)
    who, index = jnp.minimum(slots.who, count - 1), index_of(model, slots)
    spheres = rows_of(state.flying, who)
    support, held, counts = rows_of((state.support, state.held, state.count), who)
    there = at_once(model, who, spheres, support, now)[0]
    closed, gap = touching(model, slots, there, support, now)
    closed = closed | (coupling.touches & meets(model, slots, coupling.choice))
    lasts = rearrange(coupling.state, change).closed & ~change.fresh & ~coupling.starts
    pairs = pairs_of(model, slots)
    filled = with_near_pairs(model, filled, pairs.used, closed | lasts, gap)
    # A body squeezed out by moving ones may have been faster than its bound.
    deep = gap < -jnp.sqrt(jnp.finfo(model.dtype).eps) * jnp.abs(pairs.distance)
    missed = jnp.any(pairs.used & change.fresh & ~resting_pairs(model, support) & deep)
    filled = filled._replace(crowded=filled.crowded | missed)

    # A sphere that leaves is searched before anything else.
    going_on = coupling._replace(slots=slots)
    inside = in_cluster(model, going_on)
    leaves = in_cluster(model, coupling) & ~inside & ~coupling.starts
    events = without_cluster(model, going_on, state.events, now)
    expected = jnp.where(inside, jnp.inf, jnp.where(leaves, now, events.time))
    events = events._replace(time=expected, partner=jnp.where(leaves, OUT_OF_DATE, events.partner))
    waiting = jnp.where(state.time > now + simultaneous(model, now), state.time, jnp.inf)
    until = jnp.minimum(jnp.minimum(jnp.min(expected), jnp.min(waiting)), now + filled.alone)
    sooner = until < end
    until = jnp.minimum(until, end)
    no = jnp.asarray(False)
    decided = Call(coupling.starts, coupling.choice, slots, change, closed, until, no, filled.near)
    began, done = call(
        model, spheres, support, held, coupling.state,
        decided.where(needed & cluster_is_next(state)), task.tolerance, rules.v0, derived=False,
    )  # fmt: skip
    status = done.status
    apart, rest = status == APART, status == AT_REST
    first, second = slot_pairs(model, size)
    flat = second >= size
    # At rest each sphere in contact is held by one wall.
    on_wall = done.state.closed & flat
    resting = walls_under(model, size, on_wall)
    supported = jnp.where(rest, resting, -1)
    done, turning, bent = rest_on_walls(model, slots, done, supported)
    after = done.state
    ends = apart | rest
    over, unknown = (status == TIME_IS_UP) & ~sooner, no
    if not is_followed(model):
        # The call may also end because a contact lasts, and a friction impulse have no outcome.
        over, unknown = over & (after.time >= end), ~jnp.all(jnp.isfinite(after.velocity))
    failed = (status == NOT_CONVERGED) | ~jnp.isfinite(after.time)
    latched = jnp.zeros(size, model.dtype).at[first].max(jnp.where(on_wall, after.latched, 0))

    idle = jnp.where(after.time > state.now, 0, state.idle + 1)
    stop = jnp.where(
        over,
        LoopStatus.OVER,
        jnp.where(idle > PATIENCE * count, LoopStatus.ACCUMULATED, LoopStatus.RUNNING),
    )
    stop = jnp.where(filled.crowded, LoopStatus.CROWDED, stop)
    if turning is not None:
        stop = jnp.where((rest & jnp.any(bent)) | unknown, LoopStatus.FRICTION, stop)
    stop = jnp.where(failed, LoopStatus.NOT_CONVERGED, stop)
    position = after.position[:size] + slots.shift * model.period[None]
    # A bound on the energy stored in contacts: the missing kinetic energy plus the work received.
    mass = masses(model, slots)
    motion = [jnp.sum(jnp.square(x.velocity[:size]), axis=-1) for x in (began, after)]
    missing = jnp.sum(mass * (motion[0] - motion[1])) / 2 + jnp.maximum(done.work, 0)
    if model.frictions is not None:
        missing = missing + spin_energy_lost(model, slots, began, after)
    reserve = jnp.maximum(jnp.where(coupling.starts, 0, coupling.reserve) + missing, 0)
    # During the solve nothing else happens to the spheres in it.
    time, later = jnp.broadcast_to(after.time, (size,)), rows_of(events, who)
    columns = {} if turning is None else {"turning": turning}
    state = (
        state._replace(events=events)
        .replace_rows(
            index,
            position=position,
            velocity=after.velocity[:size],
            time=time,
            support=supported,
            held=jnp.where(rest, latched, 0),
            count=counts + 1,
            owed=jnp.zeros(size, model.dtype),
            events=jax.tree.map(lambda a, b: jnp.where(ends, a, b), stale_events(time), later),
            **columns,
        )
        ._replace(
            now=jnp.maximum(state.now, began.time),
            idle=idle,
            status=stop,
            coupling=Coupling(~ends, no, no, coupling.choice, slots, coupling.pace, reserve, after),
        )
    )
    none, zero = no_impact(model), jnp.zeros((), model.dtype)
    outcome = none._replace(time=began.time)
    work = work_of_walls(model, slots, began, done)
    states = as_numbers(began), as_numbers(after)
    together = ClusterNumbers(spheres, held, *states, work, done.error, turning, done.rubbed)
    blank, decided = jnp.full(2, -1), decided._replace(choice=None)
    called = ClusterDecisions(jnp.asarray(True), support, decided, ends, rest, status == PAUSED)
    figures = LogNumbers(none.after, outcome, together)
    facts = LogDecisions(coupling.choice, blank, no, jnp.full_like(zero, jnp.inf), called)
    return state, figures, facts, ~filled.crowded
