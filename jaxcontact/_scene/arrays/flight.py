"""Spheres in flight: on parabolas, or in prescribed motion."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..._coupled.rows import rows_of
from .arrays import SceneArrays
from .movers import Turning

Lane = Float[Array, "..."]


class Flying(NamedTuple):
    """Bodies in flight, each at its own `time` (M,): `position` and `velocity` (M, D). In an impact
    with a wall, the second row repeats the first. `turning` is None without friction.
    """

    position: Lane
    velocity: Lane
    time: Lane
    turning: Turning | None = None


def where_each(counts: Bool[Array, " M"], first: Flying, second: Flying) -> Flying:
    """Return `first` for each body that `counts`, else `second`."""
    return jax.tree.map(
        lambda a, b: jnp.where(counts.reshape(-1, *(1,) * (a.ndim - 1)), a, b), first, second
    )


def accelerations(
    model: SceneArrays, who: Int[Array, " M"], support: Int[Array, " M"]
) -> Float[Array, "M D"]:
    """Return gravity of the free spheres, less the normal part for those that rest on walls."""
    if not model.has_gravity:
        return jnp.zeros((who.shape[0], model.dimensions), model.dtype)
    pull = rows_of(model.pull, support + 1)
    if any(model.fixed):
        pull = jnp.where((rows_of(model.inverse_mass, who) > 0)[:, None], pull, 0)
    return pull


def at_once(
    model: SceneArrays, who: Int[Array, " M"], flying: Flying, support: Int[Array, " M"], time: Lane
) -> tuple[Flying, Float[Array, "M D"]]:
    """Return spheres in flight at one time, and their accelerations by gravity, and by friction on
    the walls on which they rest. Accelerated fixed spheres are placed by their motion, regardless
    of `flying`.
    """
    pull, turning = accelerations(model, who, support), flying.turning
    passed = (time - flying.time)[:, None]
    if turning is not None:
        pull = pull + turning.drag
        turning = turning._replace(spin=turning.spin + turning.twist * passed)
    velocity = flying.velocity + pull * passed
    position = flying.position + (flying.velocity + velocity) / 2 * passed
    if model.shaken:
        place, rate = model.shaken_at(time)
        place, rate = (jnp.concatenate([x, jnp.zeros_like(x[:1])]) for x in (place, rate))
        row = model.shaken_row(who)
        shakes = (row < len(model.shaken))[:, None]
        position = jnp.where(shakes, place[row], position)
        velocity = jnp.where(shakes, rate[row], velocity)
    return Flying(position, velocity, jnp.broadcast_to(time, flying.time.shape), turning), pull
