"""The result of a bouncing ball."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from .._entry import as_parameter, require_broadcast, shown, traced
from .._flight import Flight
from .._impact import Status
from .._text.columns import in_lines
from .._text.failure import Flagged
from .._text.units import quantity
from .._text.words import counted

TOUCHES = (
    *("time", "duration", "return_time", "impact_velocity"),
    *("restitution", "height", "status"),
)
"""Fields of a `Bounce` with one number per touch."""


class Bounce(Flagged, eqx.Module):
    """The touches of a bouncing ball, in order: shape (..., touches).

    `time` in s is the start of touch k, counted from the release. `duration` in s lasts until the
    force vanishes. `return_time` in s lasts until the ball is back at δ = 0; it is longer than the
    duration if a force that only pushes vanishes before. `impact_velocity` v is in m/s.
    `restitution` e is the speed back at δ = 0 over that at the touch. `height` (e v)²/(2g) in m is
    reached after the touch. `status` as in `Impact`.

    At its touch of status SETTLED the ball comes to rest: it does not leave, restitution and height
    are 0, and both times are infinite. Later touches repeat it with zero speed.

    The other fields have one number per run, shape (...). `ok` is False with a touch that is
    NOT_CONVERGED, INVALID_INPUT or GAINED. `at_rest` is True if the ball came to rest within the
    listed touches. `rest_time` in s is the start of its last touch; it and its derivative are NaN
    if the ball is not at rest. `margin` in m/s is the smallest change of an impact speed that adds
    or removes a touch. `rest_time` jumps there, so its derivative is valid within the margin only.
    `rest_velocity` in m/s is the speed below which a touch counts as rest. `rest_indentation` δ =
    (m g/K)^(1/n) in m is the static indentation, NaN for a law whose force at rest is not K δⁿ.

    `remaining_flight` in s is 2 e v/(g (1-e)), the sum of the infinitely many flights after the
    last listed touch if no threshold ended them. It excludes the contacts between them, whose times
    grow, and is None if e depends on the speed. `drop_height` in m and `gravity` in m/s² are the
    given ones.
    """

    time: Float[Array, "..."]
    duration: Float[Array, "..."]
    impact_velocity: Float[Array, "..."]
    restitution: Float[Array, "..."]
    height: Float[Array, "..."]
    status: Int[Array, "..."]
    rest_time: Float[Array, "..."]
    rest_velocity: Float[Array, "..."]
    rest_indentation: Float[Array, "..."]
    remaining_flight: Float[Array, "..."] | None
    drop_height: Float[Array, "..."]
    gravity: Float[Array, "..."]
    return_time: Float[Array, "..."]
    at_rest: Bool[Array, "..."]
    margin: Float[Array, "..."]
    _failures, _axes = (Status.NOT_CONVERGED, Status.INVALID_INPUT, Status.GAINED), 1

    def height_at(self, time: ArrayLike) -> Float[Array, "..."]:
        """Return the height of the ball's lowest point above the ground at any time, in m.

        `time` in s, shape (samples,) or (..., samples). The height is 0 until the ball is back at δ
        = 0 (indentations are not resolved), and at rest. It is NaN in bad lanes and after the
        flight that follows the last listed touch. Before the release it is the drop height.
        """
        time = as_parameter(time, "time").astype(self.time.dtype)
        require_broadcast(time=time, bounces=self.rest_time[..., None])
        shape = np.broadcast_shapes(time.shape, (*self.rest_time.shape, 1))
        time = jnp.broadcast_to(time, shape)

        def of_touches(field: Array) -> Array:
            return jnp.broadcast_to(field, (*shape[:-1], field.shape[-1]))

        def of_run(number: Array) -> Array:
            return jnp.broadcast_to(number, shape[:-1])[..., None]

        begins = of_touches(self.time)
        touched = jnp.sum(begins[..., None, :] <= time[..., :, None], axis=-1)
        last = jnp.maximum(touched - 1, 0)

        def of_last(field: Array) -> Array:
            return jnp.take_along_axis(of_touches(field), last, axis=-1)

        gravity = of_run(self.gravity)
        drop = Flight.height_after(jnp.maximum(time, 0), jnp.zeros_like(time), gravity, None)
        falling = of_run(self.drop_height) + drop
        resting = of_last(self.status) == int(Status.SETTLED)
        leaves = of_last(self.time) + jnp.where(resting, 0, of_last(self.return_time))
        speed = of_last(self.restitution * self.impact_velocity)
        flown = jnp.maximum(time - leaves, 0)
        flying = Flight.height_after(flown, speed, gravity, None)
        unknown = (touched == self.time.shape[-1]) & (flown > Flight.duration(speed, gravity, None))
        # Rounding may place the end of a flight below the ground.
        flying = jnp.where(unknown, jnp.nan, jnp.maximum(flying, 0))
        return jnp.where(touched == 0, falling, jnp.where(resting, 0, flying))

    def __repr__(self) -> str:
        first = [
            quantity(name, _shown(getattr(self, name), 0)) for name in ("time", "impact_velocity")
        ]
        numbers = {
            "touches": str(self.time.shape[-1]),
            "first touch": ", ".join(first),
            "last height": quantity("height", _shown(self.height, -1)),
            "rest_time": quantity("rest_time", shown(self.rest_time)),
            "margin": quantity("margin", shown(self.margin)),
            "rest_indentation": quantity("rest_indentation", shown(self.rest_indentation)),
            "status": self._status_words(),
        }
        return in_lines("Bounce", numbers, 17)

    def _status_words(self) -> str:
        """Return how the balls ended, counted by ball."""
        status, at_rest = self.status, self.at_rest
        if traced(status, at_rest) or not all(map(eqx.is_array, (status, at_rest))):
            return str(status)
        status, at_rest = np.asarray(status), np.asarray(at_rest)
        bounces = np.sum(status == int(Status.SEPARATED), axis=-1)
        # A bad status lasts to the end of its run.
        last = status[..., -1]
        flying, many = last == int(Status.SEPARATED), status.ndim > 1
        words = []
        for chosen, what in ((at_rest, "at rest after"), (flying, "not at rest after")):
            if np.any(chosen):
                least, most = np.min(bounces[chosen]), np.max(bounces[chosen])
                count = f"{least}" if least == most else f"{least} to {most}"
                word = "bounce" if least == most == 1 else "bounces"
                balls = counted(int(np.sum(chosen)), ("ball", "balls"))
                head = f"{balls} " if many else ""
                words.append(f"{head}{what} {count} {word}")
        bad = last[~at_rest & ~flying]
        if bad.size:
            words.append(Status.names_of(bad if many else bad[0]))
        return ", ".join(words)


def _shown(values: Array, index: int) -> str:
    return shown(values[..., index]) if eqx.is_array(values) else str(values)
