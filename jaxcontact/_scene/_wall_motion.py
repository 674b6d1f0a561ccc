"""How the walls of a scene move, all at once."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ._motion import Own

Lane = Float[Array, "..."]

CHECKED = 4096
"""Intervals of a run at whose ends the bound of an acceleration is looked at."""

_ROUNDINGS = 64


class WallMotion(eqx.Module):
    """How walls move along their normals: V t + A (sin(ω t + φ) - sin φ), (W,) each; 0 of walls
    that stand; of some of them a function of the user's `own` beside.

    Times are numbers, or arrays whose last axis is that of the walls.
    """

    speed: Float[Array, "..."]
    amplitude: Float[Array, "..."]
    rate: Float[Array, "..."]
    phase: Float[Array, "..."]
    own: tuple[Own | None, ...]

    def in_rows(self) -> WallMotion:
        """With an axis for bodies before that of the walls."""
        rows = (self.speed[None], self.amplitude[None], self.rate[None], self.phase[None])
        return WallMotion(*rows, self.own)

    def _with_own(self, lane: Lane, time: Lane, of: Callable[[Own, Array], Array]) -> Lane:
        """A quantity with that of the user's functions."""
        if all(own is None for own in self.own):
            return lane
        shape = jnp.broadcast_shapes(jnp.shape(time), self.speed.shape)
        times = jnp.broadcast_to(time, shape)
        none = jnp.zeros(shape[:-1], lane.dtype)
        columns = [
            none if own is None else jnp.vectorize(lambda t, own=own: of(own, t))(times[..., w])
            for w, own in enumerate(self.own)
        ]
        return lane + jnp.stack(columns, axis=-1).astype(lane.dtype)

    def shift(self, time: Lane) -> Lane:
        """The displacement since time zero, in m."""
        swing = jnp.sin(self.rate * time + self.phase) - jnp.sin(self.phase)
        moved = self.speed * time + self.amplitude * swing
        return self._with_own(moved, time, lambda own, t: own.place(t) - own.place(0 * t))

    def velocity(self, time: Lane) -> Lane:
        """In m/s."""
        moves = self.speed + self.amplitude * self.rate * jnp.cos(self.rate * time + self.phase)
        return self._with_own(moves, time, Own.velocity)

    def acceleration(self, time: Lane) -> Lane:
        """In m/s²."""
        strongest = self.amplitude * jnp.square(self.rate)
        shakes = -strongest * jnp.sin(self.rate * time + self.phase)
        return self._with_own(shakes, time, Own.acceleration)

    def swing(self, now: Lane, time: Lane) -> tuple[Lane, Lane]:
        """What is not steady: the displacement from a time `now` to `time` later, and its rate."""
        phase = self.rate * now + self.phase
        turned = self.rate * time + phase
        high = self.amplitude * (jnp.sin(turned) - jnp.sin(phase))
        fast = self.amplitude * self.rate * jnp.cos(turned)
        return (
            self._with_own(high, now + time, lambda own, t: own.place(t) - own.place(now)),
            self._with_own(fast, now + time, Own.velocity),
        )

    def above(self, now: Lane) -> Lane:
        """How much higher than `now` a wall may come beside its steady motion, in m."""
        phase = self.rate * now + self.phase
        return jnp.abs(self.amplitude) - self.amplitude * jnp.sin(phase) + self._where_own(jnp.inf)

    def _where_own(self, value: Any) -> Lane:
        """A number for every wall: that of those that move by a function, 0 of the others."""
        rows = [0.0 if own is None else value for own in self.own]
        column = jnp.stack([jnp.asarray(x, self.speed.dtype) for x in rows])
        return column.reshape(self.speed.shape)

    @property
    def bounds(self) -> Lane:
        """Of the accelerations of the user's functions; 0 of other walls."""
        zero = jnp.zeros((), self.speed.dtype)
        column = jnp.stack([zero if own is None else own.bound for own in self.own])
        return column.reshape(self.speed.shape)

    def fastest(self, now: Lane, lasting: Lane) -> Lane:
        """The largest speed there may be for a time from now on, in m/s."""
        fixed = jnp.abs(self.speed) + jnp.abs(self.amplitude * self.rate)
        if all(own is None for own in self.own):
            return fixed
        return jnp.abs(self._with_own(jnp.zeros_like(fixed), now, Own.velocity)) + (
            fixed + self.bounds * lasting
        )

    @property
    def strongest(self) -> Lane:
        """The largest acceleration there is, in m/s²."""
        fixed = jnp.abs(self.amplitude) * jnp.square(self.rate)
        return fixed if all(own is None for own in self.own) else fixed + self.bounds

    @property
    def accelerated(self) -> Lane:
        """Which walls are."""
        return (self.rate > 0) | (self._where_own(1.0) > 0)

    def kept_until(self, end: Float[Array, ""]) -> Float[Array, ""]:
        """The first time at which a user's function is seen to exceed its bound; infinite where
        none does up to the `end`.

        Seen by the acceleration itself, or by what it did to speed and place in an interval.
        """
        times = jnp.linspace(0, 1, CHECKED + 1, dtype=end.dtype) * end
        step = end / CHECKED
        finest = _ROUNDINGS * jnp.finfo(end.dtype).eps
        kept = jnp.full_like(end, jnp.inf)
        for own in self.own:
            if own is None:
                continue
            place, velocity, acceleration = (
                jax.vmap(of)(times) for of in (own.place, own.velocity, own.acceleration)
            )
            speed = jnp.max(jnp.abs(velocity))
            high = jnp.max(jnp.abs(place)) + speed * end
            gained = jnp.abs(jnp.diff(velocity)) - own.bound * step
            moved = jnp.abs(jnp.diff(place) - velocity[:-1] * step) - own.bound * step**2 / 2
            wrong = ~(jnp.abs(acceleration) <= own.bound * (1 + finest))
            between = (gained > finest * speed) | (moved > finest * high)
            wrong = wrong | jnp.concatenate([between, jnp.zeros(1, bool)])
            kept = jnp.minimum(kept, jnp.min(jnp.where(wrong, times, jnp.inf)))
        return kept
