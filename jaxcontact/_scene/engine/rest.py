"""Balls at rest on walls: how they come to rest, and how they slide and roll by formulas.

On a wall with the unit normal n that moves at w along itself the contact point slides at
u = v - w - R ω × n. Gravity has the part g_n into the wall and g_t along it. A friction a = F/m on
the centre gives ω' = -R m/I n × a and u' = g_t + λ a with λ = 1 + m R²/I. A ball that slides has
a = -μ g_n u/|u|, one that rolls a = -g_t/λ, as long as |g_t| <= λ μ g_n. Without slope and without
spin it begins to roll after 2 v0/(7 μ g), at ω = 5 v0/(7 R). The formulas hold for sliding along a
straight line: on a level wall, in the plane, or down a slope. R is the height of the centre, which
a soft contact lowers. The spring of a soft contact, which slides with a_s and rolls with a_r, gives
way when sliding ends: the mean of the place moves by m (a_s - a_r)/(λ k).

That spring has no damping, so a ball that rests after a coupled solve swings about its mean motion
for ever. With the friction f, its mean f_m and the stiffness k,

    u' = λ (f - f_m)/m,   f' = -k u.   The means are v - u/λ and x + (f - f_m)/(k λ).

The formulas continue from them, so that nothing depends on the time at which the ball counts as at
rest. The energy of the swing counts as lost in the contact.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..._coupled.modes import Flag, Number
from ..._coupled.rows import rows_of
from ..._coupled.springs import lengths, tangential_stiffness
from ..._functions import cross, ratio, swept
from ..arrays.arrays import Flying, SceneArrays, SceneLayout, at_once, known_contact_of
from ..arrays.movers import Turning, free_turning
from ..bodies.overlap import NOISE
from ..cluster.problem import ClusterEnd
from ..pair_impact.friction import coefficient_of, ramps_of, spring_ratio_of, wall_drift
from ..pair_impact.instantaneous import Choice, ImpactOutcome
from .slots import masses, resting_pairs, slot_pairs
from .state import Slots

_ROUNDINGS = 64
"""The rounding errors of a speed below which a ball rolls."""


def comes_to_rest(model: SceneArrays, choice: Choice, before: Flying, tolerance: Number) -> Flag:
    """Return whether a ball comes to rest on a wall. If gravity presses it to a wall and e < 1 is
    constant, it bounces infinitely often in a finite time. Once the next bounce is lower than
    `tolerance` radii, that time is summed.
    """
    if not model.settles:
        return choice.tail
    who = jnp.stack([choice.first, choice.first])
    velocity = at_once(model, who, before, choice.support, choice.time)[0].velocity[0]
    wall = jnp.clip(choice.second - model.spheres, 0)
    face = rows_of(model.normal, wall)
    weight = -jnp.sum(face * model.gravity)
    driven = model.walls_at(choice.time, wall).velocity
    closing = jnp.maximum(driven - jnp.sum(face * velocity), 0)
    e = model.restitution[0]
    rests = (choice.second >= model.spheres) & (weight > 0)
    if model.law_table:
        law = model.chosen(model.law_table, choice.first, choice.second)
        e = rows_of(model.restitution, law)
        rests = rests & rows_of(jnp.asarray(model.constant), law)
    if any(model.vibrating):
        # On a shaking wall the bounces do not form a series.
        rests = rests & ~rows_of(jnp.asarray(model.vibrating), wall)
    if model.frictions is not None:
        rests = rests & ~begins_to_roll(model, choice)
    low = jnp.square(e * closing) <= 2 * weight * tolerance * rows_of(model.radius, choice.first)
    return rests & (e < 1) & low


def supports_after(
    model: SceneArrays, choice: Choice, outcome: ImpactOutcome
) -> tuple[Int[Array, "2"], Flag]:
    """Return the walls that support the two bodies after the impact, and whether one needs two."""
    support = choice.support
    if not (model.settles or model.start is not None):
        return support, jnp.asarray(False)
    velocity, on = outcome.after.velocity, jnp.maximum(support, 0)
    leaving = jnp.sum(velocity * rows_of(model.normal, on), axis=-1)
    if any(model.moving):
        leaving = leaving - rows_of(model.walls_at(outcome.time).velocity, on)
    leaving = jnp.abs(leaving)
    speed = jnp.sqrt(jnp.sum(jnp.square(velocity), axis=-1)) + outcome.closing
    kept = (support >= 0) & (leaving <= NOISE * jnp.finfo(model.dtype).eps * speed)
    support = jnp.where(kept, support, -1)
    wall = choice.second - model.spheres
    crowded = choice.tail & kept[0] & (support[0] != wall)
    first = jnp.where(choice.tail, wall, support[0])
    return jnp.stack([first, support[1]]), crowded


def begins_to_roll(layout: SceneLayout, choice: Choice) -> Flag:
    """Return whether an event is the end of sliding on the wall on which the first body rests."""
    on = choice.support[..., 0]
    return (on >= 0) & (choice.second - layout.spheres == on)


def or_roll(
    model: SceneArrays, before: Flying, choice: Choice, outcome: ImpactOutcome, soft: bool
) -> ImpactOutcome:
    """Return the outcome of an impact, or the end of sliding of the first body, which has no
    impulse.
    """
    turning = before.turning
    if turning is None:
        return outcome
    rolls = begins_to_roll(model, choice)
    until = jnp.where(rolls, turning.until[0], choice.time)
    who = jnp.stack([choice.first, choice.first])
    after = at_once(model, who, before, choice.support, until)[0]
    if soft and model.walls and model.has_gravity:
        way = give_way(model, who, choice.support, before)
        after = after._replace(position=after.position + way)
    nothing = jax.tree.map(jnp.zeros_like, outcome)
    event = nothing._replace(after=after, time=until)
    return jax.tree.map(lambda a, b: jnp.where(rolls, a, b), event, outcome)


def with_friction_at_rest(
    model: SceneArrays, choice: Choice, outcome: ImpactOutcome, support: Int[Array, "2"]
) -> tuple[ImpactOutcome, Flag]:
    """Return an event after which the bodies rub on the walls on which they rest, and whether no
    formula holds for that.
    """
    second = jnp.minimum(choice.second, model.spheres - 1)
    who = jnp.stack([choice.first, second])
    rolls = jnp.stack([begins_to_roll(model, choice), jnp.asarray(False)])
    after, bent = on_walls(model, who, support, outcome.after, rolls)
    # A wall has no row of its own.
    bent = bent & jnp.stack([jnp.asarray(True), choice.second < model.spheres])
    return outcome._replace(after=after), jnp.any(bent)


def flying_at_start(model: SceneArrays) -> Flying:
    """Return all spheres at time zero."""
    count, turning = model.spheres, None
    if model.rotation is not None:
        turning = free_turning(model.rotation.spin, model.dimensions)
    zero = jnp.zeros(count, model.dtype)
    flying = Flying(model.position, model.velocity, zero, turning)
    if turning is None or model.start is None:
        return flying
    rolls = jnp.zeros(count, bool)
    return on_walls(model, jnp.arange(count), model.start.support, flying, rolls)[0]


class Footing(NamedTuple):
    """Bodies on walls: the normal, the height of the centre, the part of gravity along the wall, R
    m/I, and λ (M, 1). `slip` and `drift` are the slip velocity and that of the wall along itself.
    `fast` times the rounding of 1 is that of the slip.
    """

    normal: Float[Array, "M D"]
    height: Float[Array, " M"]
    slope: Float[Array, "M D"]
    lever: Float[Array, "M 1"]
    mobility: Float[Array, "M 1"]
    slip: Float[Array, "M D"]
    drift: Float[Array, "M D"]
    fast: Float[Array, " M"]

    def twist(self, drag: Float[Array, "M D"]) -> Float[Array, "M S"]:
        """Return ω' of a friction F/m."""
        return -self.lever * cross(self.normal, drag)

    def slip_rate(self, drag: Float[Array, "M D"]) -> Float[Array, "M D"]:
        """Return u' of a friction F/m."""
        return self.slope + self.mobility * drag


def footing(model: SceneArrays, who: Int[Array, " M"], on: Int[Array, " M"], at: Flying) -> Footing:
    """Return bodies as they are `at` their own times on walls `on`."""
    assert at.turning is not None and model.rotation is not None
    normal, slope = rows_of(model.normal, on), rows_of(model.pull, on + 1)
    drift = jax.vmap(lambda wall, time, n: wall_drift(model, wall, time, n))(on, at.time, normal)
    turns = rows_of(model.rotation.inverse_inertia, who)
    inverse, spin = rows_of(model.inverse_mass, who), at.turning.spin
    offset = jax.vmap(lambda wall, time: model.walls_at(time, wall).offset)(on, at.time)
    height = jnp.sum(at.position * normal, axis=-1) - offset
    lever = height * turns / jnp.where(inverse > 0, inverse, 1)
    level = at.velocity - jnp.sum(at.velocity * normal, axis=-1, keepdims=True) * normal - drift
    turned = height[:, None] * swept(spin, normal)
    # Rounding of the height turns with the spin.
    far = jnp.sum(jnp.abs(at.position), axis=-1) + jnp.abs(offset)
    fast = jnp.sum(jnp.abs(level), axis=-1) + far * jnp.sum(jnp.abs(spin), axis=-1)
    mobility = 1 + height * lever
    return Footing(
        normal, height, slope, lever[:, None], mobility[:, None], level - turned, drift, fast
    )


def slips(foot: Footing) -> Bool[Array, " M"]:
    """Return which bodies slide, beyond rounding."""
    speed, _ = _length_and_direction(foot.slip)
    return speed > _ROUNDINGS * float(jnp.finfo(speed.dtype).eps) * foot.fast


def on_walls(
    model: SceneArrays,
    who: Int[Array, " M"],
    support: Int[Array, " M"],
    flying: Flying,
    rolls: Bool[Array, " M"],
) -> tuple[Flying, Bool[Array, " M"]]:
    """Return bodies with their friction at rest, and which of them slide along a curve. `rolls`
    marks bodies that do not slide, whatever slip is left.
    """
    assert flying.turning is not None
    turning = flying.turning
    if not (model.walls and model.has_gravity):
        still = jax.tree.map(jnp.zeros_like, turning)
        turning = still._replace(spin=turning.spin, until=jnp.full_like(turning.until, jnp.inf))
        return flying._replace(turning=turning), jnp.zeros(who.shape, bool)
    on = jnp.maximum(support, 0)
    foot = footing(model, who, on, flying)
    walls = model.spheres + on
    mu = jax.vmap(lambda i, wall: coefficient_of(model, i, wall))(who, walls)
    grip = mu * jnp.maximum(-jnp.sum(foot.normal * model.gravity[None], axis=-1), 0)
    speed, along = _length_and_direction(foot.slip)
    steep, down = _length_and_direction(foot.slope)
    eps = jnp.finfo(model.dtype).eps
    still, rests = rolls | ~slips(foot), support >= 0
    holds = steep <= foot.mobility[:, 0] * grip
    rolling = -foot.slope / foot.mobility
    sliding = -grip[:, None] * jnp.where(still[:, None], down, along)
    sticks = still & holds
    drag = jnp.where(sticks[:, None], rolling, sliding)
    # A slip that is left, or its tangent alone, is stopped by friction at once.
    stop = jnp.where((sticks & rests)[:, None], -foot.slip / foot.mobility, 0)
    change = jnp.sum(foot.slip_rate(drag) * along, axis=-1)
    stops = ~still & (change < 0)
    left = speed / jnp.where(stops, -change, 1)
    until = jnp.where(stops, flying.time + left, jnp.inf)
    aside = foot.slope - jnp.sum(foot.slope * along, axis=-1, keepdims=True) * along
    weight = jnp.sqrt(jnp.sum(jnp.square(model.gravity)))
    curves = jnp.max(jnp.abs(aside), axis=-1) > _ROUNDINGS * eps * weight

    def kept(value: Float[Array, "M ..."]) -> Float[Array, "M ..."]:
        return jnp.where(rests.reshape(-1, *(1,) * (value.ndim - 1)), value, 0)

    until = jnp.where(rests, until, jnp.inf)
    spin = turning.spin + foot.twist(stop)
    turning = Turning(spin, kept(drag), kept(foot.twist(drag)), until)
    after = flying._replace(velocity=flying.velocity + stop, turning=turning)
    return after, rests & ~still & curves & (grip > 0)


def compliance_on(
    model: SceneArrays, who: Int[Array, " M"], on: Int[Array, " M"], height: Float[Array, " M"]
) -> Float[Array, "M 1"]:
    """Return 1/k of the springs of bodies at rest on walls; 0 without a spring."""
    wall = model.spheres + on
    depth, ramp = rows_of(model.radius, who) - height, ramps_of(model, who, wall)
    contact = jax.vmap(lambda i, j: known_contact_of(model, i, j))(who, wall)
    kappa = jax.vmap(lambda i, j: spring_ratio_of(model, i, j))(who, wall)
    stiffness = tangential_stiffness(kappa, contact, depth)
    if ramp is not None:
        stiffness = jnp.where(ramp > 0, 0, stiffness)
    return ratio(1.0, stiffness)[:, None]


def give_way(
    model: SceneArrays, who: Int[Array, " M"], support: Int[Array, " M"], sliding: Flying
) -> Float[Array, "M D"]:
    """Return the ways of soft bodies whose springs are released at the end of sliding."""
    assert sliding.turning is not None
    on = jnp.maximum(support, 0)
    foot = footing(model, who, on, sliding)
    mass = ratio(1.0, rows_of(model.inverse_mass, who))[:, None]
    released = mass * (sliding.turning.drag + foot.slope / foot.mobility)
    way = released * compliance_on(model, who, on, foot.height) / foot.mobility
    return jnp.where((support >= 0)[:, None], way, 0)


def _length_and_direction(vectors: Float[Array, "M D"]) -> tuple[Array, Array]:
    """Return the lengths, and unit vectors; both are zero for vectors of zero length."""
    square = jnp.sum(jnp.square(vectors), axis=-1)
    none = square == 0
    length = jnp.where(none, 0, jnp.sqrt(jnp.where(none, 1, square)))
    return length, vectors / jnp.where(none, 1, length)[:, None]


def rest_on_walls(
    model: SceneArrays, slots: Slots, done: ClusterEnd, support: Int[Array, " M"]
) -> tuple[ClusterEnd, Turning | None, Bool[Array, " M"]]:
    """Return the end of a call, the rotation of its spheres, and which of them slide along a curve,
    for which there is no formula. `support` are the walls on which they rest, -1 for others.
    """
    state, size = done.state, slots.size
    nobody = jnp.zeros(size, bool)
    if state.rubbing is None:
        return done, None, nobody
    turning = free_turning(state.rubbing.spin[:size], model.dimensions)
    if not (model.walls and model.has_gravity):
        return done, turning, nobody
    who = jnp.minimum(slots.who, model.spheres - 1)
    position = state.position[:size] + slots.shift * model.period[None]
    time = jnp.broadcast_to(state.time, (size,))
    rests, on = (support >= 0)[:, None], jnp.maximum(support, 0)
    before = Flying(position, state.velocity[:size], time, turning)
    foot = footing(model, who, on, before)
    # The residual approach ends, too.
    walls = rows_of(model.walls_at(state.time).velocity, on)
    closing = walls - jnp.sum(before.velocity * foot.normal, axis=1)
    sinks = before.velocity + jnp.where(rests, closing[:, None] * foot.normal, 0)
    before = before._replace(velocity=sinks)
    mass, mobility = masses(model, slots)[:, None], foot.mobility
    on_wall, first = resting_pairs(model, support), slot_pairs(model, size)[0]
    slides = jnp.zeros(size, bool).at[first].max(on_wall & (state.rubbing.slides == 1))
    springs = jnp.where(on_wall[:, None], state.rubbing.spring, 0)
    friction = jnp.zeros((size, model.dimensions), springs.dtype).at[first].add(springs)
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

    def with_spheres(all: Array, spheres: Array) -> Array:
        return jnp.concatenate([spheres, all[size:]])

    rubbing, first = state.rubbing, slot_pairs(model, size)[0]
    state = state._replace(
        position=with_spheres(state.position, state.position[:size] + shift),
        velocity=with_spheres(state.velocity, after.velocity),
        rubbing=rubbing._replace(
            spin=with_spheres(rubbing.spin, after.turning.spin),
            taken=rubbing.taken - jnp.where(resting_pairs(model, support), gained[first], 0),
        ),
    )
    done = done._replace(
        state=state,
        # No wall lifts the bodies by the shift.
        work=done.work + jnp.sum(impulse * foot.drift + mass * foot.slope * shift),
        rubbed=None if done.rubbed is None else done.rubbed - jnp.sum(gained),
    )
    return done, after.turning, bent & slots.present
