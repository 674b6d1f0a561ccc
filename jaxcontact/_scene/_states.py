"""The state of all spheres at any time, read from the log of a run."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ._hit import accelerations
from ._log import Log
from ._system import Layout, Numbers


def states_at(
    layout: Layout,
    numbers: Numbers,
    log: Log,
    written: Int[Array, ""],
    times: Float[Array, " T"],
) -> tuple[Float[Array, "T N D"], Float[Array, "T N D"]]:
    """Positions and velocities at some times; at an impact those after it.

    Of every sphere the last impact up to that time is looked up, by halving, in a list that is
    sorted by sphere and time: no table of times, spheres and impacts.
    """
    count, rows = layout.spheres, log.facts.tied.shape[0]
    figures, facts = log
    blank = jnp.arange(rows) >= written
    first = jnp.where(blank, count, facts.choice.first)
    second = jnp.where(blank, count, jnp.minimum(facts.choice.second, count))
    number = jnp.arange(1, rows + 1)
    keys = jnp.concatenate([jnp.arange(count), first, second]) * (rows + 1)
    keys = keys + jnp.concatenate([jnp.zeros(count, int), number, number])
    order = jnp.argsort(keys)
    after = figures.outcome.after
    position = jnp.concatenate([numbers.position, after.position[:, 0], after.position[:, 1]])
    velocity = jnp.concatenate([numbers.velocity, after.velocity[:, 0], after.velocity[:, 1]])
    start = jnp.zeros(count, numbers.dtype)
    began = jnp.concatenate([start, after.time[:, 0], after.time[:, 1]])
    support = jnp.concatenate([jnp.full(count, -1), facts.support[:, 0], facts.support[:, 1]])

    happened = jnp.where(blank, jnp.inf, figures.outcome.time)
    passed = jnp.searchsorted(happened, times, side="right").astype(int)
    wanted = jnp.arange(count)[None] * (rows + 1) + passed[:, None]
    place = jnp.searchsorted(keys[order], wanted.reshape(-1), side="right") - 1
    entry = order[place]
    who = jnp.tile(jnp.arange(count), times.shape[0])
    pull = accelerations(layout, numbers, who, support[entry])
    since = (jnp.repeat(times, count) - began[entry])[:, None]
    speed = velocity[entry] + pull * since
    at = position[entry] + (velocity[entry] + speed) / 2 * since
    shape = (times.shape[0], count, layout.dimensions)
    return at.reshape(shape), speed.reshape(shape)


def energy_of(
    layout: Layout,
    numbers: Numbers,
    position: Float[Array, "T N D"],
    velocity: Float[Array, "T N D"],
) -> Float[Array, " T"]:
    """Kinetic energy and weight of all free spheres, ½ m v² - m g·x, in J."""
    inverse = numbers.inverse_mass[: layout.spheres]
    free = inverse > 0
    mass = jnp.where(free, 1 / jnp.where(free, inverse, 1), 0)
    kinetic = jnp.sum(jnp.square(velocity), axis=-1) / 2
    weight = jnp.sum(position * numbers.gravity[None, None], axis=-1)
    return jnp.sum(mass[None] * (kinetic - weight), axis=-1)
