"""An isolated impact of two bodies with finite duration, from touch to separation, with friction in
two halves.

The impulse J of the friction law belongs to the normal of the touch. One part of it acts at the
touch and the rest at the separation, about the normal there. The motion between the two then has
about the mean sliding speed, which turns the normal.

Both parts act at the distance of touch, at which the arms add up to that of the centres. The
angular momentum is therefore kept to rounding. On a plane the normal stays, and only the impulse
matters.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp

from ..._coupled.modes import Flag, Number
from ..._coupled.rows import rows_of
from ..._impact import Status
from ..arrays.arrays import (
    Flying,
    SceneArrays,
    accelerations,
    known_contact_of,
    laws_of,
    least_speed,
)
from .friction import Arms, Lane, arms_of, coefficient_of, friction_impulse
from .instantaneous import Choice, ImpactOutcome, Meeting, driven_work, meeting_of, second_velocity
from .oblique import oblique


class Turned(NamedTuple):
    """The turn of an impact from touch to separation.

    The `normal` becomes `after`, and the sliding velocity `across` (D,) becomes `beside`.
    `per_square` is 1/across², 0 in a head-on impact. `curvature` is 1/(R1+R2), 0 on a plane.
    `elapsed` is the duration in s. `normal_impulse` is in units of m v0. `level` in m/s² is the
    acceleration along a wall.
    """

    normal: Lane
    across: Lane
    after: Lane
    beside: Lane
    per_square: Number
    curvature: Number
    elapsed: Number
    normal_impulse: Number
    level: Number

    def of(self, vector: Lane) -> Lane:
        """Return a vector across the normal, turned with it."""
        share = jnp.sum(vector * self.across) * self.per_square
        return vector + share * (self.beside - self.across)


def coulomb_impulse(arms: Arms, slip: Lane, most: Number) -> Lane:
    """Return the impulse (D,) that stops a slip, or the part of it up to `most` in N s."""
    square = jnp.sum(jnp.square(slip))
    size = jnp.sqrt(jnp.where(square > 0, square, 1))
    sticks = 1 / jnp.where(arms.tangential > 0, arms.tangential, 1)
    return -jnp.where(square > 0, jnp.minimum(most / size, sticks), 0) * slip


class HalfImpulses(NamedTuple):
    """The first part of the friction of an impact, and what the second one needs."""

    model: SceneArrays
    choice: Choice
    arms: Arms
    slip: Lane
    normal: Lane
    carried: Lane
    impulse: Lane

    @classmethod
    def of(
        cls, model: SceneArrays, choice: Choice, meeting: Meeting, carried: Lane
    ) -> HalfImpulses:
        """Return the first half, half of rigid Coulomb friction without a loss in the normal
        motion. `carried` is the velocity of the second body.
        """
        i, j = choice.first, choice.second
        arms, turning = arms_of(model, i, j), meeting.flying.turning
        assert turning is not None
        slip = arms.slip(meeting.normal, meeting.flying.velocity[0] - carried, turning.spin)
        inverse = jnp.sum(arms.inverse_mass)
        most = 2 * coefficient_of(model, i, j) * jnp.maximum(meeting.closing, 0)
        most = most / jnp.where(inverse > 0, inverse, 1)
        impulse = coulomb_impulse(arms, slip, most) / 2
        return cls(model, choice, arms, slip, meeting.normal, carried, impulse)

    def at_touch(self, flying: Flying) -> Flying:
        """Return the bodies after the first half."""
        return _kicked(self.arms, flying, self.normal, self.impulse)

    def at_separation(self, outcome: ImpactOutcome, turned: Turned) -> ImpactOutcome:
        """Return the impact with the second half, and with the error of the frozen normal."""
        arms, after, choice = self.arms, outcome.after, self.choice
        assert after.turning is not None
        i, j, e = choice.first, choice.second, turned.normal_impulse - 1
        whole, sliding, converged = friction_impulse(
            self.model, i, j, arms, self.slip, outcome.closing, e
        )
        rest = turned.of(whole - self.impulse)
        slip = arms.slip(turned.after, after.velocity[0] - self._second(after), after.turning.spin)
        lost = arms.lost(self.slip, self.impulse) + arms.lost(slip, rest)
        # The work on a fixed sphere already includes the first half.
        work = jnp.where(choice.second >= self.model.spheres, self.impulse + rest, rest)
        driven = jnp.where(arms.inverse_mass[1] > 0, 0, jnp.sum(work * self.carried))
        bad = (outcome.status == int(Status.SEPARATED)) & ~converged
        return outcome._replace(
            after=_kicked(arms, after, turned.after, rest),
            energy_loss=outcome.energy_loss + lost,
            wall_work=outcome.wall_work + driven,
            error=outcome.error + jax.lax.stop_gradient(self._doubt(outcome, turned, whole)),
            sliding=sliding,
            status=jnp.where(bad, int(Status.INVALID_INPUT), outcome.status),
        )

    def _second(self, after: Flying) -> Lane:
        """Return the velocity of the second body at the separation."""
        is_wall = self.choice.second >= self.model.spheres
        return jnp.where(is_wall, self.carried, after.velocity[1])

    def _doubt(self, outcome: ImpactOutcome, turned: Turned, whole: Lane) -> Number:
        """Return the error of the frozen normal relative to the closing speed. It is the speed,
        times the angle by which friction changes the turn, and the sliding speed that gravity adds
        along a wall.
        """
        inverse = jnp.sum(self.arms.inverse_mass)
        changed = jnp.sqrt(jnp.sum(jnp.square(whole))) * inverse
        angle = changed * turned.elapsed * jnp.abs(turned.curvature)
        speed = jnp.hypot(outcome.closing, jnp.sqrt(jnp.sum(jnp.square(turned.across))))
        return (angle * speed + turned.level * turned.elapsed) / outcome.closing


def _kicked(arms: Arms, flying: Flying, normal: Lane, impulse: Lane) -> Flying:
    """Return two bodies after an impulse (D,) on the first, at the contact point."""
    assert flying.turning is not None
    moved, turned = arms.kick(normal, impulse)
    turning = flying.turning._replace(spin=flying.turning.spin + turned)
    return flying._replace(velocity=flying.velocity + moved, turning=turning)


_HEAD_ON = 1e-8
"""The ratio of sliding to closing speed below which an impact counts as head-on."""


def soft(
    model: SceneArrays,
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
    count = model.spheres
    meeting = meeting_of(model, before, choice)
    is_wall = choice.second >= count
    second = jnp.minimum(choice.second, count - 1)
    who = jnp.stack([choice.first, second])
    normal = meeting.normal
    pull = accelerations(model, who, choice.support)
    closing = jnp.maximum(meeting.closing, least_speed(model))
    flying, steady, halves = _begun(model, choice, meeting)
    relative = flying.velocity[0] - steady
    across = relative + meeting.closing * normal
    square = jnp.sum(jnp.square(across))
    # A head-on impact is the limit of oblique ones. Turn and sliding are proportional, and all else
    # is even in the sliding speed. The small sliding speed set here only yields that ratio.
    straight = square <= jnp.square(_HEAD_ON * closing)
    sideways = jnp.sqrt(jnp.where(straight, 1, square))
    sideways = jnp.where(straight, jax.lax.stop_gradient(_HEAD_ON * closing), sideways)
    distance = jnp.sum(rows_of(model.radius, who))
    contact = known_contact_of(model, choice.first, choice.second)
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
    free = model.dimensions == 1 and not model.has_gravity
    laws, kind = laws_of(model, choice.first, choice.second)
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
    inverse = rows_of(model.inverse_mass, jnp.stack([choice.first, choice.second]))
    share = inverse / jnp.sum(inverse)
    # The centre of mass falls freely, or rests if the second body is fixed or a wall.
    drift = share[1] * flying.velocity[0] + share[0] * steady
    fall = share[1] * pull[0] + share[0] * jnp.where(is_wall, 0, pull[1])
    moved_by = drift * passed + fall * jnp.square(passed) / 2
    centre = jnp.where(is_wall, 0, 1) * moved_by
    falls = drift + fall * passed
    image = choice.image * model.period
    middle = share[1] * flying.position[0] + share[0] * (flying.position[1] + image)
    first = middle + centre + share[0] * distance * along
    other = middle + centre - share[1] * distance * along - image
    fast = falls + share[0] * away
    slow = falls - share[1] * away
    # Gravity along a wall continues; its normal part acted in the contact.
    level = pull[0] - jnp.sum(pull[0] * normal) * normal
    on_wall = flying.position[0] + across * passed + level * jnp.square(passed) / 2
    off_wall = across + level * passed + parting * normal
    if any(model.moving):
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
        wall_work=impulse * meeting.driven + driven_work(model, choice, meeting, velocity),
        solved_by=rebound.solved_by.astype(closing.dtype),
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
    model: SceneArrays, choice: Choice, meeting: Meeting
) -> tuple[Flying, Lane, HalfImpulses | None]:
    """Return the bodies after the friction at touch, the velocity of the frame or of the second
    body, and the first half of the friction, None without friction.
    """
    flying, is_wall = meeting.flying, choice.second >= model.spheres
    if flying.turning is None:
        steady = jnp.where(is_wall, meeting.driven * meeting.normal, flying.velocity[1])
        return flying, steady, None
    carried = second_velocity(model, choice, meeting)
    halves = HalfImpulses.of(model, choice, meeting, carried)
    flying = halves.at_touch(flying)
    return flying, jnp.where(is_wall, carried, flying.velocity[1]), halves
