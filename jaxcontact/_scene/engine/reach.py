"""How soon spheres can meet: bounds on their speeds, in flight and in a coupled solve; and whether
two meet alone, so that the solution of the pair applies.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..._coupled.modes import Flag, Number
from ..arrays.arrays import Flying, SceneArrays, at_once, nearest_image
from ..bodies.bodies import side
from ..cluster.problem import norm
from ..pair_impact.friction import is_followed
from ..pair_impact.instantaneous import Choice, ImpactOutcome
from .state import Coupling, RunState, RunTask


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


REACH = 4.0
"""The safety factor on the distance of a third body from an isolated impact."""


def is_isolated(
    task: RunTask, state: RunState, choice: Choice, outcome: ImpactOutcome, now: Number
) -> Flag:
    """Return whether two bodies of a soft scene meet alone, under forces of the pair solution. The
    loop asks it for impacts with a duration; others, and those that last from before, are alone.

    Speeds are bounded by the total energy. During the impact no body may cover a quarter of its
    distance. The velocity of a shaking body may change by at most a tenth of the tolerance. So may
    the v0 of the damping, between touch and peak.
    """
    model, rules, tolerance = task.model, task.rules, task.tolerance
    count = model.spheres
    inverse = model.inverse_mass[:count]
    moves = inverse > 0
    everyone = jnp.arange(count)
    there, pull = at_once(model, everyone, state.flying, state.support, now)
    position, velocity = there.position, there.velocity
    mass = jnp.where(moves, 1 / jnp.where(moves, inverse, 1), 0)
    energy = jnp.sum(mass * jnp.sum(jnp.square(velocity), axis=-1)) / 2
    energy = energy + jnp.sum(jnp.where(state.time > now, state.owed, 0))
    if model.rotation is not None and state.turning is not None:
        energy = energy + jnp.sum(model.rotation.energy(state.turning.spin))
    if state.coupling is not None:
        energy = energy + jnp.where(state.coupling.active, state.coupling.reserve, 0)
    last = jnp.max(outcome.after.time) - now
    gain = jnp.sqrt(jnp.sum(jnp.square(model.gravity))) * last
    fastest = jnp.sqrt(2 * energy * inverse) + jnp.where(moves, gain, 0)
    second = jnp.minimum(choice.second, count - 1)
    is_wall = choice.second >= count
    alone = outcome.status == 0
    motion = model.motion
    if motion is not None:
        # A wall gives a body at most twice its own velocity.
        fastest = fastest + jnp.where(moves, 2 * jnp.max(motion.fastest(now, last)), 0)
    if model.driven:
        # So does a fixed sphere that moves.
        driven = jnp.where(moves, 0, jnp.sqrt(jnp.sum(jnp.square(velocity), axis=-1)))
        if model.shaking is not None:
            gain = model.shaking.strongest * last
            driven = driven.at[np.array(model.shaken)].add(gain)
            change = jnp.concatenate([gain, jnp.zeros(1, gain.dtype)])[model.shaken_row(second)]
            alone = alone & (is_wall | (10 * change <= tolerance * outcome.closing))
        fastest = fastest + jnp.where(moves, 2 * jnp.max(driven), driven)
    if any(model.vibrating):
        assert motion is not None
        change = motion.strongest[jnp.clip(choice.second - count, 0)] * last
        alone = alone & ~(is_wall & (10 * change > tolerance * outcome.closing))
    in_shell = model.spheres > model.visible and rules.v0 == "peak"
    if in_shell and any(law.damped for law in model.laws):
        # The closing speed of a body along the inside of a shell rises at first. The pair solution
        # uses v0 at touch.
        distance = model.radius[choice.first] + model.radius[second]
        rate = velocity[choice.first] - velocity[second]
        across = jnp.maximum(jnp.sum(jnp.square(rate)) - jnp.square(outcome.closing), 0)
        gain = across / jnp.abs(distance) * last
        steady = (distance > 0) | (10 * gain <= tolerance * outcome.closing)
        alone = alone & (is_wall | steady)
    # A fixed body transmits nothing.
    for body, counts in ((choice.first, jnp.asarray(True)), (second, ~is_wall & moves[second])):
        apart = nearest_image(model, position[body][None] - position)[0]
        distance = model.radius[body] + model.radius
        gap = side(distance) * jnp.sqrt(jnp.sum(jnp.square(apart), axis=-1)) - distance
        partner = (everyone == choice.first) | ((everyone == second) & ~is_wall)
        far = gap > REACH * (fastest[body] + fastest) * last
        far = far | partner | ~(moves[body] | moves)
        alone = alone & (jnp.all(far) | ~counts)
        if model.walls:
            height = jnp.sum(position[body][None] * model.normal, axis=-1)
            reach = fastest[body] * last
            if motion is not None:
                reach = reach + motion.fastest(now, last) * last
            height = height - model.walls_at(now).offset
            room = height - model.radius[body] > REACH * reach
            partner = jnp.arange(model.walls) == choice.second - count
            alone = alone & (jnp.all(room | partner) | ~counts | ~moves[body])
    if model.has_gravity:
        who = jnp.stack([choice.first, second])
        bend = pull[who[0]] - pull[who[1]]
        if model.walls:
            face = model.normal[jnp.clip(choice.second - count, 0)]
            # Gravity along a wall has no effect. For gravity normal to it the pair solution uses v0
            # at touch. So does the formula of a friction law.
            weight = jnp.sum(face * pull[who[0]])
            at_touch = rules.v0 == "touch" or not is_followed(model)
            bend = jnp.where(is_wall, face * (0 if at_touch else weight), bend)
        alone = alone & jnp.all(bend == 0)
    return alone & jnp.all(choice.support < 0)
