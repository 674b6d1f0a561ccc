"""The prescribed motions of all bodies: walls along their normals, others in space. The rotation of
bodies, and the numbers that only friction needs.

A spin is one number in two dimensions, (1,), and a vector in three, (3,). With the unit normal n
from the second body to the first and the radii R1 and R2 (negative for a shell) the contact point
slides at u = v1 - v2 - (R1 ω1 + R2 ω2) × n. R1 + R2 is the distance of the centres at touch, so
that an impulse J at the contact point keeps the angular momentum: Δω_i = -R_i n × J / I_i.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..._coupled.modes import Number
from ..._functions import ratio
from ..bodies.motion import UserMotion

Lane = Float[Array, "..."]

CHECKED = 4096
"""The number of intervals of a run at whose ends the acceleration bound is checked."""

_ROUNDINGS = 64


class Movers(eqx.Module):
    """The prescribed motions V t + A (sin(ω t + φ) - sin φ) of W bodies; 0 for those at rest.

    `own` adds users' functions. V and A are numbers along the normals of walls, (W,), or vectors
    for spheres and shells, (W, D). ω and φ are (W,). Times are numbers, or arrays whose last axis
    is that of the bodies.
    """

    speed: Float[Array, "..."]
    amplitude: Float[Array, "..."]
    rate: Float[Array, "..."]
    phase: Float[Array, "..."]
    own: tuple[UserMotion | None, ...]

    def in_rows(self) -> Movers:
        """Return the motions with a leading axis for the bodies that meet them."""
        rows = (self.speed[None], self.amplitude[None], self.rate[None], self.phase[None])
        return Movers(*rows, self.own)

    @property
    def _in_space(self) -> bool:
        return self.amplitude.ndim > self.rate.ndim

    def _per_axis(self, lane: Lane) -> Lane:
        """Return a number for every body in a shape that multiplies its vector, if it has one."""
        return lane[..., None] if self._in_space else lane

    def _size(self, lane: Lane) -> Lane:
        """Return the lengths of vectors, or the magnitudes of numbers."""
        return jnp.sqrt(jnp.sum(jnp.square(lane), axis=-1)) if self._in_space else jnp.abs(lane)

    def _with_own(self, lane: Lane, time: Lane, of: Callable[[UserMotion, Array], Array]) -> Lane:
        """Return a quantity with the contribution of the users' functions added."""
        if all(user is None for user in self.own):
            return lane
        shape = jnp.broadcast_shapes(jnp.shape(time), self.rate.shape)
        times = jnp.broadcast_to(time, shape)
        vector = lane.shape[-1:] if self._in_space else ()
        none = jnp.zeros((*shape[:-1], *vector), lane.dtype)
        signature = "()->(d)" if self._in_space else "()->()"
        columns = [
            none
            if user is None
            else jnp.vectorize(lambda t, user=user: of(user, t), signature=signature)(times[..., w])
            for w, user in enumerate(self.own)
        ]
        return lane + jnp.stack(columns, axis=len(shape) - 1).astype(lane.dtype)

    def shift(self, time: Lane) -> Lane:
        """Return the displacement since time zero, in m."""
        steady = self.speed * self._per_axis(time * jnp.ones_like(self.rate))
        return steady + self._swung(jnp.zeros((), self.rate.dtype), time)

    def velocity(self, time: Lane) -> Lane:
        """Return the velocity in m/s."""
        turned = self._per_axis(self.rate * jnp.cos(self.rate * time + self.phase))
        return self._with_own(self.speed + self.amplitude * turned, time, UserMotion.velocity)

    def acceleration(self, time: Lane) -> Lane:
        """Return the acceleration in m/s²."""
        turned = self._per_axis(jnp.square(self.rate) * jnp.sin(self.rate * time + self.phase))
        return self._with_own(-self.amplitude * turned, time, UserMotion.acceleration)

    def _swung(self, now: Lane, time: Lane) -> Lane:
        phase = self.rate * now + self.phase
        swing = jnp.sin(self.rate * time + phase) - jnp.sin(phase)
        high = self.amplitude * self._per_axis(swing)
        return self._with_own(high, now + time, lambda user, t: user.place(t) - user.place(now))

    def swing(self, now: Lane, time: Lane) -> tuple[Lane, Lane]:
        """Return the unsteady part: displacement from `now` to `time` later, and its rate."""
        return self._swung(now, time), self.velocity(now + time) - self.speed

    def above(self, now: Lane) -> Lane:
        """Return the largest unsteady displacement after `now`, in m. For a wall it is the rise
        along the normal. For a sphere it is the distance in any direction.
        """
        turned = jnp.sin(self.rate * now + self.phase)
        if self._in_space:
            reach = self._size(self.amplitude) * (1 + jnp.abs(turned))
        else:
            reach = jnp.abs(self.amplitude) - self.amplitude * turned
        return reach + self._where_own(jnp.inf)

    def _where_own(self, value: Any) -> Lane:
        """Return `value` for bodies that move by a user's function, and 0 for the others."""
        rows = [0.0 if user is None else value for user in self.own]
        column = jnp.stack([jnp.asarray(x, self.rate.dtype) for x in rows])
        return column.reshape(self.rate.shape)

    @property
    def bounds(self) -> Lane:
        """The acceleration bounds of the users' functions; 0 for other bodies."""
        zero = jnp.zeros((), self.rate.dtype)
        column = jnp.stack([zero if user is None else user.bound for user in self.own])
        return column.reshape(self.rate.shape)

    def fastest(self, now: Lane, lasting: Lane) -> Lane:
        """Return a bound on the speed for a duration `lasting` after `now`, in m/s."""
        fixed = self._size(self.speed) + self._size(self.amplitude) * jnp.abs(self.rate)
        if all(own is None for own in self.own):
            return fixed
        none = jnp.zeros_like(self.amplitude)
        user = self._size(self._with_own(none, now, UserMotion.velocity))
        return user + (fixed + self.bounds * lasting)

    @property
    def strongest(self) -> Lane:
        """A bound on the acceleration, in m/s²."""
        fixed = self._size(self.amplitude) * jnp.square(self.rate)
        return fixed if all(user is None for user in self.own) else fixed + self.bounds

    @property
    def accelerated(self) -> Lane:
        """A mask of the accelerated bodies."""
        return (self.rate > 0) | (self._where_own(1.0) > 0)

    def kept_until(self, end: Number) -> Number:
        """Return the first time up to `end` at which a user's function exceeds its bound. The time
        is infinite if there is none. Both the acceleration and its effect on speed and place over
        an interval are checked.
        """
        times = jnp.linspace(0, 1, CHECKED + 1, dtype=end.dtype) * end
        step = end / CHECKED
        finest = _ROUNDINGS * jnp.finfo(end.dtype).eps
        kept = jnp.full_like(end, jnp.inf)
        for user in self.own:
            if user is None:
                continue
            place, velocity, acceleration = (
                jax.vmap(of)(times) for of in (user.place, user.velocity, user.acceleration)
            )
            speed = jnp.max(self._size(velocity))
            high = jnp.max(self._size(place)) + speed * end
            gained = self._size(jnp.diff(velocity, axis=0)) - user.bound * step
            moved = self._size(jnp.diff(place, axis=0) - velocity[:-1] * step)
            moved = moved - user.bound * step**2 / 2
            wrong = ~(self._size(acceleration) <= user.bound * (1 + finest))
            between = (gained > finest * speed) | (moved > finest * high)
            wrong = wrong | jnp.concatenate([between, jnp.zeros(1, bool)])
            kept = jnp.minimum(kept, jnp.min(jnp.where(wrong, times, jnp.inf)))
        return kept


class Turning(NamedTuple):
    """The rotation of bodies, and their friction on the walls on which they rest.

    `spin` (M, S) is in rad/s at the time of the state. `drag` (M, D) in m/s² and `twist` (M, S) in
    rad/s² are the accelerations by friction. A body slides `until` (M,) that time in s; infinite
    for one that does not.
    """

    spin: Lane
    drag: Lane
    twist: Lane
    until: Lane


def spin_energy(
    inverse: Float[Array, " N"], spin: Float[Array, "... N S"]
) -> Float[Array, "... N"]:
    """Return ½ I ω² in J of bodies with these 1/I; 0 for those that do not turn."""
    inertia = ratio(1.0, inverse).reshape(*(1,) * (spin.ndim - 2), -1)
    return jnp.sum(jnp.square(spin), axis=-1) * inertia / 2


class Rotation(eqx.Module):
    """The numbers of a scene that only friction needs.

    `spin` (N, S) is in rad/s. `inverse_inertia` (B,) is 0 for bodies that do not turn.
    `shear_compliance` (B,) of the materials is None if not known. `drift` is the motion of the
    walls in space, None if all are at rest.
    """

    spin: Float[Array, "N S"]
    inverse_inertia: Float[Array, " B"]
    shear_compliance: Float[Array, " B"] | None
    drift: Movers | None
    laws: tuple[Any, ...]

    def energy(self, spin: Float[Array, "... N S"]) -> Float[Array, "... N"]:
        """Return ½ I ω² of the spheres in J."""
        return spin_energy(self.inverse_inertia[: spin.shape[-2]], spin)


def free_turning(spin: Lane, dimensions: int) -> Turning:
    """Return spins (M, S) of bodies in flight."""
    count = spin.shape[0]
    none = jnp.zeros((count, dimensions), spin.dtype)
    return Turning(spin, none, jnp.zeros_like(spin), jnp.full(count, jnp.inf, spin.dtype))
