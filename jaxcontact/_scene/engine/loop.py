"""The event loop: the next impact by one stored event a body, with fixed shapes.

Each sphere stores the time and the partner of its next event. It also stores the number of impacts
that the partner had when the event was found. The least time comes first. If the partner has had
another impact since, the event is out of date and only searched again. Otherwise both bodies are
moved to the impact, and their two rows are searched anew, among all bodies or those of nearby
cells. For every pair the body searched last stores the impact. No impact is missed, and no table of
pairs is needed.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int

from ..._coupled.modes import Flag, Index, Number
from ..._coupled.rows import rows_of, with_row
from ..._impact import Status
from ..arrays.arrays import Flying, SceneArrays, at_once, nearest_image, where_each
from ..contact_times.cells import CellGrid
from ..pair_impact.friction import is_followed
from ..pair_impact.instantaneous import Choice, ImpactOutcome, hit
from ..pair_impact.soft import soft
from ..readout.final_scene import resume_cluster
from ..resume import Underway
from .coupled import cluster_is_next, start_cluster, step_cluster
from .log import Log, LogDecisions, LogNumbers, blank_calls, blank_choice, blank_state
from .reach import is_isolated
from .rest import (
    begins_to_roll,
    comes_to_rest,
    flying_at_start,
    or_roll,
    supports_after,
    with_friction_at_rest,
)
from .search import (
    AGAIN,
    Due,
    in_branch,
    in_cluster,
    reset_events,
    simultaneous,
    stale_events,
    update_events,
)
from .slots import empty_slots
from .state import PATIENCE, Coupling, LoopStatus, Rules, RunState, RunTask

SLOW = 2.0**14
"""The limit of closing speeds for accumulation, in rounding errors of the largest speed.
Simultaneous impacts below it have accumulated."""


def initial_state(model: SceneArrays, rules: Rules, grid: CellGrid | None = None) -> RunState:
    """Return the start: all spheres at time zero, all events out of date, with initial contacts."""
    count, start = model.spheres, model.start
    spheres = flying_at_start(model)
    zero = spheres.time
    integers = jnp.zeros(count, int)
    now = jnp.zeros((), model.dtype)
    state = RunState(
        spheres.position, spheres.velocity, zero, integers - 1, integers, stale_events(zero),
        now, jnp.zeros((), int), jnp.zeros((), int), zero, zero, None, None,
        spheres.turning,
    )  # fmt: skip
    if start is not None:
        state = state._replace(support=start.support, held=start.held)
    if start is None or start.underway is None:
        return _first_events(model, rules, state, grid)
    return _resume_impacts(model, rules, state, grid, start.underway)


def _resume_impacts(
    model: SceneArrays, rules: Rules, state: RunState, grid: CellGrid | None, underway: Underway
) -> RunState:
    """Return a start within isolated impacts. Their touch, before time zero, is the next event of
    the bodies in them.
    """
    on = underway.counts
    led = Flying(underway.position, underway.velocity, underway.time, underway.turning)
    spheres = where_each(on, led, state.flying)
    state = state._replace(**spheres._asdict())
    state = _first_events(model, rules, state, grid)
    events = state.events
    events = events._replace(
        time=jnp.where(on, underway.touch, events.time),
        partner=jnp.where(on, underway.partner, events.partner),
        speed=jnp.where(on, 0, events.speed),
    )
    return state._replace(events=events, now=jnp.minimum(jnp.min(underway.touch), 0))


def _first_events(
    model: SceneArrays, rules: Rules, state: RunState, grid: CellGrid | None
) -> RunState:
    """Return the start with its initial contacts and its cells."""
    start = jnp.zeros((), model.dtype)
    if not rules.slots:
        return reset_events(model, state, start, grid)
    state = with_empty_slots(model, rules.slots, state)
    assert state.coupling is not None
    coupling = resume_cluster(model, state.coupling)
    # The search precedes the first call.
    start = jnp.where(coupling.active, jnp.minimum(coupling.state.time, start), start)
    state = reset_events(model, state._replace(coupling=coupling), start, grid)
    # During a solve nothing else happens to the spheres in it.
    inside = coupling.active & in_cluster(model, coupling)
    waits = state.events._replace(time=jnp.where(inside, jnp.inf, state.events.time))
    return state._replace(events=waits)


def with_empty_slots(model: SceneArrays, size: int, state: RunState) -> RunState:
    """Return the state with empty slots for a coupled solve. A run without slots that stopped
    because it needed one can continue.
    """
    no, zero = jnp.asarray(False), jnp.zeros((), model.dtype)
    nobody, slots = blank_choice(model), empty_slots(model, size)
    coupling = Coupling(
        no, no, no, nobody, slots, zero, zero,
        blank_state(model, size),
    )  # fmt: skip
    return state._replace(coupling=coupling, status=jnp.full_like(state.status, LoopStatus.RUNNING))


def has_events_left(state: RunState, end: Number) -> Flag:
    """Return whether events are left up to `end`, once all events up to there are searched."""
    more = jnp.min(state.events.time) <= end
    return more if state.coupling is None else more | state.coupling.active


def advance(
    task: RunTask, state: RunState, log: Log, written: Index | None = None
) -> tuple[RunState, Log, Index]:
    """Process impacts up to the end (inclusive), or until a log or cell is full or the run stuck.
    Rows are appended to the `written` ones. Returns the state, the log and the new number of rows.
    """
    end = task.end
    rows = log.facts.tied.shape[0]

    def unfinished(carry: tuple[RunState, Due, Log, Array]) -> Array:
        state, _, _, written = carry
        more = has_events_left(state, end) & (written < rows) & (state.status == LoopStatus.RUNNING)
        return more if state.cells is None else more & ~state.cells.full

    def step(carry: tuple[RunState, Due, Log, Array]) -> tuple[RunState, Due, Log, Array]:
        state, due, log, written = carry
        # In a batch a finished run only waits.
        needed = unfinished(carry)
        if state.coupling is None:
            state, figures, facts, fresh = _event(task, state, due, needed)
        else:
            state, figures, facts, fresh = jax.lax.cond(
                cluster_is_next(state),
                lambda: step_cluster(task, state, needed),
                lambda: _event(task, state, due, needed),
            )
        log = with_row(log, written, Log(figures, facts))
        until = end
        if state.coupling is not None:
            # After this time the coupled solve comes first.
            active, later = state.coupling.active, jnp.minimum(state.coupling.state.time, end)
            until = jnp.where(active, later, end)
            until = jnp.where(cluster_is_next(state), -jnp.inf, until)
        state, due = update_events(task.model, state, until, end)
        return state, due, log, written + fresh.astype(written.dtype)

    start = jnp.zeros((), int) if written is None else written
    none = jnp.zeros((), int)
    # No event is due before the first search.
    nothing = Due(state.now, state.now, none, none + AGAIN, none > 0)
    state, _, log, written = jax.lax.while_loop(unfinished, step, (state, nothing, log, start))
    return state, log, written


class _SolvedImpact(NamedTuple):
    """The effect of an impact, before it is written. It holds the two bodies `before` and after it,
    the choices, the supports, and the status. `alone`: whether the impact is isolated.
    """

    before: Flying
    choice: Choice
    outcome: ImpactOutcome
    support: Int[Array, "2"]
    count: Int[Array, "2"]
    rival: Number
    tied: Flag
    idle: Index
    status: Index
    alone: Flag


def _event(
    task: RunTask, state: RunState, due: Due, needed: Flag
) -> tuple[RunState, LogNumbers, LogDecisions, Flag]:
    """Process the impact that is due; the last value is True if there is one. `needed`: whether the
    lane needs it. The arrays of all spheres are read in a branch before they are written; otherwise
    they would be copied.
    """
    model, rules, end = task.model, task.rules, task.end
    until = end
    if state.coupling is not None:
        coupling = state.coupling
        until = jnp.where(coupling.active, jnp.minimum(coupling.state.time, end), end)
        needed = needed & ~cluster_is_next(state)
    count, i, partner = model.spheres, due.first, due.partner
    fresh = due.fresh & (due.least <= until)
    if state.cells is not None:
        fresh = fresh & ~state.cells.full
    now = jnp.maximum(due.time, state.now)
    is_sphere = partner < count
    # A wall has no row; the first body replaces it.
    who = jnp.stack([i, jnp.where(is_sphere, jnp.maximum(partner, 0), i)])
    met = in_branch(fresh, lambda: _solve_due(task, state, due, who, now, fresh & needed))
    choice, outcome = met.choice, met.outcome
    happens = fresh & met.alone
    starts = fresh & ~met.alone
    there = happens & jnp.stack([happens, is_sphere])
    rows = jnp.where(there, who, count + jnp.arange(2))
    # Their events are out of date, so that the following search finds them first.
    state = state.replace_rows(
        rows,
        **outcome.after._asdict(),
        support=met.support,
        count=met.count,
        owed=jnp.broadcast_to(outcome.energy_loss, (2,)),
        events=stale_events(jnp.stack([now, now])),
    )._replace(
        now=jnp.where(fresh, now, state.now),
        idle=jnp.where(happens, met.idle, state.idle),
        status=jnp.where(happens, met.status, state.status),
    )
    if rules.soft and state.coupling is None:
        state = state._replace(status=jnp.where(starts, LoopStatus.CROWDED, state.status))
    elif state.coupling is not None:
        met_then = choice._replace(time=outcome.time)
        coupling = start_cluster(model, state.coupling, starts, met_then, outcome.closing)
        state = state._replace(coupling=coupling)
    together = no_call = None
    if state.coupling is not None:
        together, no_call = blank_calls(model, rules.slots)
    figures = LogNumbers(met.before, outcome, together)
    return state, figures, LogDecisions(choice, met.support, met.tied, met.rival, no_call), happens


def _solve_due(
    task: RunTask, state: RunState, due: Due, who: Int[Array, "2"], now: Number, needed: Flag
) -> _SolvedImpact:
    """Compute the impact that is due; unless `needed`, its solve takes no step."""
    model, rules, tolerance, partner = task.model, task.rules, task.tolerance, due.partner
    columns = (state.flying, state.support, state.count, state.events)
    before, support, met, events = rows_of(columns, who)
    choice = _choice(model, who, partner, before, support, now)
    if rules.soft:
        outcome = soft(model, before, choice, tolerance, needed)
        alone = is_isolated(task, state, choice, outcome, now)
        if model.start is not None:
            # Impacts that began before the run are known to be isolated.
            alone = alone | ((now < 0) & (outcome.status == 0))
        crowded = jnp.asarray(False)
        if model.frictions is not None:
            # A law without an outcome ends the run.
            outcome = or_roll(model, before, choice, outcome, soft=True)
            alone = alone | begins_to_roll(model, choice)
            alone = alone | (outcome.status == int(Status.INVALID_INPUT))
            if is_followed(model):
                alone = alone & (outcome.error <= 2 * tolerance)
    else:
        choice = choice._replace(tail=comes_to_rest(model, choice, before, tolerance))
        outcome = hit(model, before, choice)
        outcome = or_roll(model, before, choice, outcome, soft=False)
        alone = jnp.asarray(True)
        support, crowded = supports_after(model, choice, outcome)
    curves = jnp.asarray(False)
    if model.frictions is not None:
        outcome, curves = with_friction_at_rest(model, choice, outcome, support)

    # An event of the partner that is not an impact does not compete.
    with_first = (events.partner[1] == who[0]) | (events.partner[1] < 0)
    competing = jnp.where(with_first, events.second[1], events.time[1])
    is_sphere = partner < model.spheres
    rival = jnp.minimum(events.second[0], jnp.where(is_sphere, competing, jnp.inf)) - now
    since = jnp.where(met > 0, now - before.time, jnp.inf)
    rival = jnp.minimum(rival, jnp.min(since))
    within = simultaneous(model, due.least)
    tied = rival <= within

    idle = jnp.where(now > state.now + within, 0, state.idle + 1)
    patience = PATIENCE * (model.spheres + model.walls)

    stuck = idle > patience
    if not rules.soft:
        eps = jnp.finfo(model.dtype).eps
        fastest = in_branch(tied, lambda: jnp.max(jnp.sum(jnp.square(state.velocity), axis=-1)))
        slow = outcome.closing <= SLOW * eps * jnp.sqrt(fastest)
        stuck = stuck | (tied & slow & ~choice.tail)
    stuck = jnp.where(stuck, LoopStatus.ACCUMULATED, LoopStatus.RUNNING)
    status = jnp.where(crowded, LoopStatus.TWO_SUPPORTS, stuck)
    if not rules.soft:
        # A law that is not solved has no e.
        status = jnp.where(jnp.isnan(outcome.restitution), LoopStatus.NOT_CONVERGED, status)
    if model.frictions is not None:
        status = jnp.where(curves | (outcome.status != 0), LoopStatus.FRICTION, status)
    return _SolvedImpact(
        before, choice, outcome, support, met + 1, rival, tied, idle, status, alone
    )


def _choice(
    model: SceneArrays,
    who: Int[Array, "2"],
    partner: Index,
    before: Flying,
    support: Int[Array, "2"],
    now: Number,
) -> Choice:
    """Return the discrete choices about an impact: its bodies and their image."""
    image = jnp.zeros(model.dimensions, model.dtype)
    if any(model.periodic):
        place = at_once(model, who, before, support, now)[0].position
        nearest = nearest_image(model, (place[0] - place[1])[None])[1][0]
        image = jnp.where(partner < model.spheres, nearest, image)
    return Choice(who[0], jnp.maximum(partner, 0), support, image, now, jnp.asarray(False))
