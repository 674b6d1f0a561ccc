"""The members of a coupled solve of some of the spheres.

Bodies in contact form its core. The speed of each sphere is bounded by the total energy of the
cluster. Spheres that the cluster could reach within `pace` join it, nearest in time first, and add
their energy. All other spheres stay in closed-form flight, and the solve ends before it could meet
one of them.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Int

from ..._coupled.modes import Flag, Index, Number
from ..arrays.arrays import SceneArrays, SceneLayout, known_contact_of, least_speed, nearest_image
from ..arrays.flight import Flying, at_once
from ..bodies.bodies import side
from ..pair_impact.instantaneous import Choice
from .cluster_slots import Slots, all_fit, bodies_of, identity_slots, in_line
from .coupled_friction import pace_of_contact
from .next_event import simultaneous
from .state import Coupling, RunState

_CALLS = 64
"""The number of calls into which the first third of an impact may be divided. It matters if there
is no place for all spheres within reach in that time."""


class ClusterMembers(NamedTuple):
    """The `seats` of a call, and its limits. The call may last for `alone` s before other spheres
    must be considered. `crowded`: whether there are too few places, or an image of a member is
    within reach.
    """

    seats: Slots
    alone: Number
    crowded: Flag


def pace_of(model: SceneArrays, choice: Choice, closing: Number) -> Number:
    """Return about a third of an impact's duration: X/v with X = (μ v²/K)^(1/(n+1)), in s."""
    contact = known_contact_of(model, choice.first, choice.second)
    return pace_of_contact(contact, jnp.maximum(closing, least_speed(model)))


def select_members(
    model: SceneArrays, members: int, state: RunState, now: Number
) -> ClusterMembers:
    """Return the members of the next call of the coupled solve."""
    coupling, count = state.coupling, model.spheres
    assert coupling is not None
    ready = state.time <= now + simultaneous(model, now)
    shift = jnp.zeros((members, model.dimensions), model.dtype)
    if all_fit(model, members):
        who = identity_slots(model)
        no = jnp.asarray(False)
        return ClusterMembers(Slots(who, ready[who], shift), jnp.full_like(now, jnp.inf), no)
    there = at_once(model, jnp.arange(count), state.flying, state.support, now)[0]
    core = _core(model, coupling)
    moves = model.inverse_mass[:count] > 0
    mass = jnp.where(moves, 1 / jnp.where(moves, model.inverse_mass[:count], 1), 0)
    kinetic = mass * jnp.sum(jnp.square(there.velocity), axis=-1) / 2
    if model.rotation is not None and there.turning is not None:
        kinetic = kinetic + model.rotation.energy(there.turning.spin)
    flying = jnp.sqrt(jnp.sum(jnp.square(there.velocity), axis=-1))
    pull = jnp.sqrt(jnp.sum(jnp.square(model.gravity)))
    more = jnp.where(moves, 2 * pull * coupling.pace, 0)
    if model.motion is not None:
        # A wall gives a body at most twice its own velocity.
        walls = model.motion.fastest(now, coupling.pace)
        more = more + jnp.where(moves, 2 * jnp.max(walls), 0)
    gain = jnp.zeros_like(flying)
    if model.shaking is not None:
        gain = gain.at[np.array(model.shaken)].set(model.shaking.strongest * coupling.pace)
    if model.driven:
        # So does a fixed sphere that moves.
        fast = jnp.where(moves, 0, flying + gain)
        more = jnp.where(moves, more + 2 * jnp.max(fast), gain)

    def fastest(who: Array, filled: Array) -> Array:
        """Return a bound on the speeds of the members."""
        sure = jnp.minimum(who, count - 1)
        seated = jnp.arange(members) < filled
        energy = jnp.sum(jnp.where(seated, kinetic[sure], 0)) + coupling.reserve
        fast = jnp.sqrt(2 * energy * model.inverse_mass[sure]) + more[sure]
        return jnp.where(seated, fast, 0)

    def arrivals(who: Array, after: Array, filled: Array) -> Array:
        """Return the earliest times at which others may be reached, or reach a non-core body."""
        sure = jnp.minimum(who, count - 1)
        seated = jnp.arange(members) < filled
        fast = fastest(who, filled)
        apart = (there.position[sure][:, None] - there.position[None]).reshape(-1, model.dimensions)
        apart = nearest_image(model, apart)[0].reshape(members, count, model.dimensions)
        length = jnp.sqrt(jnp.sum(jnp.square(apart), axis=-1))
        distance = model.radius[sure][:, None] + model.radius[None]
        gap = jnp.maximum(side(distance) * length - distance, 0)
        speed = fast[:, None] + (flying + more)[None]
        reached = after[:, None] + gap / jnp.where(speed > 0, speed, 1)
        rate = there.velocity[sure][:, None] - there.velocity[None]
        bent = model.has_gravity or model.shaken
        bend = (more[sure][:, None] + more[None]) if bent else jnp.zeros_like(gap)
        meeting = jnp.sqrt(jnp.sum(jnp.square(rate), axis=-1)) + bend
        closes = (side(distance) * jnp.sum(apart * rate, axis=-1) < 0) | (bend > 0)
        closes = closes & ~core[sure][:, None] & (meeting > 0)
        free = jnp.where(closes, gap / jnp.where(meeting > 0, meeting, 1), jnp.inf)
        # A fixed body transmits nothing.
        reached = jnp.where(moves[sure][:, None] & (speed > 0), reached, jnp.inf)
        times = jnp.minimum(reached, free)
        times = jnp.where(seated[:, None], times, jnp.inf)
        inside = jnp.zeros(count, bool).at[jnp.where(seated, who, count)].set(True, mode="drop")
        return jnp.where(inside | ~ready, jnp.inf, jnp.min(times, axis=0))

    def one_more(k: Array, carry: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        who, after, filled = carry
        times = arrivals(who, after, filled)
        nearest = jnp.argmin(times)
        joins = (times[nearest] <= coupling.pace) & (filled < members)
        place = jnp.where(joins, filled, members)
        who = who.at[place].set(nearest, mode="drop")
        after = after.at[place].set(times[nearest], mode="drop")
        return who, after, filled + joins.astype(filled.dtype)

    first = jnp.flatnonzero(core, size=members, fill_value=count)
    filled = jnp.minimum(jnp.sum(core), members)
    start = (first, jnp.zeros(members, model.dtype), filled)
    who, after, filled = jax.lax.fori_loop(0, members - 1, one_more, start)
    alone = jnp.min(arrivals(who, after, filled))
    crowded = (jnp.sum(core) > members) | (alone <= coupling.pace / _CALLS)
    seats, wide = _assign_slots(model, there, coupling, who, filled)
    if any(model.periodic):
        # Only the nearest image of a pair, at half a period or less, may touch. No other image
        # comes as near before two bodies have covered the rest of that half.
        half = jnp.min(jnp.where(jnp.asarray(model.periodic), model.period, jnp.inf)) / 2
        radius = model.radius[jnp.minimum(seats.who, count - 1)]
        room = half - 2 * jnp.max(jnp.where(seats.present, jnp.abs(radius), 0))
        speed = jnp.max(fastest(who, filled))
        alone = jnp.minimum(alone, room / 2 / jnp.where(speed > 0, speed, 1))
    return ClusterMembers(seats, alone, crowded | wide)


def _core(layout: SceneLayout, coupling: Coupling) -> Bool[Array, " N"]:
    """Return which spheres are in contact."""
    count, members = layout.spheres, coupling.seats.who.shape[0]
    first, second = bodies_of(layout, members, coupling.seats.who)
    closed = coupling.state.closed & ~coupling.starts
    core = jnp.zeros(count, bool)
    for body in (first, second):
        core = core.at[jnp.where(closed, body, count)].set(True, mode="drop")
    choice = coupling.choice
    for body in (choice.first, choice.second):
        core = core.at[jnp.where(coupling.touches, body, count)].set(True, mode="drop")
    return core


def _assign_slots(
    model: SceneArrays, there: Flying, coupling: Coupling, who: Int[Array, " M"], filled: Index
) -> tuple[Slots, Flag]:
    """Return the places of the members, in neighbouring images; in a line by their order. The flag
    is True if those in a line span more than half a period: the last might then meet the first.
    """
    count, members = model.spheres, who.shape[0]
    present = jnp.arange(members) < filled
    sure = jnp.minimum(who, count - 1)
    position = there.position[sure]
    shift = jnp.zeros_like(position)
    wide = jnp.asarray(False)
    if any(model.periodic):
        old = coupling.seats
        same = (who[:, None] == old.who[None]) & old.present[None] & present[:, None]
        stays = jnp.any(same, axis=1) & ~coupling.starts
        before = old.shift[jnp.argmax(same, axis=1)]
        # Next to a member that stays, or to the first one.
        anchor = jnp.argmax(stays)
        base = position[anchor] - jnp.where(stays[anchor], before[anchor], 0) * model.period
        near = nearest_image(model, position - base[None])[1]
        shift = jnp.where(stays[:, None], before, near)
    if in_line(model):
        place = (position - shift * model.period[None])[:, 0]
        if any(model.periodic):
            low = jnp.min(jnp.where(present, place, jnp.inf))
            high = jnp.max(jnp.where(present, place, -jnp.inf))
            reach = 2 * jnp.max(jnp.where(present, model.radius[sure], 0))
            wide = high - low + reach > model.period[0] / 2
        order = jnp.argsort(jnp.where(present, place, jnp.inf))
        who, present, shift = who[order], present[order], shift[order]
    return Slots(jnp.where(present, who, count), present, shift), wide
