"""An instantaneous impact: the states of two bodies after it from those before it. It is written
for differentiation. The touch time is known, and corrected by Newton steps that are zero in value
and carry the derivatives of the root. States, normal and time therefore vary together.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ..._coupled.modes import Flag, Index, Number
from ..._coupled.rows import rows_of
from ..._functions import spin_axes
from ..._impact import Status
from ..arrays.arrays import Flying, SceneArrays, SceneLayout, at_once, restitution_of
from ..arrays.movers import free_turning
from ..bodies.bodies import side
from ..result import SolvedBy
from .friction import SlipSpeeds, arms_of, friction_impulse, wall_drift

Lane = Float[Array, "..."]


class Choice(NamedTuple):
    """The discrete choices about an impact, made before it is computed; they have no derivative.

    `first` and `second` are the bodies, walls from N on. `support` (2,) is the wall on which each
    one rests, or -1. `image` is the number of periods between the two along each axis, and `time`
    that of the touch in s. `tail`: whether the series of following bounces is summed.
    """

    first: Index
    second: Index
    support: Int[Array, "2"]
    image: Float[Array, " D"]
    time: Number
    tail: Flag


class ImpactOutcome(NamedTuple):
    """The outcome of an impact: the two bodies after it, each at its own time, and its numbers.
    `wall_work` in J is the work of a moving wall or fixed sphere on the body. `solved_by` and
    `status` (a `Status`) are whole numbers. `sliding` is None without friction.
    """

    after: Flying
    time: Lane
    closing: Lane
    restitution: Lane
    duration: Lane
    energy_loss: Lane
    max_force: Lane
    turn: Lane
    error: Lane
    wall_work: Lane
    solved_by: Lane
    status: Lane
    sliding: SlipSpeeds | None = None


def two_that_meet(layout: SceneLayout, time: Lane) -> Flying:
    """Return two approaching bodies, with finite derivatives, for rows without an impact."""
    ones = jnp.ones((1, layout.dimensions), time.dtype)
    away = jnp.concatenate([ones, -ones])
    turning = None
    if layout.frictions is not None:
        spin = jnp.zeros((2, spin_axes(layout.dimensions)), time.dtype)
        turning = free_turning(spin, layout.dimensions)
    return Flying(away, -away, jnp.stack([time, time]), turning)


class Meeting(NamedTuple):
    """Two bodies at their touch. `flying` holds their states, and `normal` is the unit vector from
    the second to the first. `closing` is the closing speed, and `driven` the velocity of a wall
    along its normal.
    """

    flying: Flying
    normal: Lane
    closing: Lane
    time: Lane
    driven: Lane


def _delay(relative: Callable[[Lane], tuple[Lane, Lane]], distance: Lane) -> Lane:
    """Return the correction of a known touch time: zero, with the derivatives of the root.

    `relative` returns the distance vector and its rate after a delay. Newton steps from a root move
    it only by rounding. Two of them carry the first three derivatives of the root. A custom rule
    would be lost where JAX splits a scan for second derivatives. A touch that does not close has no
    derivative in time.
    """
    delay = jnp.zeros_like(distance)
    for _ in range(2):
        away, rate = relative(delay)
        length = side(distance) * jnp.sqrt(jnp.sum(jnp.square(away)))
        slope = jnp.sum(away * rate) / length
        slope = jnp.where(slope < 0, slope, -jnp.inf)
        delay = delay - (length - distance) / slope
    return delay


def meeting_of(model: SceneArrays, before: Flying, choice: Choice) -> Meeting:
    """Return the touch of two bodies, with the derivatives of its time and normal."""
    count = model.spheres
    second = jnp.minimum(choice.second, count - 1)
    who = jnp.stack([choice.first, second])
    if model.shaken:
        # Without an impact both bodies are the same one, which must not be written twice.
        nobody = choice.first == choice.second
        who = jnp.where(nobody, model.fixed.index(False), who)
    there, pull = at_once(model, who, before, choice.support, choice.time)
    apart = there.position[0] - there.position[1] - choice.image * model.period
    rate = there.velocity[0] - there.velocity[1]
    half = (pull[0] - pull[1]) / 2
    radius = rows_of(model.radius, choice.first)
    distance = radius + rows_of(model.radius, second)
    is_wall = choice.second >= count
    driven = jnp.zeros_like(distance)
    if model.walls:
        wall = jnp.clip(choice.second - count, 0)
        face = rows_of(model.normal, wall)
        height = jnp.sum(face * there.position[0])
        rise, bend = jnp.sum(face * there.velocity[0]), jnp.sum(face * pull[0])
        distance = jnp.where(is_wall, radius, distance)

    def relative(delay: Lane) -> tuple[Lane, Lane]:
        away, rates = apart + (rate + half * delay) * delay, rate + 2 * half * delay
        if model.shaken:
            bent, turned = model.bent_at(who[1], choice.time, delay)
            away, rates = away - bent, rates - turned
        if model.walls:
            # A wall is met at its point below the body along the normal.
            moving = model.walls_at(choice.time + delay, wall)
            above = height + (rise + bend / 2 * delay) * delay - moving.offset
            away = jnp.where(is_wall, face * above, away)
            rates = jnp.where(is_wall, face * (rise + bend * delay - moving.velocity), rates)
        return away, rates

    delay = _delay(relative, distance)
    away, rates = relative(delay)
    normal = side(distance) * away / jnp.sqrt(jnp.sum(jnp.square(away)))
    closing = -jnp.sum(normal * rates)
    time = choice.time + delay
    # Rounding must not put a touch before the events that led to it.
    late = jnp.max(before.time) - time
    time = time + jax.lax.stop_gradient(jnp.maximum(late, 0))
    if any(model.moving):
        driven = jnp.where(is_wall, model.walls_at(time, wall).velocity, 0)
    met = at_once(model, who, there, choice.support, time)[0]
    return Meeting(met, normal, closing, time, driven)


def hit(model: SceneArrays, before: Flying, choice: Choice) -> ImpactOutcome:
    """Return an instantaneous impact with the law's e at its closing speed, along the normal.

    v1 += (1+e) μ u/m1 n, v2 -= (1+e) μ u/m2 n. Here u > 0 is the closing speed, μ = m1 m2/(m1+m2),
    and n the unit normal from the second body to the first. The energy loss is ½ μ u² (1-e²). A
    wall that moves at w along its normal does the work (1+e) μ u w.
    """
    meeting = meeting_of(model, before, choice)
    closing = jnp.maximum(meeting.closing, 0)
    e = restitution_of(model, choice.first, choice.second, closing)
    lowered = jnp.where(choice.tail, 0, e)
    inverse = rows_of(model.inverse_mass, jnp.stack([choice.first, choice.second]))
    mass = 1 / jnp.sum(inverse)
    impulse = (1 + lowered) * mass * closing
    push = impulse * meeting.normal
    sign = jnp.asarray([1.0, -1.0], model.dtype)
    velocity = meeting.flying.velocity + (sign * inverse)[:, None] * push[None]
    way = jnp.where(choice.tail, int(SolvedBy.SERIES), int(SolvedBy.INSTANTANEOUS))
    outcome = ImpactOutcome(
        after=meeting.flying._replace(velocity=velocity),
        time=meeting.time,
        closing=closing,
        restitution=lowered,
        duration=_tail(model, choice, e, closing),
        energy_loss=mass * jnp.square(closing) / 2 * (1 - lowered) * (1 + lowered),
        max_force=jnp.full_like(closing, jnp.inf),
        turn=jnp.zeros_like(closing),
        error=jnp.zeros_like(closing),
        wall_work=impulse * meeting.driven + driven_work(model, choice, meeting, velocity),
        solved_by=way.astype(closing.dtype),
        status=jnp.zeros_like(closing),
    )
    if meeting.flying.turning is None:
        return outcome
    return _with_friction(model, choice, meeting, outcome)


def _with_friction(
    model: SceneArrays, choice: Choice, meeting: Meeting, outcome: ImpactOutcome
) -> ImpactOutcome:
    """Return an instantaneous impact with the impulse of friction added."""
    after, turning, normal = outcome.after, meeting.flying.turning, meeting.normal
    assert turning is not None
    arms = arms_of(model, choice.first, choice.second)
    carried = second_velocity(model, choice, meeting)
    slip = arms.slip(normal, meeting.flying.velocity[0] - carried, turning.spin)
    numbers_of_it = outcome.closing, outcome.restitution
    impulse, sliding, converged = friction_impulse(
        model, choice.first, choice.second, arms, slip, *numbers_of_it
    )
    moved, turned = arms.kick(normal, impulse)
    driven = jnp.where(arms.inverse_mass[1] > 0, 0, jnp.sum(impulse * carried))
    status = jnp.where(converged, int(Status.SEPARATED), int(Status.NOT_CONVERGED))
    return outcome._replace(
        after=after._replace(
            velocity=after.velocity + moved,
            turning=turning._replace(spin=turning.spin + turned),
        ),
        energy_loss=outcome.energy_loss + arms.lost(slip, impulse),
        wall_work=outcome.wall_work + driven,
        sliding=sliding,
        status=status.astype(outcome.status.dtype),
    )


def second_velocity(model: SceneArrays, choice: Choice, meeting: Meeting) -> Lane:
    """Return the velocity (D,) of the second body, sphere or wall, at the touch."""
    if not model.walls:
        return meeting.flying.velocity[1]
    wall = jnp.clip(choice.second - model.spheres, 0)
    drift = wall_drift(model, wall, meeting.time, meeting.normal)
    moving = meeting.driven * meeting.normal + drift
    return jnp.where(choice.second >= model.spheres, moving, meeting.flying.velocity[1])


def driven_work(model: SceneArrays, choice: Choice, meeting: Meeting, after: Lane) -> Lane:
    """Return the work m (v' - v)·V of a fixed sphere that moves at V, in J."""
    if not model.driven:
        return jnp.zeros_like(meeting.closing)
    second = jnp.minimum(choice.second, model.spheres - 1)
    drives = (choice.second < model.spheres) & (model.inverse_mass[second] == 0)
    gained = (after[0] - meeting.flying.velocity[0]) / model.inverse_mass[choice.first]
    return jnp.where(drives, jnp.sum(gained * meeting.flying.velocity[1]), 0)


def _tail(model: SceneArrays, choice: Choice, e: Lane, closing: Lane) -> Lane:
    """Return the duration of the summed bounces, 2 e u/(g (1-e)); 0 without such a series."""
    if not model.settles:
        return jnp.zeros_like(closing)
    face = rows_of(model.normal, jnp.clip(choice.second - model.spheres, 0))
    weight = -jnp.sum(face * model.gravity)
    summed = choice.tail & (weight > 0) & (e < 1)
    series = 2 * e * closing / jnp.where(summed, weight * (1 - e), 1)
    return jnp.where(summed, series, 0)
