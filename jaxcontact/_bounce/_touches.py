"""The sequence of touches: speed, restitution and duration of each."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array

from .._contact import Contact
from .._impact import AbstractMethod, Impact, Status, impact
from .._laws import AbstractLaw

_SEPARATED, _SETTLED = int(Status.SEPARATED), int(Status.SETTLED)


class Touches(NamedTuple):
    """The touches of a run, along the last axis.

    Restitution and duration are 0 where the ball does not leave; `status` says why.
    """

    speed: Array
    restitution: Array
    duration: Array
    status: Array


def alike(first: Impact, speed: Array, power: float | Array, rest: Array, count: int) -> Touches:
    """All touches from the first one, for a law whose e does not depend on the speed.

    In scaled units they are the same impact: v_k = e^k v_0, and the duration goes with v^power.
    """
    status = first.status[..., None]
    leaves = status == _SEPARATED
    e = jnp.where(leaves, first.restitution[..., None], 0)
    ratio = jnp.cumprod(jnp.concatenate([jnp.ones_like(e), *[e] * (count - 1)], axis=-1), axis=-1)
    speeds = speed[..., None] * ratio
    moving = speeds >= rest[..., None]
    begun = jnp.concatenate([jnp.ones_like(leaves), moving[..., :-1]], axis=-1)
    slower = jnp.where(moving, ratio, 1) ** power
    return Touches(
        speed=jnp.where(begun, speeds, 0),
        restitution=jnp.where(moving, e, 0),
        duration=jnp.where(leaves & moving, first.duration[..., None], 0) * slower,
        status=jnp.where(leaves & ~moving, _SETTLED, status),
    )


def one_by_one(
    law: AbstractLaw,
    contact: Contact,
    speed: Array,
    rest: Array,
    weight: Array | None,
    method: AbstractMethod,
    count: int,
) -> Touches:
    """Each touch solved with its own speed; `weight` in N acts in contact, where it is given."""
    first = speed

    def one(carry: tuple[Array, Array], _: None) -> tuple[tuple[Array, Array], Touches]:
        speed, state = carry
        begun = state == _SEPARATED
        moving = begun & (speed >= rest)
        # A lane that has ended solves its first impact again, whose outcome is finite.
        speed_here = jnp.where(moving, speed, first)
        hit = impact(law, contact, speed_here, method=method, external_force=weight)
        status = jnp.where(begun, jnp.where(moving, hit.status, _SETTLED), state)
        # Nothing infinite and no NaN goes on: 0 times them is no derivative of a good number.
        leaves = status == _SEPARATED
        restitution = jnp.where(leaves, hit.restitution, 0)
        touch = Touches(
            speed=jnp.where(begun, speed, 0),
            restitution=restitution,
            duration=jnp.where(leaves, hit.duration, 0),
            status=status,
        )
        return (restitution * speed, status.astype(jnp.int32)), touch

    start = (speed, jnp.full(speed.shape, _SEPARATED, jnp.int32))
    _, touches = jax.lax.scan(one, start, None, length=count)
    return jax.tree.map(lambda leaf: jnp.moveaxis(leaf, 0, -1), touches)
