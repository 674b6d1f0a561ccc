"""The test whether an impact involves only two bodies, so that the pair's solution applies.

The loop asks it for impacts with a duration. Instantaneous impacts, and those that began before the
run, are isolated.
"""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from ..._coupled.modes import Flag, Number
from ..arrays.arrays import at_once, nearest_image
from ..bodies.bodies import side
from ..pair_impact.friction import is_followed
from ..pair_impact.instantaneous import Choice, ImpactOutcome
from .state import RunState, RunTask

REACH = 4.0
"""The safety factor on the distance of a third body from an isolated impact."""


def is_isolated(
    task: RunTask, state: RunState, choice: Choice, outcome: ImpactOutcome, now: Number
) -> Flag:
    """Return whether two bodies of a soft scene meet alone, under forces of the pair solution.

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
