"""The moment of an event inside of the step that passed it."""

from __future__ import annotations

import functools
import operator
from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp

from .._forms import Flag
from .._implicit import bracketed_root, with_implicit_derivative
from ._motion import Moment, Motion, Number, State
from ._root_in_step import GUESSES, StepTaken, polynomial_through, root_in_step


class _LastStep(NamedTuple):
    """The step in which an event lies; `moving`: the arrays of its solver."""

    before: Moment
    after: Moment
    motion: Motion
    compressing: Flag
    moving: Any


def event_in_step(
    term: diffrax.ODETerm,
    solver: Any,
    before: Moment,
    after: Moment,
    motion: Motion,
    compressing: Flag,
    arrived: Flag,
) -> Moment:
    """The moment of the event in the last step, and its state; the end of the step without one.

    It is found by steps of the same solver that end there.
    """
    moving, still = eqx.partition(solver, eqx.is_array)

    def stepped(fraction: Number, inputs: _LastStep) -> Moment:
        (t, state), after, motion, compressing, moving = inputs
        solver, end = eqx.combine(moving, still), t + fraction * (after.tau - t)
        args = (motion, compressing)
        memory = solver.init(term, t, end, state, args)
        found, *_ = solver.step(term, t, end, state, args, memory, made_jump=False)
        return Moment(end, found)

    def gap(fraction: Number, inputs: _LastStep, closing: tuple, *rest: Any) -> Number:
        found = stepped(fraction, inputs).state
        gaps = inputs.motion.gaps(found, inputs.compressing)
        return jnp.where(rest[0], _nearest(closing, gaps), 1 - fraction)

    def find(inputs: _LastStep, closing: tuple, arrived: Flag, until: Number) -> Number:
        before, after, motion, compressing, _ = inputs
        step = StepTaken(
            start=before.state,
            end=after.state,
            size=after.tau - before.tau,
            rate=lambda state: motion.rate(state, compressing),
            later=lambda fraction: stepped(fraction, inputs).state,
        )

        def nearest(state: State) -> Number:
            return _nearest(closing, motion.gaps(state, compressing))

        return root_in_step(nearest, step, arrived, until)

    inputs = _LastStep(before, after, motion, compressing, moving)
    closing, until = _closing(*jax.lax.stop_gradient((motion, before, after, compressing)))
    fraction = with_implicit_derivative(find, gap)(inputs, closing, arrived, until)
    return stepped(fraction, inputs)


def _closing(
    motion: Motion, before: Moment, after: Moment, compressing: Flag
) -> tuple[tuple[Flag, ...], Number]:
    """Which gaps close in a step, and a fraction of it at which the first one has closed.

    Those that change sign: a way out starts at a turn, which is not the next one, and the corner
    between two gaps would slow the search for the one that closes. Under a push the bodies may part
    and come back within the step, which their turn shows.
    """
    first, last = (motion.gaps(at.state, compressing) for at in (before, after))
    closing = [(opened > 0) & (closed <= 0) for opened, closed in zip(first, last, strict=True)]
    until = jnp.ones_like(after.tau)
    if motion.push is None:
        return tuple(closing), until
    size = after.tau - before.tau
    between = polynomial_through(
        lambda state: motion.rate(state, compressing), before.state, after.state, size
    )

    def turning(fraction: Number) -> Number:
        speed = motion.gaps(between(fraction), compressing)[0]
        return jnp.where(closing[0], speed, 1 - fraction)

    ends = jnp.where(closing[0], first[0], 1), jnp.where(closing[0], last[0], 0)
    turn = bracketed_root(turning, *ends, GUESSES)
    there = motion.gaps(between(turn), compressing)
    apart = [(gap > 0) & (parted <= 0) for gap, parted in zip(first[1:], there[1:], strict=True)]
    until = jnp.where(closing[0] & functools.reduce(operator.or_, apart), turn, until)
    apart = [old | new for old, new in zip(closing[1:], apart, strict=True)]
    return (closing[0], *apart), until


def _nearest(closing: tuple[Flag, ...], gaps: tuple[Number, ...]) -> Number:
    """The smallest gap of those that close."""
    chosen = (jnp.where(closes, gap, 1) for closes, gap in zip(closing, gaps, strict=True))
    return functools.reduce(jnp.minimum, chosen)
