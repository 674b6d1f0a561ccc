"""An isolated impact of two bodies with finite duration, from touch to separation."""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..._coupled.rows import rows_of
from ..._coupled.scalars import Flag, Number
from ..._impact import Status
from ..arrays.arrays import Numbers, SceneLayout, known_contact_of, laws_of, least_speed
from ..arrays.flight import Flying, accelerations
from ..result import SolvedBy
from .half_impulses import HalfImpulses, Turned
from .instantaneous import (
    Choice,
    ImpactOutcome,
    Meeting,
    driven_work,
    meeting_of,
    second_velocity,
)
from .oblique import oblique

_HEAD_ON = 1e-8
"""The ratio of sliding to closing speed below which an impact counts as head-on."""

Lane = Float[Array, "..."]


def soft(
    layout: SceneLayout,
    numbers: Numbers,
    before: Flying,
    choice: Choice,
    rtol: Number,
    needed: Flag,
    by_formula: bool = False,
) -> ImpactOutcome:
    """Solve an impact with finite duration, exact for a central force; `oblique` does the solve.
    Friction acts in two halves, see `HalfImpulses`.

    The line of centres turns by ψ while the centre of mass moves on. Let n be the unit vector along
    the line and s that along the sliding velocity at touch. The bodies separate at distance d along
    R(ψ) n, with the velocity R(ψ) (-e' v_n n + v_s s). A moving wall is treated in its own frame.

    If it is not `needed`, as in some lanes of a batch, nothing is solved. `by_formula`: whether the
    radial problem is known to be unnecessary.
    """
    count = layout.spheres
    meeting = meeting_of(layout, numbers, before, choice)
    is_wall = choice.second >= count
    second = jnp.minimum(choice.second, count - 1)
    who = jnp.stack([choice.first, second])
    normal = meeting.normal
    pull = accelerations(layout, numbers, who, choice.support)
    closing = jnp.maximum(meeting.closing, least_speed(numbers))
    flying, steady, halves = _begun(layout, numbers, choice, meeting)
    relative = flying.velocity[0] - steady
    across = relative + meeting.closing * normal
    square = jnp.sum(jnp.square(across))
    # A head-on impact is the limit of oblique ones. Turn and sliding are proportional, and all else
    # is even in the sliding speed. The small sliding speed set here only yields that ratio.
    straight = square <= jnp.square(_HEAD_ON * closing)
    sideways = jnp.sqrt(jnp.where(straight, 1, square))
    sideways = jnp.where(straight, jax.lax.stop_gradient(_HEAD_ON * closing), sideways)
    distance = jnp.sum(rows_of(numbers.radius, who))
    contact = known_contact_of(layout, numbers, choice.first, choice.second)
    # A force that presses a body to a wall acts in the contact; its part along the wall does not.
    pressing = jnp.where(is_wall, -jnp.sum(normal * pull[0]), 0)
    pair = (
        contact,
        closing,
        sideways,
        jnp.where(is_wall, jnp.inf, distance),
        pressing * contact.mass,
    )
    # Each kind of law has its own solutions.
    free = layout.dimensions == 1 and not layout.gravity
    laws, kind = laws_of(layout, numbers, choice.first, choice.second)
    solves = [
        functools.partial(
            oblique, law, rtol=rtol, needed=needed & (kind == number), free=free,
            by_formula=by_formula,
        )
        for number, law in enumerate(laws)
    ]  # fmt: skip
    rebound = solves[0](*pair) if len(laws) == 1 else jax.lax.switch(kind, solves, *pair)
    separated = rebound.status == int(Status.SEPARATED)
    clean = jax.tree.map(lambda x: jnp.where(separated, x, jnp.zeros_like(x)), rebound)
    cosine, turning = jnp.cos(clean.turn), jnp.sin(clean.turn) / sideways
    along = cosine * normal + turning * across
    beside = cosine * across - turning * square * normal
    parting = clean.restitution * closing
    away = parting * along + beside
    passed = clean.elapsed
    inverse = rows_of(numbers.inverse_mass, jnp.stack([choice.first, choice.second]))
    share = inverse / jnp.sum(inverse)
    # The centre of mass falls freely, or rests if the second body is fixed or a wall.
    drift = share[1] * flying.velocity[0] + share[0] * steady
    fall = share[1] * pull[0] + share[0] * jnp.where(is_wall, 0, pull[1])
    moved_by = drift * passed + fall * jnp.square(passed) / 2
    centre = jnp.where(is_wall, 0, 1) * moved_by
    falls = drift + fall * passed
    image = choice.image * numbers.period
    middle = share[1] * flying.position[0] + share[0] * (flying.position[1] + image)
    first = middle + centre + share[0] * distance * along
    other = middle + centre - share[1] * distance * along - image
    fast = falls + share[0] * away
    slow = falls - share[1] * away
    # Gravity along a wall continues; its normal part acted in the contact.
    level = pull[0] - jnp.sum(pull[0] * normal) * normal
    on_wall = flying.position[0] + across * passed + level * jnp.square(passed) / 2
    off_wall = across + level * passed + parting * normal
    if any(layout.moving):
        # These results are in the frame of the wall, which continues at its velocity.
        on_wall, off_wall = on_wall + steady * passed, off_wall + steady
    position = jnp.stack([jnp.where(is_wall, on_wall, first), other])
    velocity = jnp.stack([jnp.where(is_wall, off_wall, fast), slow])
    until = meeting.time + passed
    impulse = contact.mass * (parting + closing + pressing * passed)
    after = Flying(position, velocity, jnp.broadcast_to(until, (2,)), flying.turning)
    outcome = ImpactOutcome(
        after=after,
        time=meeting.time,
        closing=closing,
        restitution=clean.delivered,
        duration=clean.duration,
        energy_loss=clean.energy_loss,
        max_force=clean.max_force,
        turn=jnp.where(straight, 0, clean.turn),
        error=clean.error_estimate,
        wall_work=impulse * meeting.driven
        + driven_work(layout, numbers, choice, meeting, velocity),
        solved_by=(int(SolvedBy.CLOSED_FORM) + rebound.solved_by).astype(closing.dtype),
        status=rebound.status.astype(closing.dtype),
    )
    if halves is None:
        return outcome
    squared = jnp.where(straight, 0, 1) / jnp.where(straight, 1, square)
    turned = Turned(
        *(normal, across, along, beside),
        per_square=squared,
        curvature=jnp.where(is_wall, 0, 1 / distance),
        elapsed=passed,
        normal_impulse=1 + clean.restitution + pressing * passed / closing,
        level=jnp.where(is_wall, jnp.sum(jnp.abs(level)), 0),
    )
    return halves.at_separation(outcome, turned)


def _begun(
    layout: SceneLayout, numbers: Numbers, choice: Choice, meeting: Meeting
) -> tuple[Flying, Lane, HalfImpulses | None]:
    """Return the bodies after the friction at touch, the velocity of the frame or of the second
    body, and the first half of the friction, None without friction.
    """
    flying, is_wall = meeting.flying, choice.second >= layout.spheres
    if flying.turning is None:
        steady = jnp.where(is_wall, meeting.driven * meeting.normal, flying.velocity[1])
        return flying, steady, None
    carried = second_velocity(layout, numbers, choice, meeting)
    halves = HalfImpulses.of(layout, numbers, choice, meeting, carried)
    flying = halves.at_touch(flying)
    return flying, jnp.where(is_wall, carried, flying.velocity[1]), halves
