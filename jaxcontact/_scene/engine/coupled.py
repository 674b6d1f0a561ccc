"""The coupled solve of the spheres near a contact, for everything but isolated impacts: its start
and its calls within a run. Every pair that can meet has a slot, so that bodies can join and leave.
A call ends when a pair touches or opens, or at a given time.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..._coupled.energies import stored_energy
from ..._coupled.modes import APART, AT_REST, NOT_CONVERGED, PAUSED, TIME_IS_UP, Flag, Number
from ..._coupled.rows import rows_of, with_rows
from ..arrays.arrays import (
    Flying,
    SceneArrays,
    SceneLayout,
    accelerations,
    at_once,
    known_contact_of,
    law_of,
    nearest_image,
)
from ..bodies.motion import UserMotion
from ..bodies.overlap import ROUNDINGS
from ..cluster.problem import ClusterEnd, ClusterPairs, ClusterProblem, ClusterState, Drive
from ..cluster.solve import MOST_STEPS, cluster, cluster_at_touch
from ..pair_impact.friction import is_followed
from ..pair_impact.instantaneous import Choice, meeting_of, two_that_meet
from .coupled_friction import (
    fresh_rubbing,
    impulses,
    joined_rubbing,
    pair_friction,
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
from .near_pairs import PairList, with_near_pairs
from .rest import rest_on_walls
from .search import OUT_OF_DATE, in_cluster, simultaneous, stale_events, without_cluster
from .slots import (
    bodies_of,
    fill_slots,
    in_line,
    map_pairs,
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


def slot_states(
    model: SceneArrays, slots: Slots, spheres: Flying, time: Array
) -> tuple[Array, Array]:
    """Return positions and velocities of all slots; a wall is at the foot of its normal."""
    walls = model.walls_at(time)
    image = spheres.position - slots.shift * model.period[None]
    position = jnp.concatenate([image, walls.offset[:, None] * model.normal])
    driven = walls.velocity[:, None] * model.normal
    return position, jnp.concatenate([spheres.velocity, driven])


def meets(layout: SceneLayout, slots: Slots, choice: Choice) -> Bool[Array, " P"]:
    """Return the pair of an impact."""
    one, other = bodies_of(layout, slots)
    straight = (choice.first == one) & (choice.second == other)
    return straight | ((choice.first == other) & (choice.second == one))


def walls_under(layout: SceneLayout, size: int, on_wall: Bool[Array, " P"]) -> Int[Array, " M"]:
    """Return the wall of each sphere by its pairs `on_wall`, all with walls; -1 for none."""
    first, second = slot_pairs(layout, size)
    walls = jnp.where(on_wall, second - size, -1)
    return jnp.full(size, -1).at[first].max(walls)


def touching(
    model: SceneArrays, slots: Slots, there: Flying, support: Int[Array, " M"], time: Number
) -> tuple[Bool[Array, " P"], Float[Array, " P"]]:
    """Return the pairs that touch within rounding and do not separate, or rest on a wall; and the
    gaps of all.
    """
    size = slots.size
    first, second = slot_pairs(model, size)
    pairs = pairs_of(model, slots)
    position, velocity = slot_states(model, slots, there, time)
    apart = _nearest_images(model, pairs, position).between(position)
    rate = velocity[first] - velocity[second]
    gap, opening = pairs.gaps(apart, rate)
    eps = jnp.finfo(model.dtype).eps
    present = slots.present[:, None]
    scale = jnp.max(jnp.abs(jnp.where(present, there.position, 0))) + jnp.max(model.radius)
    speed = jnp.max(jnp.abs(jnp.where(present, there.velocity, 0)))
    if model.motion is not None:
        speed = jnp.maximum(speed, jnp.max(jnp.abs(velocity[size:])))
    touches = (gap <= ROUNDINGS * eps * scale) & (opening <= ROUNDINGS * eps * speed)
    return pairs.used & (touches | resting_pairs(model, support)), gap


def _nearest_images(model: SceneArrays, pairs: ClusterPairs, position: Array) -> ClusterPairs:
    """Return the pairs with the nearest images of their bodies."""
    if not any(model.periodic):
        return pairs
    shift = nearest_image(model, pairs.between(position))[1]
    return pairs._replace(away=jnp.where(pairs.flat[:, None], 0, shift * model.period[None]))


def call(
    model: SceneArrays,
    spheres: Flying,
    support: Int[Array, " M"],
    held: Float[Array, " M"],
    before: ClusterState,
    decided: Call,
    rtol: Number,
    v0: Any,
    max_steps: int = MOST_STEPS,
    derived: bool = True,
) -> tuple[ClusterState, ClusterEnd]:
    """Make one call of the coupled solve; return its initial state and its end.

    `spheres`, `support` and `held`, the v0 of spheres at rest, belong to the bodies in the slots.
    The time of the touch that starts it is known. If its derivative is needed, it is `derived` from
    the two bodies.
    """
    slots, change, size = decided.slots, decided.change, decided.slots.size
    who = jnp.minimum(slots.who, model.spheres - 1)
    pairs = pairs_of(model, slots)
    first, second = slot_pairs(model, size)

    # The time of the touch that starts it, or of the end of the last call.
    assert decided.choice is not None
    touch = decided.choice.time
    if derived:
        touch = _touch(model, spheres, decided)
    time = jnp.where(decided.starts, touch, before.time)
    before = rearrange(before, change)

    # New bodies come from their flight formulas; their pairs are fresh.
    there = at_once(model, who, spheres, support, time)[0]
    joined = jnp.concatenate([change.joined, jnp.zeros(model.walls, bool)])
    came = (joined | decided.starts)[:, None]
    position, velocity = slot_states(model, slots, there, time)
    position = jnp.where(came, position, before.position)
    velocity = jnp.where(came, velocity, before.velocity)
    fresh = decided.starts | change.fresh
    pairs = _nearest_images(model, pairs, position)
    drift: Array | float = 0.0
    if derived:

        def opening(time: Number) -> Array:
            flown = at_once(model, who, spheres, support, time)[0]
            position, velocity = slot_states(model, slots, flown, time)
            return pairs.gaps(pairs.between(position), velocity[first] - velocity[second])[1]

        drift = jax.jvp(opening, (time,), (jnp.ones_like(time),))[1]
    start = cluster_at_touch(pairs, position, velocity, decided.closed & fresh, v0=v0, drift=drift)
    rests = resting_pairs(model, support)
    none = jnp.zeros(size, model.dtype)
    height = jnp.sum(there.position[first] * pairs.normal, axis=-1)
    sunk = pairs.distance - height + jnp.concatenate([none, model.walls_at(time).offset])[second]
    since = start.since + time
    start = start._replace(
        time=time,
        rubbing=fresh_rubbing(model, slots, there, support, rests),
        indentation=jnp.where(rests, sunk, start.indentation),
        latched=jnp.where(rests, rows_of(held, first), start.latched),
        rising=start.rising & ~rests,
        since=since,
        force_until=since,
        deepest=jnp.zeros_like(since) if model.remembers else None,
    )
    begin = start._replace(
        **{
            name: jnp.where(fresh, getattr(start, name), getattr(before, name))
            for name in ClusterState._fields
            if name not in ("time", "position", "velocity", "rubbing")
            and getattr(start, name) is not None
        },
        rubbing=joined_rubbing(start.rubbing, before.rubbing, came, fresh),
    )
    if pairs.away is not None:
        # The nearest image of an open pair may differ from that in the last call.
        depth = jnp.where(begin.closed, begin.indentation, start.indentation)
        begin = begin._replace(indentation=depth)

    inverse = jnp.where(slots.present, rows_of(model.inverse_mass, who), 0)
    inverse = jnp.concatenate([inverse, model.inverse_mass[model.spheres :]])
    pull = accelerations(model, who, jnp.full(size, -1))
    pull = jnp.where(slots.present[:, None], pull, 0)
    pull = jnp.concatenate([pull, jnp.zeros((model.walls, model.dimensions), model.dtype)])
    followed = PairList(model, size, decided.near)
    touches = decided.closed & fresh & ~rests
    one, other, rests, touches = followed.columns((*bodies_of(model, slots), rests, touches))
    some, start = followed.pairs(pairs), map_pairs(followed.columns, begin)
    # Unused slots get the numbers of a used pair.
    used_pair = jnp.argmax(some.used)
    one, other = (jnp.where(some.used, body, rows_of(body, used_pair)) for body in (one, other))
    contact = jax.vmap(lambda i, j: known_contact_of(model, i, j))(one, other)
    law = jax.vmap(lambda i, j: law_of(model, i, j))(one, other)
    drive = _drive(model, slots, begin.time)
    bodies, moved_by = (one, other), (inverse, pull, drive)
    limits = rests, decided.until, decided.to_the_end
    setting = model, bodies, some
    start, until, impulsive, completed = impulses(setting, contact, moved_by, start, limits)
    friction = pair_friction(setting, slots, touches & some.used, impulsive)
    problem = ClusterProblem(
        law, contact, some, inverse, pull, start, until, rtol, drive, decided.to_the_end, friction
    )
    rules = {"v0": v0, "until_change": True, "in_line": in_line(model), "max_steps": max_steps}
    end = cluster(problem, **rules)
    # The exact time, so that no further call is needed; without a step that of the beginning.
    over = jnp.where((end.status == TIME_IS_UP) & (until > time), until, end.state.time)
    end = completed(end._replace(state=end.state._replace(time=over)))
    return begin, end._replace(state=followed.whole(end.state, begin, pairs))


def _touch(model: SceneArrays, spheres: Flying, decided: Call) -> Number:
    """Return the time of the touch that starts a solve."""
    slots, choice = decided.slots, decided.choice
    assert choice is not None
    first = jnp.argmax(slots.who == choice.first)
    # A wall has no slot. The first body replaces it, as another body may be ahead in time.
    second = jnp.argmax(slots.who == choice.second)
    two = jnp.stack([first, jnp.where(choice.second < model.spheres, second, first)])
    nobody = two_that_meet(model, choice.time)
    struck = jax.tree.map(lambda x, y: jnp.where(decided.starts, x[two], y), spheres, nobody)
    met = choice._replace(second=jnp.where(decided.starts, choice.second, choice.first))
    return meeting_of(model, struck, met).time


def _drive(model: SceneArrays, slots: Slots, time: Array) -> Drive | None:
    """Return the drive of the slots from a time on; None without moving walls or shaken spheres."""
    walls, spheres = model.motion, model.shaking
    if walls is None and spheres is None:
        return None
    size, total = slots.size, slots.size + model.walls
    strength = jnp.zeros((total, model.dimensions), model.dtype)
    rate, phase = jnp.zeros(total, model.dtype), jnp.zeros(total, model.dtype)
    moves = jnp.asarray((False,) * size + model.moving)
    shakes = jnp.asarray((False,) * size + model.vibrating)
    users: list[tuple[UserMotion, Any]] = []
    if walls is not None:
        push = walls.amplitude * jnp.square(walls.rate)
        strength = strength.at[size:].set(push[:, None] * model.normal)
        rate = rate.at[size:].set(walls.rate)
        phase = phase.at[size:].set(walls.rate * time + walls.phase)
        users += [(user, size + w) for w, user in enumerate(walls.own) if user is not None]
    if spheres is not None:
        # The slot of each shaken sphere, beyond all slots if it is absent.
        named = jnp.asarray(model.shaken)
        sits = (slots.who[None] == named[:, None]) & slots.present[None]
        nowhere = total + jnp.arange(len(model.shaken))
        slot = jnp.where(jnp.any(sits, axis=1), jnp.argmax(sits, axis=1), nowhere)
        push = spheres.amplitude * jnp.square(spheres.rate)[:, None]
        yes = jnp.ones(slot.shape, bool)
        strength, rate, phase, moves, shakes = with_rows(
            (strength, rate, phase, moves, shakes),
            slot,
            (push, spheres.rate, spheres.rate * time + spheres.phase, yes, yes),
        )
        users += [(user, slot[k]) for k, user in enumerate(spheres.own) if user is not None]
    return Drive(
        strength=strength,
        rate=rate,
        phase=phase,
        moves=moves,
        shakes=shakes,
        own=tuple((user.later(time), at) for user, at in users),
    )


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
    used = pairs_of(model, slots).used
    filled = with_near_pairs(model, filled, used, closed | lasts, gap)

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
