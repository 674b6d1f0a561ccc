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
from ..arrays.arrays import Numbers, SceneLayout, known_contact_of, least_speed, nearest_image
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


def pace_of(layout: SceneLayout, numbers: Numbers, choice: Choice, closing: Number) -> Number:
    """Return about a third of an impact's duration: X/v with X = (μ v²/K)^(1/(n+1)), in s."""
    contact = known_contact_of(layout, numbers, choice.first, choice.second)
    return pace_of_contact(contact, jnp.maximum(closing, least_speed(numbers)))


def select_members(
    layout: SceneLayout, numbers: Numbers, members: int, state: RunState, now: Number
) -> ClusterMembers:
    """Return the members of the next call of the coupled solve."""
    coupling, count = state.coupling, layout.spheres
    assert coupling is not None
    ready = state.time <= now + simultaneous(numbers, now)
    shift = jnp.zeros((members, layout.dimensions), numbers.dtype)
    if all_fit(layout, members):
        who = identity_slots(layout, numbers)
        no = jnp.asarray(False)
        return ClusterMembers(Slots(who, ready[who], shift), jnp.full_like(now, jnp.inf), no)
    there = at_once(layout, numbers, jnp.arange(count), state.flying, state.support, now)[0]
    core = _core(layout, coupling)
    moves = numbers.inverse_mass[:count] > 0
    mass = jnp.where(moves, 1 / jnp.where(moves, numbers.inverse_mass[:count], 1), 0)
    kinetic = mass * jnp.sum(jnp.square(there.velocity), axis=-1) / 2
    if numbers.rotation is not None and there.turning is not None:
        kinetic = kinetic + numbers.rotation.energy(there.turning.spin)
    flying = jnp.sqrt(jnp.sum(jnp.square(there.velocity), axis=-1))
    pull = jnp.sqrt(jnp.sum(jnp.square(numbers.gravity)))
    more = jnp.where(moves, 2 * pull * coupling.pace, 0)
    if numbers.motion is not None:
        # A wall gives a body at most twice its own velocity.
        walls = numbers.motion.fastest(now, coupling.pace)
        more = more + jnp.where(moves, 2 * jnp.max(walls), 0)
    gain = jnp.zeros_like(flying)
    if numbers.shaking is not None:
        gain = gain.at[np.array(layout.shaken)].set(numbers.shaking.strongest * coupling.pace)
    if layout.driven:
        # So does a fixed sphere that moves.
        fast = jnp.where(moves, 0, flying + gain)
        more = jnp.where(moves, more + 2 * jnp.max(fast), gain)

    def fastest(who: Array, filled: Array) -> Array:
        """Return a bound on the speeds of the members."""
        sure = jnp.minimum(who, count - 1)
        seated = jnp.arange(members) < filled
        energy = jnp.sum(jnp.where(seated, kinetic[sure], 0)) + coupling.reserve
        fast = jnp.sqrt(2 * energy * numbers.inverse_mass[sure]) + more[sure]
        return jnp.where(seated, fast, 0)

    def arrivals(who: Array, after: Array, filled: Array) -> Array:
        """Return the earliest times at which others may be reached, or reach a non-core body."""
        sure = jnp.minimum(who, count - 1)
        seated = jnp.arange(members) < filled
        fast = fastest(who, filled)
        apart = (there.position[sure][:, None] - there.position[None]).reshape(
            -1, layout.dimensions
        )
        apart = nearest_image(layout, numbers, apart)[0].reshape(members, count, layout.dimensions)
        length = jnp.sqrt(jnp.sum(jnp.square(apart), axis=-1))
        distance = numbers.radius[sure][:, None] + numbers.radius[None]
        gap = jnp.maximum(side(distance) * length - distance, 0)
        speed = fast[:, None] + (flying + more)[None]
        reached = after[:, None] + gap / jnp.where(speed > 0, speed, 1)
        rate = there.velocity[sure][:, None] - there.velocity[None]
        bent = layout.gravity or layout.shaken
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
    start = (first, jnp.zeros(members, numbers.dtype), filled)
    who, after, filled = jax.lax.fori_loop(0, members - 1, one_more, start)
    alone = jnp.min(arrivals(who, after, filled))
    crowded = (jnp.sum(core) > members) | (alone <= coupling.pace / _CALLS)
    seats, wide = _assign_slots(layout, numbers, there, coupling, who, filled)
    if any(layout.periodic):
        # Only the nearest image of a pair, at half a period or less, may touch. No other image
        # comes as near before two bodies have covered the rest of that half.
        half = jnp.min(jnp.where(jnp.asarray(layout.periodic), numbers.period, jnp.inf)) / 2
        radius = numbers.radius[jnp.minimum(seats.who, count - 1)]
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
    layout: SceneLayout,
    numbers: Numbers,
    there: Flying,
    coupling: Coupling,
    who: Int[Array, " M"],
    filled: Index,
) -> tuple[Slots, Flag]:
    """Return the places of the members, in neighbouring images; in a line by their order. The flag
    is True if those in a line span more than half a period: the last might then meet the first.
    """
    count, members = layout.spheres, who.shape[0]
    present = jnp.arange(members) < filled
    sure = jnp.minimum(who, count - 1)
    position = there.position[sure]
    shift = jnp.zeros_like(position)
    wide = jnp.asarray(False)
    if any(layout.periodic):
        old = coupling.seats
        same = (who[:, None] == old.who[None]) & old.present[None] & present[:, None]
        stays = jnp.any(same, axis=1) & ~coupling.starts
        before = old.shift[jnp.argmax(same, axis=1)]
        # Next to a member that stays, or to the first one.
        anchor = jnp.argmax(stays)
        base = position[anchor] - jnp.where(stays[anchor], before[anchor], 0) * numbers.period
        near = nearest_image(layout, numbers, position - base[None])[1]
        shift = jnp.where(stays[:, None], before, near)
    if in_line(layout):
        place = (position - shift * numbers.period[None])[:, 0]
        if any(layout.periodic):
            low = jnp.min(jnp.where(present, place, jnp.inf))
            high = jnp.max(jnp.where(present, place, -jnp.inf))
            reach = 2 * jnp.max(jnp.where(present, numbers.radius[sure], 0))
            wide = high - low + reach > numbers.period[0] / 2
        order = jnp.argsort(jnp.where(present, place, jnp.inf))
        who, present, shift = who[order], present[order], shift[order]
    return Slots(jnp.where(present, who, count), present, shift), wide
