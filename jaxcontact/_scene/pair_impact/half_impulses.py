"""Friction in an isolated impact with a duration, in two halves.

The impulse J of the friction law belongs to the normal of the touch. One part of it acts at the
touch and the rest at the separation, about the normal there. The motion between the two then has
about the mean sliding speed, which turns the normal.

Both parts act at the distance of touch, at which the arms add up to that of the centres. The
angular momentum is therefore kept to rounding. On a plane the normal stays, and only the impulse
matters.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp

from ..._coupled.scalars import Number
from ..._impact import Status
from ..arrays.arrays import Numbers, SceneLayout
from ..arrays.flight import Flying
from .friction import Arms, Lane, arms_of, coefficient_of, friction_impulse
from .instantaneous import Choice, ImpactOutcome, Meeting


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

    layout: SceneLayout
    numbers: Numbers
    choice: Choice
    arms: Arms
    slip: Lane
    normal: Lane
    carried: Lane
    impulse: Lane

    @classmethod
    def of(
        cls,
        layout: SceneLayout,
        numbers: Numbers,
        choice: Choice,
        meeting: Meeting,
        carried: Lane,
    ) -> HalfImpulses:
        """Return the first half, half of rigid Coulomb friction without a loss in the normal
        motion. `carried` is the velocity of the second body.
        """
        i, j = choice.first, choice.second
        arms, turning = arms_of(layout, numbers, i, j), meeting.flying.turning
        assert turning is not None
        slip = arms.slip(meeting.normal, meeting.flying.velocity[0] - carried, turning.spin)
        inverse = jnp.sum(arms.inverse_mass)
        most = 2 * coefficient_of(layout, numbers, i, j) * jnp.maximum(meeting.closing, 0)
        most = most / jnp.where(inverse > 0, inverse, 1)
        impulse = coulomb_impulse(arms, slip, most) / 2
        return cls(layout, numbers, choice, arms, slip, meeting.normal, carried, impulse)

    def at_touch(self, flying: Flying) -> Flying:
        """Return the bodies after the first half."""
        return _kicked(self.arms, flying, self.normal, self.impulse)

    def at_separation(self, outcome: ImpactOutcome, turned: Turned) -> ImpactOutcome:
        """Return the impact with the second half, and with the error of the frozen normal."""
        arms, after, choice = self.arms, outcome.after, self.choice
        assert after.turning is not None
        i, j, e = choice.first, choice.second, turned.normal_impulse - 1
        whole, sliding, converged = friction_impulse(
            self.layout, self.numbers, i, j, arms, self.slip, outcome.closing, e
        )
        rest = turned.of(whole - self.impulse)
        slip = arms.slip(turned.after, after.velocity[0] - self._second(after), after.turning.spin)
        lost = arms.lost(self.slip, self.impulse) + arms.lost(slip, rest)
        # The work on a fixed sphere already includes the first half.
        work = jnp.where(choice.second >= self.layout.spheres, self.impulse + rest, rest)
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
        is_wall = self.choice.second >= self.layout.spheres
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
