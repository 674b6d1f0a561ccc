"""The derivative of a run: its impacts once more, one after the other, for tangents only.

The search is never differentiated. Around what it wrote down stands a rule that is linear in the
tangents: row by row, those of the two bodies before the impact and those of the numbers of the
scene give those after it. Being linear it transposes, so that one search serves both modes; being
taken at the states written down it does not drift away from them, however chaotic the scene is.
"""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Int

from ._hit import Flying, Outcome, hit
from ._log import Figures, Log
from ._system import Layout, Numbers


def differentiable(layout: Layout, numbers: Numbers, log: Log, written: Int[Array, ""]) -> Log:
    """The log, whose figures have the derivatives by `numbers`."""
    leaves, rest = eqx.partition(numbers, eqx.is_inexact_array)

    @jax.custom_jvp
    def figures(leaves: Any, log: Log, written: Array) -> Figures:
        return log.figures

    @figures.defjvp
    def rule(primals: tuple, tangents: tuple) -> tuple[Figures, Figures]:
        leaves, log, written = primals
        known = figures(leaves, log, written)
        found = _tangents(layout, rest, leaves, tangents[0], log._replace(figures=known), written)
        return known, found

    return log._replace(figures=figures(leaves, log, written))


def _tangents(
    layout: Layout, rest: Any, leaves: Any, along: Any, log: Log, written: Int[Array, ""]
) -> Figures:
    def row(carry: Flying, one: tuple[Log, Array]) -> tuple[Flying, Figures]:
        (known, facts), counts = one
        first, second = facts.choice.first, jnp.minimum(facts.choice.second, layout.spheres - 1)
        is_sphere = facts.choice.second < layout.spheres
        who = jnp.stack([first, jnp.where(is_sphere, second, first)])
        before = jax.tree.map(lambda all: all[who], carry)

        def impact(leaves: Any, before: Flying) -> Outcome:
            return hit(layout, eqx.combine(leaves, rest), before, facts.choice)

        # Blank rows hold an impact of bodies that touch and close, whose derivatives are finite.
        place = _blank(layout, known.before, facts.choice.time)
        safe = jax.tree.map(lambda a, b: jnp.where(counts, a, b), known.before, place)
        _, outcome = jax.jvp(impact, (leaves, safe), (along, before))
        outcome = jax.tree.map(lambda x: jnp.where(counts, x, jnp.zeros_like(x)), outcome)
        before = jax.tree.map(lambda x: jnp.where(counts, x, jnp.zeros_like(x)), before)

        def put(all: Array, new: Array) -> Array:
            old = all[who]
            keep = jnp.stack([counts, counts & is_sphere])
            new = jnp.where(keep.reshape((2,) + (1,) * (old.ndim - 1)), new, old)
            return all.at[who[1]].set(new[1]).at[first].set(new[0])

        carry = jax.tree.map(put, carry, outcome.after)
        return carry, Figures(before, outcome)

    time = jnp.zeros(layout.spheres, along.position.dtype)
    start = Flying(along.position, along.velocity, time)
    counts = jnp.arange(log.facts.tied.shape[0]) < written
    return jax.lax.scan(row, start, (log, counts))[1]


def _blank(layout: Layout, like: Flying, time: Array) -> Flying:
    ones = jnp.ones((1, layout.dimensions), like.position.dtype)
    away = jnp.concatenate([ones, -ones])
    return Flying(away, -away, jnp.broadcast_to(time, like.time.shape))
