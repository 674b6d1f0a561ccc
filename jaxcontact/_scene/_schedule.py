"""The search: which impact comes next, one stored event a body, fixed shapes.

Each sphere stores the time and the partner of its next event, and how many impacts the partner had
had when it was found. The least time is taken; if the partner has met something else since, the
event is out of date and only searched again. Otherwise both bodies are moved to the impact, and
their two rows are searched anew, among all bodies. Of every pair the one that was searched last
knows the impact, so that none is missed, and there is no table of pairs.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ._calls import among_others, begins, called, seated
from ._coupled import blank_state
from ._hit import Choice, Flying, Outcome, accelerations, hit
from ._isolation import isolated
from ._log import Facts, Figures, Log, blank_calls
from ._progress import (
    ACCUMULATED,
    CROWDED,
    PATIENCE,
    RUNNING,
    TWO_SUPPORTS,
    Coupling,
    Events,
    Rules,
    State,
)
from ._search import NOISE, searched, simultaneous
from ._slots import empty_seats
from ._soft import soft
from ._system import Layout, Numbers, nearest_image

SLOW = 2.0**14
"""Roundings of the largest speed below which closing speeds of simultaneous impacts have died out:
the impacts have accumulated."""


def begun(layout: Layout, numbers: Numbers, rules: Rules, end: Float[Array, ""]) -> State:
    """The start: all spheres at time zero, their first events found one row after the other."""
    count = layout.spheres
    zero = jnp.zeros(count, numbers.dtype)
    whole = jnp.zeros(count, int)
    none = whole - 1
    start = jnp.zeros((), numbers.dtype)
    state = State(
        numbers.position, numbers.velocity, zero, none, whole,
        Events(zero, none, whole, zero, zero), start, jnp.zeros((), int), jnp.zeros((), int),
        zero, zero, None,
    )  # fmt: skip
    if rules.members:
        _, blank = blank_calls(layout, rules.members, numbers.dtype)
        no = jnp.asarray(False)
        coupling = Coupling(
            no, no, no, blank.decided.choice, empty_seats(layout, numbers, rules.members),
            start, start, blank_state(layout, rules.members, numbers.dtype),
        )  # fmt: skip
        state = state._replace(coupling=coupling)

    def row(i: Int[Array, ""]) -> Events:
        return jax.tree.map(lambda x: x[0], searched(layout, numbers, state, i[None], start, end))

    return state._replace(events=jax.lax.map(row, jnp.arange(count)))


def advance(
    layout: Layout,
    numbers: Numbers,
    rules: Rules,
    state: State,
    log: Log,
    end: Float[Array, ""],
    tolerance: Float[Array, ""],
) -> tuple[State, Log, Int[Array, ""]]:
    """Impacts up to `end` (inclusive), until the log is full or the run is stuck.

    Returns how many rows were written.
    """
    rows = log.facts.tied.shape[0]

    def unfinished(carry: tuple[State, Log, Array]) -> Array:
        state, _, written = carry
        within = jnp.min(state.events.time) <= end
        if state.coupling is not None:
            within = within | state.coupling.active
        return within & (written < rows) & (state.status == RUNNING)

    def step(carry: tuple[State, Log, Array]) -> tuple[State, Log, Array]:
        state, log, written = carry
        given = (layout, numbers, rules, state, end, tolerance)
        if state.coupling is None:
            state, figures, facts, fresh = _event(*given)
        else:
            coupling = state.coupling
            # What happens to others before goes first, but for a touch that is known.
            sooner = coupling.touches | (coupling.state.time < jnp.min(state.events.time))
            state, figures, facts, fresh = jax.lax.cond(
                coupling.active & sooner, lambda: called(*given), lambda: _event(*given)
            )
        log = jax.tree.map(lambda all, one: all.at[written].set(one), log, Log(figures, facts))
        return state, log, written + fresh.astype(written.dtype)

    return jax.lax.while_loop(unfinished, step, (state, log, jnp.zeros((), int)))


def _event(
    layout: Layout,
    numbers: Numbers,
    rules: Rules,
    state: State,
    end: Float[Array, ""],
    tolerance: Float[Array, ""],
) -> tuple[State, Figures, Facts, Bool[Array, ""]]:
    """The next event, and whether it was an impact."""
    count, events = layout.spheres, state.events
    least = jnp.min(events.time)
    together_within = simultaneous(numbers, least)
    i = jnp.argmax(jnp.where(events.time <= least + together_within, events.speed, -jnp.inf))
    now = jnp.maximum(events.time[i], state.now)
    partner = events.partner[i]
    j = jnp.clip(partner, 0, count - 1)
    is_sphere = (partner >= 0) & (partner < count)
    fresh = (partner >= count) | (is_sphere & (state.count[j] == events.count[i]))
    if state.coupling is not None:
        # Who is in a coupled solve flies on another way.
        fresh = fresh & ~(is_sphere & state.coupling.active & seated(layout, state.coupling)[j])
    # A wall has no row: the first body stands in for it.
    j = jnp.where(is_sphere, j, i)
    who = jnp.stack([i, j])

    before = Flying(state.position[who], state.velocity[who], state.time[who])
    choice = _choice(layout, numbers, state, who, jnp.maximum(partner, 0), before, now, tolerance)
    if rules.soft:
        # A contact that takes time comes to rest by itself.
        choice = choice._replace(tail=jnp.asarray(False))

    def struck() -> Outcome:
        if rules.soft:
            return soft(layout, numbers, before, choice, tolerance)
        return hit(layout, numbers, before, choice)

    still = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), jax.eval_shape(struck))
    outcome = jax.lax.cond(fresh, struck, lambda: still)
    support, crowded = _supports(layout, numbers, choice, outcome)
    starts = jnp.asarray(False)
    if rules.soft:
        alone = isolated(layout, numbers, rules, state, choice, outcome, now, tolerance)
        starts = fresh & ~alone
        fresh = fresh & alone
        crowded = jnp.asarray(False)
        support = choice.support

    competing = jnp.where(events.partner[j] == i, events.second[j], events.time[j])
    rival = jnp.minimum(events.second[i], jnp.where(is_sphere, competing, jnp.inf)) - now
    since = jnp.where(state.count[who] > 0, now - state.time[who], jnp.inf)
    rival = jnp.minimum(rival, jnp.min(since))
    tied = rival <= together_within

    def put(all: Array, new: Array) -> Array:
        old = all[who]
        keep = jnp.stack([fresh, fresh & is_sphere]).reshape((2,) + (1,) * (old.ndim - 1))
        new = jnp.where(keep, new, old)
        # The second first: where it stands for a wall it is the first body again.
        return all.at[j].set(new[1]).at[i].set(new[0])

    idle = jnp.where(now > state.now + together_within, 0, state.idle + 1)
    patience = PATIENCE * (layout.spheres + layout.walls)
    fastest = jnp.max(jnp.sqrt(jnp.sum(jnp.square(state.velocity), axis=-1)))
    slow = outcome.closing <= SLOW * jnp.finfo(numbers.dtype).eps * fastest
    died = slow & (rival <= together_within) & ~choice.tail
    if rules.soft:
        died = jnp.asarray(False)
    stuck = jnp.where(died | (idle > patience), ACCUMULATED, RUNNING)
    status = jnp.where(fresh & crowded, TWO_SUPPORTS, stuck)
    state = state._replace(
        position=put(state.position, outcome.after.position),
        velocity=put(state.velocity, outcome.after.velocity),
        time=put(state.time, outcome.after.time),
        support=put(state.support, support),
        count=put(state.count, state.count[who] + 1),
        now=jnp.where(fresh | starts, now, state.now),
        idle=jnp.where(fresh, idle, state.idle),
        status=jnp.where(fresh, status, state.status),
        owed=put(state.owed, jnp.broadcast_to(outcome.energy_loss, (2,))),
    )
    if rules.soft and state.coupling is None:
        state = state._replace(status=jnp.where(starts, CROWDED, state.status))
    elif state.coupling is not None:
        state = state._replace(
            coupling=begins(layout, numbers, state.coupling, starts, choice, outcome.closing)
        )
    found = searched(layout, numbers, state, who, now, end)
    if state.coupling is not None:
        found = among_others(layout, numbers, state.coupling, found, now)
    state = state._replace(
        events=jax.tree.map(lambda all, new: all.at[who].set(new), events, found)
    )
    together = no_call = None
    if state.coupling is not None:
        together, no_call = blank_calls(layout, rules.members, numbers.dtype)
    figures = Figures(before, outcome, together)
    return state, figures, Facts(choice, support, tied, rival, no_call), fresh


def _choice(
    layout: Layout,
    numbers: Numbers,
    state: State,
    who: Int[Array, "2"],
    partner: Int[Array, ""],
    before: Flying,
    now: Float[Array, ""],
    tolerance: Float[Array, ""],
) -> Choice:
    """The decisions about an impact: its image, and whether a ball comes to rest on a wall.

    A ball on a wall that gravity presses it to, with a constant e < 1, bounces for ever in a finite
    time. Where the next bounce is lower than `tolerance` radii its time is summed.
    """
    support = state.support[who]
    pull = accelerations(layout, numbers, who, support)
    passed = (now - before.time)[:, None]
    velocity = before.velocity + pull * passed
    position = before.position + (before.velocity + velocity) / 2 * passed
    image = nearest_image(layout, numbers, (position[0] - position[1])[None])[1][0]
    tail = jnp.asarray(False)
    if layout.walls and layout.gravity and any(layout.constant):
        wall = jnp.clip(partner - layout.spheres, 0)
        face = numbers.normal[wall]
        weight = -jnp.sum(face * numbers.gravity)
        closing = jnp.maximum(-jnp.sum(face * velocity[0]), 0)
        law = layout.chosen(layout.laws, who[0], partner) if layout.laws else 0
        e = numbers.restitution[law]
        low = jnp.square(e * closing) <= 2 * weight * tolerance * numbers.radius[who[0]]
        rests = (weight > 0) & (e < 1) & low & jnp.asarray(layout.constant)[law]
        # On a wall that moves the bounces are not those of a series.
        stands = ~jnp.asarray(layout.moving)[wall]
        tail = (partner >= layout.spheres) & rests & stands
    image = jnp.where(partner < layout.spheres, image, 0)
    return Choice(who[0], partner, support, image, now, tail)


def _supports(
    layout: Layout, numbers: Numbers, choice: Choice, outcome: Outcome
) -> tuple[Int[Array, "2"], Bool[Array, ""]]:
    """The walls that the two bodies rest on after the impact, and whether one needs two walls."""
    support = choice.support
    if not layout.walls:
        return support, jnp.asarray(False)
    velocity = outcome.after.velocity
    normal = numbers.normal[jnp.maximum(support, 0)]
    leaving = jnp.abs(jnp.sum(velocity * normal, axis=-1))
    speed = jnp.sqrt(jnp.sum(jnp.square(velocity), axis=-1)) + outcome.closing
    kept = (support >= 0) & (leaving <= NOISE * jnp.finfo(numbers.dtype).eps * speed)
    support = jnp.where(kept, support, -1)
    wall = choice.second - layout.spheres
    crowded = choice.tail & kept[0] & (support[0] != wall)
    first = jnp.where(choice.tail, wall, support[0])
    return jnp.stack([first, support[1]]), crowded
