"""The derivative of a run: its impacts once more, one after the other, for tangents only.

The search is never differentiated. Around what it wrote down stands a rule that is linear in the
tangents: row by row, those of the two bodies before the impact and those of the numbers of the
scene give those after it. Being linear it transposes, so that one search serves both modes; being
taken at the states written down it does not drift away from them, however chaotic the scene is.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ._cluster import MOST_STEPS
from ._coupled import as_flags, as_numbers, call, work_of_walls
from ._flying import Flying, where_each
from ._hit import Outcome, hit, two_that_meet
from ._log import Facts, Figures, Log, Together
from ._progress import Rules
from ._slots import in_place, index_of, places, put, rearranged
from ._soft import soft
from ._system import Layout, Numbers
from ._touching import ClusterState


def differentiable(
    layout: Layout,
    numbers: Numbers,
    rules: Rules,
    log: Log,
    written: Int[Array, ""],
    tolerance: Float[Array, ""],
) -> Log:
    """The log, whose figures have the derivatives by `numbers`."""
    leaves, rest = eqx.partition(numbers, eqx.is_inexact_array)
    # What is traced, and no number, is an argument of the rule.
    underway = None if numbers.start is None else numbers.start.underway
    amid = None if underway is None else underway.counts

    @jax.custom_jvp
    def figures(
        leaves: Any, log: Log, amid: Array | None, written: Array, tolerance: Array
    ) -> Figures:
        return log.figures

    @figures.defjvp
    def rule(primals: tuple, tangents: tuple) -> tuple[Figures, Figures]:
        leaves, log, amid, written, tolerance = primals
        known = figures(leaves, log, amid, written, tolerance)
        found = _tangents(
            layout,
            rest,
            rules,
            leaves,
            tangents[0],
            log._replace(figures=known),
            amid,
            written,
            tolerance,
        )
        return known, found

    return log._replace(figures=figures(leaves, log, amid, written, tolerance))


class _Carry(NamedTuple):
    """Tangents of the spheres, and of the coupled solve in progress."""

    spheres: Flying
    coupled: ClusterState | None
    held: Array


def _tangents(
    layout: Layout,
    rest: Any,
    rules: Rules,
    leaves: Any,
    along: Any,
    log: Log,
    amid: Bool[Array, " N"] | None,
    written: Int[Array, ""],
    tolerance: Float[Array, ""],
) -> Figures:
    def blanked(tree: Any, counts: Array) -> Any:
        return jax.tree.map(lambda x: jnp.where(counts, x, jnp.zeros_like(x)), tree)

    def impact(
        carry: _Carry, known: Figures, facts: Facts, counts: Array
    ) -> tuple[_Carry, Figures]:
        first, second = facts.choice.first, jnp.minimum(facts.choice.second, layout.spheres - 1)
        is_sphere = facts.choice.second < layout.spheres
        who = jnp.stack([first, jnp.where(is_sphere, second, first)])
        before = jax.tree.map(lambda all: all[who], carry.spheres)

        def strike(leaves: Any, before: Flying) -> Outcome:
            numbers = eqx.combine(leaves, rest)
            if rules.soft:
                return soft(layout, numbers, before, facts.choice, tolerance, counts)
            return hit(layout, numbers, before, facts.choice)

        place = two_that_meet(layout, facts.choice.time)
        safe = jax.tree.map(lambda a, b: jnp.where(counts, a, b), known.before, place)
        _, outcome = jax.jvp(strike, (leaves, safe), (along, before))
        outcome, before = blanked(outcome, counts), blanked(before, counts)

        def put(all: Array, new: Array) -> Array:
            old = all[who]
            keep = jnp.stack([counts, counts & is_sphere])
            new = jnp.where(keep.reshape((2,) + (1,) * (old.ndim - 1)), new, old)
            return all.at[who[1]].set(new[1]).at[first].set(new[0])

        moved = carry._replace(spheres=jax.tree.map(put, carry.spheres, outcome.after))
        together = jax.tree.map(jnp.zeros_like, known.coupled)
        return moved, Figures(before, outcome, together)

    def together(
        carry: _Carry, known: Figures, facts: Facts, counts: Array
    ) -> tuple[_Carry, Figures]:
        called, at, members = facts.call, known.coupled, rules.members
        assert called is not None and at is not None and carry.coupled is not None

        seats = called.decided.seats
        who, index = jnp.minimum(seats.who, layout.spheres - 1), index_of(layout, seats)

        def solve(
            leaves: Any, spheres: Flying, held: Array, before: ClusterState
        ) -> tuple[ClusterState, ClusterState, Array, Array]:
            numbers = eqx.combine(leaves, rest)
            began, done = call(
                layout, numbers, members, spheres, called.support, held, as_flags(before),
                decided.where(counts), tolerance, rules.v0, max_steps=2 * MOST_STEPS,
            )  # fmt: skip
            work = work_of_walls(layout, numbers, seats, began, done)
            place = done.state.position[:members] + seats.shift * numbers.period[None]
            return as_numbers(began), as_numbers(done.state), work, place

        # At the places of this call, in which it began; they may be those of other bodies before.
        before = rearranged(carry.coupled, called.decided.change, members)
        # Rest, and the last of all steps, come at a time that rounding decides, so that this solve
        # would stop at another one: it goes to the time that is known.
        stops = called.rest | called.paused
        decided = called.decided._replace(
            change=in_place(called.decided.change),
            until=jnp.where(stops, at.end.time, called.decided.until),
            to_the_end=stops,
        )
        spheres, held = jax.tree.map(lambda x: x[who], (carry.spheres, carry.held))
        given = (leaves, at.spheres, at.held, at.began)
        slopes = (along, spheres, held, before)
        _, (began, end, work, place) = jax.jvp(solve, given, slopes)

        def settled(old: Array, new: Array) -> Array:
            return put(old, index, new)

        moved = Flying(
            settled(carry.spheres.position, place),
            settled(carry.spheres.velocity, end.velocity[:members]),
            settled(carry.spheres.time, jnp.broadcast_to(end.time, (members,))),
        )
        first, second = places(layout, members)
        on_wall = (at.end.closed > 0.5) & (second >= members) & called.rest
        latched = jnp.zeros_like(held).at[first].add(jnp.where(on_wall, end.latched, 0))
        nothing = jax.tree.map(jnp.zeros_like, known)
        figures = nothing._replace(
            outcome=nothing.outcome._replace(time=began.time),
            coupled=Together(spheres, held, began, end, work, jnp.zeros_like(work)),
        )
        return _Carry(moved, end, settled(carry.held, latched)), figures

    def row(carry: _Carry, one: tuple[Log, Array]) -> tuple[_Carry, Figures]:
        (known, facts), counts = one
        if facts.call is None:
            return impact(carry, known, facts, counts)
        is_call = facts.call.is_call & counts
        return jax.lax.cond(
            is_call,
            lambda: together(carry, known, facts, is_call),
            lambda: impact(carry, known, facts, counts & ~is_call),
        )

    time = jnp.zeros(layout.spheres, along.position.dtype)
    start = Flying(along.position, along.velocity, time)
    if amid is not None:
        moves = along.start.underway
        led = Flying(moves.position, moves.velocity, moves.time)
        start = where_each(amid, led, start)
    coupled, held = None, time
    if log.figures.coupled is not None:
        coupled = jax.tree.map(lambda x: jnp.zeros_like(x[0]), log.figures.coupled.end)
    if along.start is not None:
        held = along.start.held
        if coupled is not None and along.start.contacts is not None:
            began = along.start.contacts.state._asdict()
            # Flags have no derivative.
            coupled = coupled._replace(**{k: x for k, x in began.items() if x is not None})
    counts = jnp.arange(log.facts.tied.shape[0]) < written
    return jax.lax.scan(row, _Carry(start, coupled, held), (log, counts))[1]
