"""How soon spheres can meet: bounds on their speeds in flight and in a coupled solve."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..._coupled.modes import Number
from ..arrays.arrays import Flying, SceneArrays
from ..cluster.problem import norm
from .state import Coupling


class SpeedBounds(NamedTuple):
    """Bounds on the speeds of all spheres from a time on, (N,) each.

    `flying` is the speed in flight. Bodies in prescribed motion may add the speed `given`, which
    grows at the rate `push`. Gravity adds to the rate `weight`. `kinetic` in J is the energy of
    motion, `mass` is 0 for fixed spheres, and `reserve` in J is the energy stored in contacts.
    """

    flying: Float[Array, " N"]
    given: Float[Array, " N"]
    push: Float[Array, " N"]
    kinetic: Float[Array, " N"]
    mass: Float[Array, " N"]
    inverse: Float[Array, " N"]
    weight: Number
    reserve: Number

    def within(
        self, who: Int[Array, " M"], taken: Bool[Array, " M"]
    ) -> tuple[Float[Array, " M"], Float[Array, " M"]]:
        """Return the speeds in slots of which some are taken, and the rates at which these grow: no
        sphere has more than all energy E, and gravity adds at most √(Σm) g t to √(2 E).
        """
        energy = jnp.sum(jnp.where(taken, self.kinetic[who], 0)) + self.reserve
        total = jnp.sum(jnp.where(taken, self.mass[who], 0))
        share = jnp.sqrt(self.inverse[who])
        fast = jnp.sqrt(2 * energy) * share + self.given[who]
        gain = jnp.sqrt(total) * self.weight * share + self.push[who]
        return jnp.where(taken, fast, 0), jnp.where(taken, gain, 0)


def speed_bounds(model: SceneArrays, coupling: Coupling, there: Flying, now: Number) -> SpeedBounds:
    """Return the bounds at a time. A body in prescribed motion gives at most twice its velocity."""
    inverse = model.inverse_mass[: model.spheres]
    moves, none = inverse > 0, jnp.zeros_like(now)
    mass = jnp.where(moves, 1 / jnp.where(moves, inverse, 1), 0)
    flying = norm(there.velocity)
    kinetic = mass * jnp.square(flying) / 2
    if model.rotation is not None and there.turning is not None:
        kinetic = kinetic + model.rotation.energy(there.turning.spin)
    walls, shaking, given = model.motion, model.shaking, none
    push = jnp.zeros_like(flying)
    if walls is not None:
        given = 2 * jnp.max(walls.fastest(now, none))
        push = jnp.where(moves, 2 * jnp.max(walls.bounds), 0)
    if shaking is not None:
        which = np.array(model.shaken)
        flying = flying.at[which].set(shaking.fastest(now, none))
        bounds = jnp.zeros_like(flying).at[which].set(shaking.bounds)
        push = push + jnp.where(moves, 2 * jnp.max(bounds), bounds)
    if model.driven:
        given = given + 2 * jnp.max(jnp.where(moves, 0, flying))
    each = flying, jnp.where(moves, given, 0), push, kinetic, mass, inverse
    return SpeedBounds(*each, norm(model.gravity), coupling.reserve)


def time_to_cover(way: Array, speed: Array, gain: Array) -> Array:
    """Return the time for a way in m at a speed that grows at a rate; inf if both are 0."""
    moves = (speed > 0) | (gain > 0)
    root = jnp.sqrt(jnp.square(speed) + 2 * gain * way)
    return jnp.where(moves, 2 * way / jnp.where(moves, speed + root, 1), jnp.inf)
