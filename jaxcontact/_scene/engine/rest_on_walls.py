"""The change from a coupled solve with friction to the formulas of balls at rest on walls.

The spring of a contact has no damping, so a ball at rest swings about its mean motion for ever.
With the friction f, its mean f_m, the stiffness k and the mobility λ of the contact point,

    u' = λ (f - f_m)/m,   f' = -k u.   The means are v - u/λ and x + (f - f_m)/(k λ).

The formulas continue from them, so that nothing depends on the time at which the ball counts as at
rest. The energy of the swing counts as lost in the contact.
"""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from ..._coupled.rows import rows_of
from ..._coupled.springs import lengths
from ..arrays.arrays import SceneArrays
from ..arrays.flight import Flying
from ..arrays.movers import Turning, free_turning
from ..cluster.problem import ClusterEnd
from ..pair_impact.rolling import compliance_on, footing, on_walls
from .cluster_slots import Slots, masses, resting_pairs, slot_pairs


def rest_on_walls(
    model: SceneArrays, seats: Slots, done: ClusterEnd, support: Int[Array, " M"]
) -> tuple[ClusterEnd, Turning | None, Bool[Array, " M"]]:
    """Return the end of a call, the rotation of its members, and which of them slide along a curve,
    for which there is no formula. `support` are the walls on which they rest, -1 for others.
    """
    state, members = done.state, seats.who.shape[0]
    nobody = jnp.zeros(members, bool)
    if state.rubbing is None:
        return done, None, nobody
    turning = free_turning(state.rubbing.spin[:members], model.dimensions)
    if not (model.walls and model.has_gravity):
        return done, turning, nobody
    who = jnp.minimum(seats.who, model.spheres - 1)
    position = state.position[:members] + seats.shift * model.period[None]
    time = jnp.broadcast_to(state.time, (members,))
    rests, on = (support >= 0)[:, None], jnp.maximum(support, 0)
    before = Flying(position, state.velocity[:members], time, turning)
    foot = footing(model, who, on, before)
    # The residual approach ends, too.
    walls = rows_of(model.walls_at(state.time).velocity, on)
    closing = walls - jnp.sum(before.velocity * foot.normal, axis=1)
    sinks = before.velocity + jnp.where(rests, closing[:, None] * foot.normal, 0)
    before = before._replace(velocity=sinks)
    mass, mobility = masses(model, seats)[:, None], foot.mobility
    on_wall, first = resting_pairs(model, members, support), slot_pairs(model, members)[0]
    slides = jnp.zeros(members, bool).at[first].max(on_wall & (state.rubbing.slides == 1))
    springs = jnp.where(on_wall[:, None], state.rubbing.spring, 0)
    friction = jnp.zeros((members, model.dimensions), springs.dtype).at[first].add(springs)
    compliance = compliance_on(model, who, on, foot.height)
    slip = lengths(foot.slip)[:, None]
    # No swing is faster; a body that slides faster does not swing.
    pull = lengths(friction + mass * foot.slope / mobility)[:, None]
    mean = mobility * jnp.square(pull) * compliance >= mass * jnp.square(slip)
    swings = ~slides[:, None] | mean
    after, bent = on_walls(model, who, support, before, swings[:, 0])
    assert after.turning is not None
    # Of a swing that slips, the rest of the slip is added.
    drag = mass * after.turning.drag
    still_to_go = mass * slip / (2 * mobility * jnp.where(pull > 0, pull, 1)) * foot.slip
    shift = (friction - drag) * compliance + jnp.where(slides[:, None], still_to_go, 0)
    shift = jnp.where(swings, shift / mobility, 0)
    impulse = mass * (after.velocity - before.velocity)
    gained = jnp.sum(impulse * foot.slip / 2 + mobility * drag * shift, axis=1)

    def with_members(all: Array, members_of: Array) -> Array:
        return jnp.concatenate([members_of, all[members:]])

    rubbing, first = state.rubbing, slot_pairs(model, members)[0]
    state = state._replace(
        position=with_members(state.position, state.position[:members] + shift),
        velocity=with_members(state.velocity, after.velocity),
        rubbing=rubbing._replace(
            spin=with_members(rubbing.spin, after.turning.spin),
            taken=rubbing.taken
            - jnp.where(resting_pairs(model, members, support), gained[first], 0),
        ),
    )
    done = done._replace(
        state=state,
        # No wall lifts the bodies by the shift.
        work=done.work + jnp.sum(impulse * foot.drift + mass * foot.slope * shift),
        rubbed=None if done.rubbed is None else done.rubbed - jnp.sum(gained),
    )
    return done, after.turning, bent & seats.present
