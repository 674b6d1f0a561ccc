"""One call of the coupled solve of a scene: its first state from what flies and what is in contact,
its contacts, and its end. Within a derivative it begins at the time of its touch.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..._coupled.modes import TIME_IS_UP, Flag, Number
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
from ..cluster.solve import MOST_STEPS, cluster, cluster_at_touch, rates_at_start
from ..pair_impact.instantaneous import Choice, meeting_of, two_that_meet
from .coupled_friction import (
    fresh_rubbing,
    impulses,
    joined_rubbing,
    pair_friction,
)
from .log import (
    Call,
)
from .near_pairs import PairList
from .slots import (
    all_fit,
    bodies_of,
    in_line,
    map_pairs,
    pairs_of,
    rearrange,
    resting_pairs,
    slot_pairs,
)
from .state import Slots


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
    The time of the touch with which it begins is known. If a derivative is needed, that time is
    `derived` from the two bodies.
    """
    slots, change, size = decided.slots, decided.change, decided.slots.size
    who = jnp.minimum(slots.who, model.spheres - 1)
    inverse = jnp.where(slots.present, rows_of(model.inverse_mass, who), 0)
    inverse = jnp.concatenate([inverse, model.inverse_mass[model.spheres :]])
    pull = accelerations(model, who, jnp.full(size, -1))
    pull = jnp.where(slots.present[:, None], pull, 0)
    pull = jnp.concatenate([pull, jnp.zeros((model.walls, model.dimensions), model.dtype)])
    followed, before = PairList(model, size, decided.near), rearrange(before, change)
    assert decided.choice is not None
    meet = decided.closed & change.fresh & meets(model, slots, decided.choice)
    joins, touch = jnp.any(meet) & ~decided.starts, decided.choice.time
    if derived:
        touch = _touch(model, spheres, decided, decided.starts | joins)

    def begun(before: ClusterState) -> tuple:
        """Return the first state, all pairs, the problem, and a function that completes its end."""
        # The time of the touch that starts it, or of the end of the last call.
        time = jnp.where(decided.starts, touch, before.time)
        flown = model, spheres, support, held, time
        begin, pairs = _first_state(*flown, before, decided, v0, derived)
        rests = resting_pairs(model, support)
        touches = decided.closed & (decided.starts | change.fresh) & ~rests
        one, other, rests, touches = followed.columns((*bodies_of(model, slots), rests, touches))
        some, start = followed.pairs(pairs), map_pairs(followed.columns, begin)
        # Unused slots get the numbers of a used pair.
        used_pair = jnp.argmax(some.used)
        one, other = (jnp.where(some.used, body, rows_of(body, used_pair)) for body in (one, other))
        contact = jax.vmap(lambda i, j: known_contact_of(model, i, j))(one, other)
        law = jax.vmap(lambda i, j: law_of(model, i, j))(one, other)
        drive = _drive(model, slots, time)
        setting, moved_by = (model, (one, other), some), (inverse, pull, drive)
        limits = rests, decided.until, decided.to_the_end
        start, until, impulsive, completed = impulses(setting, contact, moved_by, start, limits)
        friction = pair_friction(setting, slots, touches & some.used, impulsive)
        rest = rtol, drive, decided.to_the_end, friction
        problem = ClusterProblem(law, contact, some, inverse, pull, start, until, *rest)
        return begin, pairs, problem, completed

    begin, pairs, problem, completed = begun(before)
    form: dict[str, Any] = {"v0": v0, "in_line": in_line(model)}
    late, spent = jnp.zeros((), model.dtype), None
    if derived and not all_fit(model, size):
        # The last call ended at the touch with which this one begins, but at a fixed time.
        late = jnp.where(joins, touch - before.time, 0)
        late = late - jax.lax.stop_gradient(late)
        found = rates_at_start(problem, **form)
        rates, *spent = jax.tree.map(lambda x: jnp.where(joins, x, jnp.zeros_like(x)), found)
        rates = followed.put(rates, jax.tree.map(jnp.zeros_like, before))
        before = jax.tree.map(lambda x, v: x if x.dtype == bool else x + late * v, before, rates)
        begin, pairs, problem, completed = begun(before)
    end, until = cluster(problem, **form, until_change=True, max_steps=max_steps), problem.until
    if spent is not None:
        both = jax.tree.map(lambda x, v: x + late * v, [end.work, end.rubbed], spent)
        end = end._replace(work=both[0], rubbed=both[1])
    # The exact time, so that no further call is needed; without a step that of the beginning.
    over = jnp.where((end.status == TIME_IS_UP) & (until > begin.time), until, end.state.time)
    end = completed(end._replace(state=end.state._replace(time=over)))
    return begin, end._replace(state=followed.whole(end.state, begin, pairs))


def _first_state(
    model: SceneArrays,
    spheres: Flying,
    support: Int[Array, " M"],
    held: Float[Array, " M"],
    time: Number,
    before: ClusterState,
    decided: Call,
    v0: Any,
    derived: bool,
) -> tuple[ClusterState, ClusterPairs]:
    """Return the state at the beginning of a call, and all pairs. New bodies come from their flight
    formulas, and their pairs are fresh.
    """
    slots, change, size = decided.slots, decided.change, decided.slots.size
    first, second = slot_pairs(model, size)

    def in_flight(time: Number) -> tuple[Flying, Array, Array]:
        who = jnp.minimum(slots.who, model.spheres - 1)
        there = at_once(model, who, spheres, support, time)[0]
        return there, *slot_states(model, slots, there, time)

    def opening(time: Number) -> Array:
        _, position, velocity = in_flight(time)
        return pairs.gaps(pairs.between(position), velocity[first] - velocity[second])[1]

    there, position, velocity = in_flight(time)
    joined = jnp.concatenate([change.joined, jnp.zeros(model.walls, bool)])
    came, fresh = (joined | decided.starts)[:, None], decided.starts | change.fresh
    position = jnp.where(came, position, before.position)
    velocity = jnp.where(came, velocity, before.velocity)
    pairs = _nearest_images(model, pairs_of(model, slots), position)
    drift = jax.jvp(opening, (time,), (jnp.ones_like(time),))[1] if derived else 0.0
    touches, rests = decided.closed & fresh, resting_pairs(model, support)
    start = cluster_at_touch(pairs, position, velocity, touches, v0=v0, drift=drift)
    height = jnp.sum(there.position[first] * pairs.normal, axis=-1)
    place = jnp.concatenate([jnp.zeros(size, model.dtype), model.walls_at(time).offset])
    since = start.since + time
    start = start._replace(
        time=time,
        rubbing=fresh_rubbing(model, slots, there, support, rests),
        indentation=jnp.where(rests, pairs.distance - height + place[second], start.indentation),
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
    return begin, pairs


def _touch(model: SceneArrays, spheres: Flying, decided: Call, begins: Flag) -> Number:
    """Return the time of the touch with which a call `begins`."""
    slots, choice = decided.slots, decided.choice
    assert choice is not None
    first = jnp.argmax(slots.who == choice.first)
    # A wall has no slot. The first body replaces it, as another body may be ahead in time.
    second = jnp.argmax(slots.who == choice.second)
    two = jnp.stack([first, jnp.where(choice.second < model.spheres, second, first)])
    nobody = two_that_meet(model, choice.time)
    struck = jax.tree.map(lambda x, y: jnp.where(begins, x[two], y), spheres, nobody)
    met = choice._replace(second=jnp.where(begins, choice.second, choice.first))
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
