"""A ball that falls, hits and rises again: flights by formula, impacts by the law."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float, Int

from ._contact import Contact
from ._impact import Status, impact
from ._laws import VELOCITY_THRESHOLD, AbstractLaw
from ._parameter import POSITIVE, as_parameter


class Bounce(eqx.Module):
    """The impacts of a bouncing ball, in order; shape (..., bounces).

    `time` in s, when impact k begins, counted from the release; `impact_velocity` in m/s;
    `restitution`; `height` in m, to which the ball rises after it; `status` as in `Impact`. After
    the ball has come too slow for an impact (`VELOCITY_THRESHOLD`) the status is SETTLED and the
    numbers are those of a ball at rest: no speed, no height, the time at which it came to rest.
    """

    time: Float[Array, "..."]
    height: Float[Array, "..."]
    impact_velocity: Float[Array, "..."]
    restitution: Float[Array, "..."]
    status: Int[Array, "..."]


def bounce(
    law: AbstractLaw,
    contact: Contact,
    height: ArrayLike,
    *,
    gravity: ArrayLike = 9.81,
    bounces: int = 20,
    method: str = "auto",
) -> Bounce:
    """Drop a ball and follow its impacts: v_1 = √(2gh), v_(k+1) = e(v_k) v_k, h_k = v_(k+1)²/(2g).

    Arguments: the law and the contact of ball and ground; the drop `height` h in m of the ball's
    lowest point; `gravity` g in m/s²; how many `bounces` to follow. They broadcast. Each impact has
    its own speed, so that a law whose restitution depends on speed changes from bounce to bounce.
    Gravity acts in flight only, and flights are in vacuum: good while m g is small beside the force
    of the contact. `method` as in `impact`.

    Returns a `Bounce`; a bad lane is NaN and flagged. Raises ValueError for a Python scalar out of
    range. Source: elementary ballistics, and `impact`.
    """
    if not isinstance(bounces, int) or bounces < 1:
        raise ValueError(
            f"Argument `bounces` must be a whole number of at least 1, but is {bounces!r}."
        )
    height = as_parameter(height, "height", POSITIVE)
    gravity = as_parameter(gravity, "gravity", POSITIVE)
    return _bounce(law, contact, height, gravity, bounces, method)


@eqx.filter_jit
def _bounce(
    law: AbstractLaw, contact: Contact, height: Array, gravity: Array, bounces: int, method: str
) -> Bounce:
    valid = POSITIVE.holds(height) & POSITIVE.holds(gravity)
    safe_height = jnp.where(valid, height, 1)
    safe_gravity = jnp.where(valid, gravity, 1)
    speed = jnp.sqrt(2 * safe_gravity * safe_height)
    outcome = jax.eval_shape(lambda v: impact(law, contact, v, method=method), speed)
    shape, dtype = outcome.restitution.shape, outcome.restitution.dtype
    speed = jnp.broadcast_to(speed, shape).astype(dtype)
    safe_gravity = safe_gravity.astype(dtype)
    fall = jnp.broadcast_to(speed / safe_gravity, shape)

    def one(carry: tuple[Array, Array], _: None) -> tuple[tuple[Array, Array], Bounce]:
        time, speed = carry
        moving = ~(speed < VELOCITY_THRESHOLD)  # a NaN from a bad lane stays one
        hit = impact(law, contact, jnp.where(moving, speed, 1), method=method)
        restitution = jnp.where(moving, hit.restitution, 0)
        rebound = jnp.where(moving, hit.rebound_velocity, 0)
        contact_time = jnp.where(moving & (hit.status == int(Status.SEPARATED)), hit.duration, 0)
        flight = 2 * rebound / safe_gravity
        record = Bounce(
            time=time,
            height=rebound * rebound / (2 * safe_gravity),
            impact_velocity=jnp.where(moving, speed, 0),
            restitution=restitution,
            status=jnp.where(moving, hit.status, int(Status.SETTLED)),
        )
        return (time + contact_time + flight, rebound), record

    _, records = jax.lax.scan(one, (fall, speed), None, length=bounces)
    moved = jax.tree.map(lambda leaf: jnp.moveaxis(leaf, 0, -1), records)
    flags = moved.status == int(Status.INVALID_INPUT)
    bad = jnp.broadcast_to(~valid, shape)[..., None] | flags

    def flagged(leaf: Array) -> Array:
        if jnp.issubdtype(leaf.dtype, jnp.integer):
            return jnp.where(bad, int(Status.INVALID_INPUT), leaf)
        return jnp.where(bad, jnp.nan, leaf)

    return jax.tree.map(flagged, moved)
